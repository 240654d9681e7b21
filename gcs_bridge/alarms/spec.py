"""What an alarm is, before anything is measured."""

from __future__ import annotations

from dataclasses import dataclass

from gcs_bridge.contract import Severity
from gcs_bridge.settings import AlarmSettings


@dataclass(frozen=True, eq=False, kw_only=True)
class AlarmSpec:
    """One alarm of a check: made once in its constructor, and known by the object itself, never by its names.

    `check` and `name`: whose it is, and its own name within the check; `id_part`: what stands for both in alarm ids.
    `what` it says, and what it is `not_a_sign_of`; `unit` of its peak; `delays`: votes and delays.
    `recurring_window_s`: within that time excursions that are too short by themselves raise it together; 0: never.
    `asks_doctor`: whether a diagnosis is wanted; `onset_lead_s`: so long before its first bad sample a fault began, as
    with a mean that has to grow first.
    """

    check: str
    name: str
    id_part: str
    severity: Severity
    what: str
    not_a_sign_of: str
    unit: str
    delays: AlarmSettings
    recurring_window_s: float = 0.0
    asks_doctor: bool = False
    onset_lead_s: float = 0.0
