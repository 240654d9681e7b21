"""What an alarm is, before anything is measured, and what a check found for it."""

from __future__ import annotations

from typing import NamedTuple

from gcs_bridge.alarms.rated import Rated
from gcs_bridge.contract import Severity
from gcs_bridge.settings import AlarmSettings


class AlarmSpec(NamedTuple):
    """One alarm of a check: its name within the check, severity, what it says, votes and delays; unit, if its own.

    `recurring_window_s`: within that time excursions that are too short by themselves raise it together; 0: never.
    """

    name: str
    severity: Severity
    what: str
    delays: AlarmSettings
    unit: str | None = None
    recurring_window_s: float = 0.0


class RatedSamples(NamedTuple):
    """What a check found for one of its alarm_specs."""

    tier: str
    rated: Rated
