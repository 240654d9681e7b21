"""Which one state stands for all alarms of a check."""

from typing import get_args

import pytest

from gcs_bridge.alarms.state import Announcement, State
from gcs_bridge.contract import Severity
from gcs_bridge.judging.snapshot import AlarmNow, CheckNow
from gcs_bridge.metrics.check_state import CHECK_STATES, CheckState, state_of
from gcs_bridge.report.schema import CheckVerdict

S, A = State, Announcement


def alarm(state: State, severity: Severity = "alarm", announcement: Announcement = A.TOLD) -> AlarmNow:
    return AlarmNow(
        name=severity,
        severity=severity,
        unit="deg",
        t_boot_s=1.0,
        value=0.0,
        limit=1.0,
        state=state,
        announcement=announcement,
        id=None,
        peak=None,
    )


def check(*alarms: AlarmNow, verdict: CheckVerdict = "agree") -> CheckNow:
    return CheckNow(name="gyro", verdict=verdict, alarms=alarms)


@pytest.mark.parametrize(
    ("now", "state"),
    [
        (check(alarm(S.NORMAL), alarm(S.NORMAL, "warning")), "normal"),
        # What was raised and has gone is over, whatever the verdict of the run so far.
        (check(alarm(S.RETURNED), verdict="alarm"), "normal"),
        (check(alarm(S.PENDING)), "pending"),
        (check(alarm(S.RETURNED_PENDING)), "pending"),
        (check(alarm(S.RAISED), verdict="alarm"), "alarm"),
        (check(alarm(S.ACKNOWLEDGED), verdict="alarm"), "alarm"),
        (check(alarm(S.CLEARING), verdict="alarm"), "alarm"),
        (check(alarm(S.NORMAL), alarm(S.RAISED, "warning"), verdict="warning"), "warning"),
        (check(alarm(S.RAISED), alarm(S.RAISED, "warning", A.SUPPRESSED), verdict="alarm"), "alarm"),
        (check(alarm(S.PENDING), alarm(S.RAISED, "warning"), verdict="warning"), "warning"),
        # Shelved: neither an alarm nor health; what is not shelved is told beside it.
        (check(alarm(S.RAISED, announcement=A.SHELVED), verdict="alarm"), "shelved"),
        (check(alarm(S.RAISED, announcement=A.SHELVED), alarm(S.RAISED, "warning"), verdict="alarm"), "warning"),
        (check(alarm(S.NORMAL, announcement=A.SHELVED)), "normal"),
        # Nothing to compare: not any more, or not yet, whether there are alarms or not.
        (check(alarm(S.NO_COMPARE), alarm(S.NO_COMPARE, "warning")), "no_compare"),
        (check(alarm(S.NORMAL), verdict="no_compare"), "no_compare"),
        (check(verdict="no_compare"), "no_compare"),
        (check(), "normal"),
        (check(alarm(S.INOP)), "inop"),
        (check(alarm(S.NORMAL), verdict="inop"), "inop"),
    ],
)
def test_the_worst_counts(now: CheckNow, state: CheckState) -> None:
    """Alarms before what is pending, and both before what keeps a check from comparing."""
    assert state_of(now) == state


@pytest.mark.parametrize("state", State)
def test_every_state_of_an_alarm_has_one(state: State) -> None:
    """None is forgotten, and there are no others than those that are exported."""
    assert state_of(check(alarm(state))) in CHECK_STATES
    assert get_args(CheckState) == CHECK_STATES
