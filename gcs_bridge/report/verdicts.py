"""The report's names and orders that the contract fixes, for every format to share."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

from gcs_bridge.report.schema import Vehicle, Verdict
from gcs_bridge.settings import FailOn

__all__ = [
    "ATTITUDE_MESSAGES",
    "COMPARATORS",
    "EXIT_CODES",
    "LABELS",
    "SCHEMA",
    "UNJUDGED",
    "VERDICTS",
    "compared",
    "fails",
    "sends_attitude",
    "worst_verdict",
]
SCHEMA: Literal["gcs-bridge/report/1"] = "gcs-bridge/report/1"
VERDICTS: tuple[Verdict, ...] = ("alarm", "warning", "no_compare", "agree")
"""Verdicts of a vehicle, a file and a report, worst first."""
EXIT_CODES = (3, 1, 4, 0)
"""What judging recordings can end with, worst first; 2 ends it before."""
LABELS = {
    "agree": "AGREE",
    "explained": "EXPLAINED",
    "warning": "WARNING",
    "alarm": "ALARM",
    "no_compare": "NO COMPARE",
    "inop": "INOP",
}
"""A check's verdicts as people read them."""
UNJUDGED = frozenset({"no_compare", "inop"})
"""A check's verdicts that say nothing about the vehicle."""
COMPARATORS = frozenset({"euler_quaternion", "secondary_estimate", "kinematics", "gyro", "gravity", "mag_heading"})
"""The checks that compare an attitude with something; all others judge the data's quality only."""
ATTITUDE_MESSAGES = frozenset({"ATTITUDE", "ATTITUDE_QUATERNION", "ATTITUDE_QUATERNION_COV", "AHRS2", "AHRS3"})


def worst_verdict(verdicts: Iterable[Verdict]) -> Verdict:
    """The worst of some verdicts; without any, nothing was compared."""
    found = set(verdicts)
    return next((verdict for verdict in VERDICTS if verdict in found), "no_compare")


def sends_attitude(vehicle: Vehicle) -> bool:
    """Whether any message of the report's vehicle carried an attitude."""
    return any(stream.count for name, stream in vehicle.streams.items() if name in ATTITUDE_MESSAGES)


def compared(vehicle: Vehicle) -> bool:
    """Whether anything judged the vehicle's attitude."""
    return any(check.name in COMPARATORS and check.verdict not in UNJUDGED for check in vehicle.checks)


def fails(verdict: str, fail_on: FailOn) -> bool:
    """Whether a verdict, or how severe an alarm is, is to fail."""
    return verdict in {"warning": ("alarm", "warning"), "alarm": ("alarm",), "never": ()}[fail_on]
