"""What is told of a vehicle beside its alarms: its clock, resets, streams, and which comparisons these end."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

from gcs_bridge.alarms.manager import SignalAt
from gcs_bridge.alarms.state import Signal
from gcs_bridge.checks.base import Check
from gcs_bridge.checks.euler_quaternion import EulerQuaternion
from gcs_bridge.checks.stream import StreamCheck
from gcs_bridge.contract import known
from gcs_bridge.events import (
    ClockStep,
    CompareResumed,
    EstimatorReset,
    Event,
    Inop,
    NoCompare,
    Notice,
    Rank,
    RateRequested,
    Reboot,
    ReceiverPaused,
    StreamResumed,
    StreamStale,
    StreamStarted,
    head,
)
from gcs_bridge.judging.boot import Boot
from gcs_bridge.judging.estimator_resets import Reset
from gcs_bridge.judging.start_up import StartUpChange
from gcs_bridge.report import schema
from gcs_bridge.telemetry.clocks import ClockChange
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.telemetry.link_clock import LinkClock
from gcs_bridge.telemetry.rate_requests import RateChange
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
    known = change.t_boot_us >= 0
    where = head(vehicle, change.boot, change.t_boot_us if known else None, change.t_rx_us)
    return Notice(change.frame_index, kind(**where, step_s=change.step_us / 1e6 if known else None), Rank.CLOCK)


def pause_notice(vehicle: VehicleId, change: StreamChange, link: LinkClock) -> Notice:
    """The receiver did not listen for a time: it is nobody's but the link's."""
    where = head(vehicle, None, None, link.at(change.frame_index), StreamCheck.name)
    where["vehicle"] = None
    pause_s = change.silent_us / 1e6
    reason = f"the receiver paused for {pause_s:.1f} s, or its clock was set forward: less time passed on the vehicles"
    return Notice(change.frame_index, ReceiverPaused(**where, pause_s=pause_s, reason=reason), Rank.CLOCK)


def rate_notice(vehicle: VehicleId, change: RateChange) -> Notice:
    """Somebody asked for another rate of the streams."""
    request = change.request
    streams = tuple(STREAMS[stream] for stream in request.streams)
    event = RateRequested(
        **head(vehicle, None, None, request.t_rx_us, StreamCheck.name),
        streams=streams,
        rate_hz=request.rate_hz,
        by=request.by,
        how=request.how,
        instead_of=change.instead_of,
        undo_each_other=change.undo_each_other,
        reason=rate_words(change),
    )
    return Notice(request.frame_index, event)


def rate_words(change: RateChange) -> str:
    """Who asked for what, and against whom."""
    request = change.request
    who = "somebody who is not heard here" if request.by is None else "{},{}".format(*request.by)
    rate = {None: "the vehicle's own rate", 0.0: "an end"}.get(request.rate_hz, f"{request.rate_hz or 0.0:g} Hz")
    said = f"{who} asked for {rate} of {' and '.join(STREAMS[one] for one in request.streams)}, by {request.how}"
    if change.instead_of is None:
        return said
    return said + ", {} {},{} had asked for".format(
        "and undoes again what" if change.undo_each_other else "instead of what", *change.instead_of
    )


def reset_notice(vehicle: VehicleId, boot: int, reset: Reset, t_rx_us: int, said: Iterable[str]) -> Notice:
    """The estimator was reset; `said`: what the vehicle said lately that may explain it."""
    event = EstimatorReset(
        **head(vehicle, boot, reset.t1_us, t_rx_us),
        tilt=math.degrees(reset.tilt_rad),
        heading=known(math.degrees(reset.heading_rad)),
        explained_by=tuple(said),
    )
    return Notice(reset.frame_index, event)


def reset_entry(event: Event) -> schema.EstimatorReset:
    """The same for the report."""
    fields = schema.EstimatorReset.__struct_fields__
    return schema.EstimatorReset(**{name: getattr(event, name) for name in fields})


def stream_changes(
    vehicle: VehicleId,
    boot: Boot,
    checks: Sequence[Check],
    changes: Iterable[StreamChange],
    link: LinkClock,
    start_ups: Iterable[StartUpChange] = (),
) -> tuple[list[Notice], list[SignalAt]]:
    """What the streams did, which comparisons that ends or brings back, and what the alarms are to know of it.

    So does start-up, while which the attitude means nothing yet.
    """
    notices, signals = [], []
    name = EulerQuaternion.name
    every: Iterable[StreamChange | StartUpChange] = changes
    if start_ups:
        every = sorted([*start_ups, *changes], key=lambda change: change.frame_index)
    for change in every:
        if isinstance(change, StartUpChange):
            told, sources = _start_up_change(vehicle, boot, checks, change, link)
            notices += told
            signals += sources
            continue
        t_rx_us = link.at(change.frame_index)
        where = (vehicle, boot.index, change.t_boot_us, t_rx_us - change.ago_us if t_rx_us >= 0 else t_rx_us)
        stream = STREAMS[change.stream]
        had = {check.name for check in checks if boot.has_sources(check)}
        if change.what == "paused":
            notices.append(pause_notice(vehicle, change, link))
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
        elif boot.no_compare_told and all(boot.alive) and not boot.is_starting:
            boot.no_compare_told = False
            notices.append(Notice(change.frame_index, CompareResumed(**head(*where, check=name))))
    return notices, signals


def _start_up_change(
    vehicle: VehicleId, boot: Boot, checks: Sequence[Check], change: StartUpChange, link: LinkClock
) -> tuple[list[Notice], list[SignalAt]]:
    """Start-up begins or ends: the same of that."""
    where = head(vehicle, boot.index, change.t_boot_us, link.at(change.frame_index), EulerQuaternion.name)
    had = {check.name for check in checks if boot.has_sources(check)}
    boot.is_starting = change.starting
    signals = [
        SignalAt(frame_index=change.frame_index, check=check.name, signal=Signal.FOUND if has else Signal.LOST)
        for check in checks
        if (has := boot.has_sources(check)) != (check.name in had)
    ]
    event: NoCompare | CompareResumed | None = None
    if change.starting and not boot.no_compare_told:
        boot.no_compare_told = True
        event = NoCompare(**where, reason=f"start-up: {change.source} says that the attitude is not ready")
    elif not change.starting and boot.no_compare_told and all(boot.alive):
        boot.no_compare_told = False
        event = CompareResumed(**where)
    return [Notice(change.frame_index, event)] if event is not None else [], signals


def breaks(vehicle: VehicleId, boot: int, checks: Sequence[Check], link: LinkClock) -> Iterator[Notice]:
    """Comparisons that became unable to run, or able again."""
    for check in checks:
        for one in check.breaks():
            where = head(vehicle, boot, one.t_boot_us, link.at(one.frame_index), check.name)
            told = Inop(**where, reason=check.broken) if one.broken else CompareResumed(**where)
            yield Notice(one.frame_index, told)
