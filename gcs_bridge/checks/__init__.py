"""The checks, one file each: a batch of a vehicle in; rated samples, numbers out.

No alarm lives here: what comes of a rated sample is the alarms' affair.
"""

from __future__ import annotations

from gcs_bridge.checks.base import Check
from gcs_bridge.checks.body_rates import BodyRates
from gcs_bridge.checks.euler_quaternion import EulerQuaternion
from gcs_bridge.checks.gravity import Gravity
from gcs_bridge.checks.gyro import Gyro
from gcs_bridge.checks.kinematics import Kinematics
from gcs_bridge.checks.mag_heading import MagHeading
from gcs_bridge.checks.quaternion_norm import QuaternionNorm
from gcs_bridge.checks.secondary_estimate import SecondaryEstimate
from gcs_bridge.checks.stream import StreamCheck
from gcs_bridge.settings import Settings

__all__ = ["all_checks"]


def all_checks(settings: Settings, address: tuple[int, int] | None = None) -> list[Check]:
    """Every check that there is, for one vehicle, in the order in which reports list them.

    `address`: its system and component, for alarms that name them.
    """
    delays = settings.alarm
    return [
        EulerQuaternion(settings.euler_quaternion, delays),
        QuaternionNorm(settings.quaternion_norm, delays),
        BodyRates(settings.body_rates, delays),
        Kinematics(settings.kinematics, delays),
        Gyro(settings.gyro, delays),
        Gravity(settings.gravity, delays),
        MagHeading(settings.mag_heading),
        SecondaryEstimate(settings.secondary_estimate, delays, settings.alignment),
        StreamCheck(settings.stream, delays, address),
    ]
