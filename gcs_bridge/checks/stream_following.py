"""Follows both attitude streams of a vehicle, one message after the other in order of arrival: what each tells.

With each sample whether its numbers are frozen, are none, or come slowly; with each message, and with frames that carry
no time, whether a stream is silent. What a silence is, and what slow is, `stream_silence` and `stream_rate` say.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from gcs_bridge.alarms.votes import Votes, vote
from gcs_bridge.attitude.quaternion import angle_of, conjugated, product
from gcs_bridge.checks.base import NO_DETAIL, Watched, is_known, watch
from gcs_bridge.checks.stream_rate import WINDOWS, take_request, times_slower
from gcs_bridge.checks.stream_silence import (
    HEARD_US,
    LOSS_MESSAGES,
    follow_loss,
    hear,
    hear_frame,
    is_silent,
    silent_limit_s,
    silent_s,
    take_slowdown,
)
from gcs_bridge.columns import FloatRows, Floats, Int64s, Mask, Records
from gcs_bridge.jit import helper, kernel
from gcs_bridge.telemetry.stream_liveness import OTHER

_ALARMS = 4  # of each stream, in this order
_SILENT, _FROZEN, _INVALID, _SLOW = range(_ALARMS)
STREAM = np.dtype(
    [
        ("row", "i8"),  # of its next sample in the batch
        ("q", "f8", (4,)),  # its last attitude
        # What its alarms are to vote on next, and their limits.
        ("value", "f8", (_ALARMS,)),  # NaN: nothing
        ("limit", "f8", (_ALARMS,)),
        # The same numbers on and on.
        ("sent", "f8", (4,)),  # the last sample's numbers
        ("changed", "i8"),  # whether they were new
        ("same_since_us", "i8"),
        ("other_q", "f8", (4,)),  # the other stream's attitude when they came the second time
        # Silence.
        ("period_us", "i8"),
        ("rx_period_us", "i8"),
        ("frame_index", "i8"),  # of the last sample, −1: there was none
        ("heard_us", "i8"),  # time in which the vehicle was heard, up to it
        # The own rate.
        ("latest_us", "i8"),
        ("window_us", "i8"),  # when the window began
        ("count", "i8"),  # samples in it
        ("silent", "i8"),  # whether a silence lies in it
        ("slowed", "i8"),  # whether it overlaps a transfer
        ("windows", "i8"),  # whose counts are kept so far
        ("counts", "i8", (WINDOWS,)),  # a ring
        # What was asked for.
        ("asked_count", "f8"),  # samples in a window, 0: nothing less than was usual then
        ("asked_period_us", "f8"),  # 0: it is not known
    ]
)
VEHICLE = np.dtype(
    [
        ("messages", "i8"),  # that carry a time
        ("latest_us", "i8"),
        ("heard_us", "i8"),  # time in which the vehicle was heard, up to its last message with a time
        ("beside_us", "i8"),  # and since then, by its other frames
        ("link_us", "i8"),  # the link's time at its last frame, −1: there was none
        ("restarting", "i8"),  # whether it may have restarted
        ("transfers", "i8"),  # messages of the latest transfer
        ("transfer_us", "i8"),  # the link's time at the last of them
        ("slowed", "i8"),  # whether a radio slows the streams,
        ("longer_us", "i8"),  # and by how much that may lengthen the interval of a message
        ("lost", "i8", (LOSS_MESSAGES,)),  # frames so far, at each of the last messages: rings
        ("received", "i8", (LOSS_MESSAGES,)),
        ("lost_share", "f8"),
        ("least_periods", "f8"),  # how many periods of silence mean something, at that share
        ("attitudes", "i8"),  # of both streams
        ("attitude_us", "i8"),  # when the latest of them was
        # Of the settings.
        ("stale_periods", "f8"),
        ("stale_after_us", "f8"),
        ("frozen_after_s", "f8"),
        ("moved_rad", "f8"),
        ("slow_after_us", "i8"),
    ]
)


class Messages(NamedTuple):
    """A vehicle's timed messages (n,), as in `Timeline`, and the samples of both streams that are among them."""

    frame_index: Int64s
    stream: Int64s
    t_us: Int64s
    period_us: Int64s
    rx_period_us: Int64s
    lost: Int64s
    received: Int64s
    euler_rpy_rad: FloatRows  # as sent
    euler_q_nb: FloatRows
    quaternion_q_nb: FloatRows


class Frames(NamedTuple):
    """All of a vehicle's frames (n,), as in `HeardFrames`."""

    frame_index: Int64s
    heard_us: Int64s
    transfer: Mask
    restarting: Mask


class Requests(NamedTuple):
    """Rates (n,) that were asked for of a stream, 0: an end of it, NaN: not known; `frame_index` of the request."""

    frame_index: Int64s
    stream: Int64s
    rate_hz: Floats


class Slowdowns(NamedTuple):
    """As in `Slowdown` (n,)."""

    frame_index: Int64s
    slowed: Mask
    longer_us: Int64s


@helper
def _same_s(stream: Any, other: Any, numbers: Any, t_us: Any) -> Any:
    """For how long the sample's numbers have been the same. NaN differs from itself, and is no frozen attitude."""
    changed = False
    for i in range(numbers.size):
        changed |= numbers[i] != stream.sent[i]
        stream.sent[i] = numbers[i]
    if changed:
        stream.same_since_us = t_us
    elif stream.changed:  # at the change itself the other's may be the one from before
        for i in range(4):
            stream.other_q[i] = other.q[i]
    stream.changed = changed
    return (t_us - stream.same_since_us) * 1e-6


