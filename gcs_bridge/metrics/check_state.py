"""Where a check stands, in one of a few words: what is exported of all its alarms together."""

from __future__ import annotations

from typing import Literal

from gcs_bridge.alarms.state import PENDING, SHELVED, STANDING, State
from gcs_bridge.judging.snapshot import CheckNow

__all__ = ["CHECK_STATES", "CheckState", "state_of"]

CheckState = Literal["normal", "pending", "warning", "alarm", "shelved", "no_compare", "inop"]
CHECK_STATES: tuple[CheckState, ...] = ("normal", "pending", "warning", "alarm", "shelved", "no_compare", "inop")


def state_of(check: CheckNow) -> CheckState:
    """The one state that a check is in: the worst of its alarms; else what keeps it from comparing, if anything does.

    An alarm that stands stays so when its source goes, acknowledged or not. What somebody has shelved is none, and is
    not called normal either. A check that has judged nothing yet compares nothing.
    """
    heard = [alarm for alarm in check.alarms if alarm.announcement not in SHELVED]
    standing = {alarm.severity for alarm in heard if alarm.state in STANDING}
    if standing:
        return "alarm" if "alarm" in standing else "warning"
    if any(alarm.state in PENDING for alarm in heard):
        return "pending"
    states = {alarm.state for alarm in check.alarms}
    if states & STANDING:
        return "shelved"
    if State.INOP in states or check.verdict == "inop":
        return "inop"
    if State.NO_COMPARE in states or check.verdict == "no_compare":
        return "no_compare"
    return "normal"
