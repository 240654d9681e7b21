"""What is told of a vehicle beside its alarms: its clock, resets, streams, and which comparisons these end."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

from gcs_bridge.alarms.manager import SignalAt
from gcs_bridge.alarms.state import Signal
from gcs_bridge.checks.base import Check
from gcs_bridge.checks.euler_quaternion import EulerQuaternion
from gcs_bridge.contract import known
from gcs_bridge.events import (
    ClockStep,
    CompareResumed,
    EstimatorReset,
    Inop,
    NoCompare,
    Notice,
    Rank,
    Reboot,
    StreamResumed,
    StreamStale,
    StreamStarted,
    head,
)
from gcs_bridge.judging.boot import Boot
from gcs_bridge.judging.estimator_resets import Reset
from gcs_bridge.telemetry.clocks import ClockChange
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.telemetry.link_clock import LinkClock
from gcs_bridge.telemetry.samples import STREAMS
from gcs_bridge.telemetry.stream_liveness import StreamChange

_STREAM_EVENTS = {"started": StreamStarted, "stale": StreamStale, "stands": StreamStale, "resumed": StreamResumed}
_WHY_NOT = {
    "missing": "{stream} was never received",
    "stale": "{stream} is silent",
    "stands": "the clock stands still: {stream} comes with one and the same time",
}


def clock_notice(vehicle: VehicleId, change: ClockChange) -> Notice:
    """The vehicle's clock did something else than go on."""
    kind = Reboot if change.kind == "reboot" else ClockStep
    where = head(vehicle, change.boot, change.t_boot_us, change.t_rx_us)
    return Notice(change.frame_index, kind(**where, step_s=change.step_us / 1e6), Rank.CLOCK)


def reset_notice(vehicle: VehicleId, boot: int, reset: Reset, t_rx_us: int, said: Iterable[str]) -> Notice:
    """The estimator was reset; `said`: what the vehicle said lately that may explain it."""
    event = EstimatorReset(
        **head(vehicle, boot, reset.t1_us, t_rx_us),
        tilt=math.degrees(reset.tilt_rad),
        heading=known(math.degrees(reset.heading_rad)),
        explained_by=tuple(said),
    )
    return Notice(reset.frame_index, event)


def stream_changes(
    vehicle: VehicleId, boot: Boot, checks: Sequence[Check], changes: Iterable[StreamChange], link: LinkClock
) -> tuple[list[Notice], list[SignalAt]]:
    """What the streams did, which comparisons that ends or brings back, and what the alarms are to know of it."""
    notices, signals = [], []
    name = EulerQuaternion.name
    for change in changes:
        t_rx_us = link.at(change.frame_index)
        where = (vehicle, boot.index, change.t_boot_us, t_rx_us - change.ago_us if t_rx_us >= 0 else t_rx_us)
        stream = STREAMS[change.stream]
        had = {check.name for check in checks if boot.has_sources(check)}
        if change.what == "paused":
            continue
        if change.what != "missing":
            boot.alive[change.stream] = not change.is_stale
            notices.append(Notice(change.frame_index, _STREAM_EVENTS[change.what](**head(*where), stream=stream)))
        for check in checks:
            has = boot.has_sources(check)
            if has != (check.name in had) or (change.what == "missing" and not has):
                signal = Signal.FOUND if has else Signal.LOST
                signals.append(SignalAt(frame_index=change.frame_index, check=check.name, signal=signal))
        if change.what in _WHY_NOT and not boot.no_compare_told:
            boot.no_compare_told = True
            event = NoCompare(**head(*where, check=name), reason=_WHY_NOT[change.what].format(stream=stream))
            notices.append(Notice(change.frame_index, event))
        elif boot.no_compare_told and all(boot.alive):
            boot.no_compare_told = False
            notices.append(Notice(change.frame_index, CompareResumed(**head(*where, check=name))))
    return notices, signals


def breaks(vehicle: VehicleId, boot: int, checks: Sequence[Check], link: LinkClock) -> Iterator[Notice]:
    """Comparisons that became unable to run, or able again."""
    for check in checks:
        for one in check.breaks():
            where = head(vehicle, boot, one.t_boot_us, link.at(one.frame_index), check.name)
            told = Inop(**where, reason=check.broken) if one.broken else CompareResumed(**where)
            yield Notice(one.frame_index, told)