@helper
def _moved_rad(stream: Any, other: Any) -> Any:
    """How far the other stream turned while this one's numbers were the same."""
    (w0, x0, y0, z0), (w1, x1, y1, z1) = stream.other_q, other.q
    return angle_of(product(conjugated((w0, x0, y0, z0)), (w1, x1, y1, z1)))


@helper
def _interval_s(vehicle: Any, t_us: Any) -> Any:
    """The time from the latest attitude of either stream to the next."""
    if not vehicle.attitudes:
        vehicle.attitude_us = t_us
    since_us = max(t_us - vehicle.attitude_us, 0)
    vehicle.attitudes += 1
    vehicle.attitude_us = max(vehicle.attitude_us, t_us)
    return since_us * 1e-6


@kernel
def follow(
    messages: Messages, heard: Frames, requests: Requests, slowdowns: Slowdowns, streams: Annotated[Records, STREAM],
    vehicles: Annotated[Records, VEHICLE], places: Int64s, votes: Votes, watched: Watched,
) -> None:  # fmt: skip
    """Follow a vehicle's timed messages, its frames among which they are, and what others say, in order of arrival."""
    vehicle = vehicles[0]
    streams[0].row = streams[1].row = 0
    n = frames = asked = slower = 0
    while n < messages.t_us.size or frames < heard.frame_index.size:
        is_timed = n < messages.t_us.size
        if frames < heard.frame_index.size and (not is_timed or heard.frame_index[frames] <= messages.frame_index[n]):
            frame_index = heard.frame_index[frames]
            while asked < requests.frame_index.size and requests.frame_index[asked] < frame_index:
                take_request(streams[requests.stream[asked]], vehicle, requests.rate_hz[asked])
                asked += 1
            while slower < slowdowns.frame_index.size and slowdowns.frame_index[slower] < frame_index:
                take_slowdown(streams, vehicle, slowdowns.slowed[slower], slowdowns.longer_us[slower])
                slower += 1
            hear_frame(vehicle, streams, heard, frames)
            frames += 1
            if is_timed and frame_index == messages.frame_index[n]:
                continue
            t_us = vehicle.latest_us + vehicle.beside_us
            _find_silence(streams, vehicle)
        else:
            frame_index, t_us = messages.frame_index[n], messages.t_us[n]
            _take_message(messages, n, streams, vehicle, watched)
            n += 1
        for a in range(2 * _ALARMS):
            stream, of = streams[a // _ALARMS], a % _ALARMS
            if not np.isnan(stream.value[of]):
                vote(votes, places[a], frame_index, t_us, stream.value[of], stream.limit[of], NO_DETAIL)
                stream.value[of] = np.nan
    while asked < requests.frame_index.size:
        take_request(streams[requests.stream[asked]], vehicle, requests.rate_hz[asked])
        asked += 1
    while slower < slowdowns.frame_index.size:
        take_slowdown(streams, vehicle, slowdowns.slowed[slower], slowdowns.longer_us[slower])
        slower += 1


@helper
def _find_silence(streams: Any, vehicle: Any) -> Any:
    """Put down silences that are too long, with a frame that carries no time: it shows nothing else.

    Only where none that carries a time has come for as long as that may take: it tells more.
    """
    if vehicle.restarting or vehicle.beside_us <= HEARD_US:
        return
    for stream in streams:
        if is_silent(stream, vehicle):
            stream.value[_SILENT] = silent_s(stream, vehicle)
            stream.limit[_SILENT] = silent_limit_s(stream, vehicle, max(stream.period_us, stream.rx_period_us))


@helper
def _take_message(messages: Any, i: Any, streams: Any, vehicle: Any, watched: Any) -> Any:
    """Take the next message, and put down what the alarms are to vote on."""
    frame_index, k, t_us = messages.frame_index[i], messages.stream[i], messages.t_us[i]
    hear(vehicle, t_us)
    follow_loss(vehicle, messages.lost[i], messages.received[i])
    if k != OTHER:
        q = messages.euler_q_nb if k == 0 else messages.quaternion_q_nb
        numbers = messages.euler_rpy_rad if k == 0 else q
        if streams[k].row < q.shape[0]:
            _take_sample(streams[k], streams[1 - k], vehicle, frame_index, t_us, numbers, q)
            watch(watched, t_us, _interval_s(vehicle, t_us), True)
        if messages.period_us[i] >= 0:
            streams[k].period_us, streams[k].rx_period_us = messages.period_us[i], messages.rx_period_us[i]
    for stream in streams:
        stream.value[_SILENT] = silent_s(stream, vehicle)
        stream.limit[_SILENT] = silent_limit_s(stream, vehicle, stream.period_us)


@helper
def _take_sample(stream: Any, other: Any, vehicle: Any, frame_index: Any, t_us: Any, numbers: Any, q: Any) -> Any:
    """Take the next sample of a stream, of which `numbers` are as they were sent, and see what it tells."""
    row = stream.row
    stream.row += 1
    same_s = _same_s(stream, other, numbers[row], t_us)
    # A quaternion of zeros is no attitude that stands still: `quaternion_norm` tells what it is.
    is_none = q[row, 0] == 0.0 and q[row, 1] == 0.0 and q[row, 2] == 0.0 and q[row, 3] == 0.0
    frozen = same_s >= vehicle.frozen_after_s and not is_none and _moved_rad(stream, other) > vehicle.moved_rad
    stream.value[_FROZEN] = same_s if frozen else 0.0
    stream.value[_INVALID] = 0.0 if is_known(q[row]) else 1.0
    stream.value[_SLOW] = times_slower(stream, vehicle, t_us)
    for i in range(4):
        stream.q[i] = q[row, i]
    stream.frame_index, stream.heard_us = frame_index, vehicle.heard_us
