"""The two attitude streams themselves: silent while the vehicle is heard, frozen, slow, or without numbers."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from msgspec.structs import replace

from gcs_bridge.alarms.rated import Rated
from gcs_bridge.alarms.spec import AlarmSpec
from gcs_bridge.alarms.votes import Ballot, Votes, vote
from gcs_bridge.attitude.quaternion import angle_of, conjugated, product
from gcs_bridge.checks.base import NO_DETAIL, Check, Watched, is_known, watch
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.columns import FloatRows, Int64Rows, Int64s, Records
from gcs_bridge.jit import helper, kernel
from gcs_bridge.settings import AlarmSettings, StreamSettings
from gcs_bridge.telemetry.samples import STREAMS
from gcs_bridge.telemetry.senders import SenderSign
from gcs_bridge.telemetry.statements import ParameterSet
from gcs_bridge.telemetry.stream_liveness import OTHER, StreamChange

_WINDOWS = 24  # of the own rate, whose median is the usual one
_LEAST_WINDOWS = 3
_HEARD_US = 1_000_000  # of the time between two of the vehicle's messages, what it counts as heard
_LOSS_MESSAGES = 256  # timed messages over which the loss is taken
_NEVER = math.log(1e-7)  # probability with which a silence is by chance
_MOST_PERIODS = 20.0  # that a silence needs, however much was lost
_TRANSFER_HZ = 2.0
_TRANSFER = 3  # parameters in one window: ArduPilot slows its streams while it sends them
_PARAMETERS = 1000  # that are remembered
_FROZEN_SHARE = 0.999  # of the time after which a stream is frozen: with that very sample it is

_ALARMS = 4  # of each stream, in this order
_SILENT, _FROZEN, _INVALID, _SLOW = range(_ALARMS)

_STREAM = np.dtype(
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
        ("frame_index", "i8"),  # of the last sample, −1: there was none
        ("heard_us", "i8"),  # time in which the vehicle was heard, up to it
        # The own rate.
        ("latest_us", "i8"),
        ("window_us", "i8"),  # when the window began, and with which frame
        ("window_frame_index", "i8"),
        ("count", "i8"),  # samples in it
        ("silent", "i8"),  # whether a silence lies in it
        ("windows", "i8"),  # whose counts are kept so far
        ("counts", "i8", (_WINDOWS,)),  # a ring
    ]
)
_VEHICLE = np.dtype(
    [
        ("messages", "i8"),  # that carry a time
        ("latest_us", "i8"),
        ("heard_us", "i8"),  # time so far in which the vehicle was heard
        ("lost", "i8", (_LOSS_MESSAGES,)),  # frames so far, at each of the last messages: rings
        ("received", "i8", (_LOSS_MESSAGES,)),
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
    lost: Int64s
    received: Int64s
    euler_rpy_rad: FloatRows  # as sent
    euler_q_nb: FloatRows
    quaternion_q_nb: FloatRows


# Helpers of the kernel carry no types: numba types them anew wherever they are compiled into it.


@helper
def _hear(vehicle, t_us):  # type: ignore[no-untyped-def]  # typed by numba
    """Count the time in which the vehicle is heard: a silence of all of it is none of a stream."""
    if not vehicle.messages:
        vehicle.latest_us = t_us
    vehicle.heard_us += min(max(t_us - vehicle.latest_us, 0), _HEARD_US)
    vehicle.latest_us = max(vehicle.latest_us, t_us)


@helper
def _follow_loss(vehicle, lost, received):  # type: ignore[no-untyped-def]  # typed by numba
    """How many periods of silence mean something, by the share of the vehicle's frames that was lost of late."""
    n = vehicle.messages
    at = n % _LOSS_MESSAGES
    since = at if n >= _LOSS_MESSAGES else 0
    missing, came = (lost - vehicle.lost[since], received - vehicle.received[since]) if n else (0, 0)
    vehicle.lost[at], vehicle.received[at] = lost, received
    vehicle.messages += 1
    share = min(max(missing / max(missing + came, 1), 1e-3), 0.9)
    if share != vehicle.lost_share:
        vehicle.lost_share = share
        vehicle.least_periods = max(vehicle.stale_periods, min(_NEVER / np.log(share), _MOST_PERIODS))


@helper
def _sent(transfers, since, until):  # type: ignore[no-untyped-def]  # typed by numba
    """How many parameters came, from the frame `since` on, before `until`."""
    if not transfers.size or transfers[-1] < since:
        return 0
    return _before(transfers, until) - _before(transfers, since)


@helper
def _before(transfers, frame_index):  # type: ignore[no-untyped-def]  # typed by numba
    """How many parameters came before a frame."""
    low, high = 0, transfers.size
    while low < high:
        middle = (low + high) // 2
        if transfers[middle] < frame_index:
            low = middle + 1
        else:
            high = middle
    return low


@helper
def _silent_s(stream, vehicle, frame_index, transfers):  # type: ignore[no-untyped-def]  # typed by numba
    """For how long the stream has been silent, in time in which the vehicle was heard; 0 while parameters are sent."""
    if stream.frame_index < 0 or stream.period_us < 0:
        return 0.0
    silent_us = vehicle.heard_us - stream.heard_us
    sent = _sent(transfers, stream.frame_index, frame_index)
    if sent >= _TRANSFER and sent >= _TRANSFER_HZ * silent_us * 1e-6:
        return 0.0
    return silent_us * 1e-6


@helper
def _same_s(stream, other, numbers, t_us):  # type: ignore[no-untyped-def]  # typed by numba
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
def _moved_rad(stream, other):  # type: ignore[no-untyped-def]  # typed by numba
    """How far the other stream turned while this one's numbers were the same."""
    (w0, x0, y0, z0), (w1, x1, y1, z1) = stream.other_q, other.q
    return angle_of(product(conjugated((w0, x0, y0, z0)), (w1, x1, y1, z1)))


@helper
def _usual(stream):  # type: ignore[no-untyped-def]  # typed by numba
    """The median of the last windows' counts."""
    n = min(stream.windows, _WINDOWS)
    total = 0
    for one in range(n):
        below = 0  # how many come before it in ascending order
        for other in range(n):
            less = stream.counts[other] < stream.counts[one]
            below += less or (stream.counts[other] == stream.counts[one] and other < one)
        if below == (n - 1) // 2:
            total += stream.counts[one]
        if below == n // 2:
            total += stream.counts[one]
    return 0.5 * total


@helper
def _slower(stream, vehicle, frame_index, t_us, transfers):  # type: ignore[no-untyped-def]  # typed by numba
    """At the end of a window without a silence, how many times slower than usual the stream came; else NaN."""
    if stream.frame_index < 0:
        stream.latest_us = stream.window_us = t_us
        stream.window_frame_index = frame_index
    silent = t_us - stream.latest_us > vehicle.stale_after_us
    stream.latest_us = max(stream.latest_us, t_us)
    stream.silent |= silent
    slower = np.nan
    if stream.latest_us >= stream.window_us + vehicle.slow_after_us:
        if not stream.silent and _sent(transfers, stream.window_frame_index, frame_index) < _TRANSFER:
            if stream.windows >= _LEAST_WINDOWS:
                slower = 1.0 / max(stream.count / max(_usual(stream), 1.0), 1e-3)
            stream.counts[stream.windows % _WINDOWS] = stream.count
            stream.windows += 1
        stream.window_us, stream.window_frame_index, stream.count = stream.latest_us, frame_index, 0
        stream.silent = silent
    stream.count += 1
    return slower


@helper
def _interval_s(vehicle, t_us):  # type: ignore[no-untyped-def]  # typed by numba
    """The time from the latest attitude of either stream to the next."""
    if not vehicle.attitudes:
        vehicle.attitude_us = t_us
    since_us = max(t_us - vehicle.attitude_us, 0)
    vehicle.attitudes += 1
    vehicle.attitude_us = max(vehicle.attitude_us, t_us)
    return since_us * 1e-6


@kernel
def follow(
    messages: Messages, silences: Int64Rows, transfers: Int64s, streams: Annotated[Records, _STREAM],
    vehicles: Annotated[Records, _VEHICLE], places: Int64s, votes: Votes, watched: Watched,
) -> None:  # fmt: skip
    """Follow a vehicle's timed messages, and silences (m, 4) that came between, in order of arrival.

    A silence is told behind the message of its frame. `transfers` (k,): the frames of parameters.
    """
    vehicle = vehicles[0]
    streams[0].row = streams[1].row = 0
    n = told = 0
    while n < messages.t_us.size or told < silences.shape[0]:
        if told == silences.shape[0] or (n < messages.t_us.size and messages.frame_index[n] <= silences[told, 0]):
            frame_index, t_us = messages.frame_index[n], messages.t_us[n]
            _take_message(messages, n, streams, vehicle, transfers, watched)
            n += 1
        else:
            frame_index, k, t_us, silent_us = silences[told]
            streams[k].value[_SILENT], streams[k].limit[_SILENT] = silent_us * 1e-6, 0.0  # bad at its deadline
            told += 1
        for a in range(2 * _ALARMS):
            stream, of = streams[a // _ALARMS], a % _ALARMS
            if not np.isnan(stream.value[of]):
                vote(votes, places[a], frame_index, t_us, stream.value[of], stream.limit[of], NO_DETAIL)
                stream.value[of] = np.nan


@helper
def _take_message(messages, i, streams, vehicle, transfers, watched):  # type: ignore[no-untyped-def]  # typed by numba
    """Take the next message, and put down what the alarms are to vote on."""
    frame_index, k, t_us = messages.frame_index[i], messages.stream[i], messages.t_us[i]
    _hear(vehicle, t_us)
    _follow_loss(vehicle, messages.lost[i], messages.received[i])
    if k != OTHER:
        q = messages.euler_q_nb if k == 0 else messages.quaternion_q_nb
        numbers = messages.euler_rpy_rad if k == 0 else q
        if streams[k].row < q.shape[0]:
            _take_sample(streams[k], streams[1 - k], vehicle, frame_index, t_us, numbers, q, transfers)
            watch(watched, t_us, _interval_s(vehicle, t_us), True)
        if messages.period_us[i] >= 0:
            streams[k].period_us = messages.period_us[i]
    for stream in streams:
        limit_us = max(vehicle.stale_after_us, vehicle.least_periods * stream.period_us, 1.0)
        stream.value[_SILENT] = _silent_s(stream, vehicle, frame_index, transfers)
        stream.limit[_SILENT] = limit_us * 1e-6


@helper
def _take_sample(stream, other, vehicle, frame_index, t_us, numbers, q, transfers):  # type: ignore[no-untyped-def]  # typed by numba
    """Take the next sample of a stream, of which `numbers` are as they were sent, and see what it tells."""
    row = stream.row
    stream.row += 1
    same_s = _same_s(stream, other, numbers[row], t_us)
    frozen = same_s >= vehicle.frozen_after_s and _moved_rad(stream, other) > vehicle.moved_rad
    stream.value[_FROZEN] = same_s if frozen else 0.0
    stream.value[_INVALID] = 0.0 if is_known(q[row]) else 1.0
    stream.value[_SLOW] = _slower(stream, vehicle, frame_index, t_us, transfers)
    for i in range(4):
        stream.q[i] = q[row, i]
    stream.frame_index, stream.heard_us = frame_index, vehicle.heard_us


class _StreamAlarms(NamedTuple):
    """Of one stream: silent, frozen, without numbers, slow."""

    silent: AlarmSpec
    frozen: AlarmSpec
    invalid: AlarmSpec
    slow: AlarmSpec


class StreamCheck(Check):
    """The check over one vehicle."""

    name: ClassVar[str] = "stream"
    needs: ClassVar[Literal["both", "quaternion", "any", "nothing"]] = "nothing"
    compares: ClassVar[bool] = False
    unit: ClassVar[str] = "s"
    not_a_sign_of: ClassVar[str] = "not the attitude itself: what does not come, or stands still, tells nothing of it"
    ok_text: ClassVar[str] = "both streams came steadily"

    def __init__(self, settings: StreamSettings, delays: AlarmSettings, address: tuple[int, int] | None = None) -> None:
        """Start with nothing judged; `address`: system and component of the vehicle, for the words of its alarms."""
        super().__init__()
        self._settings = settings
        self._delays = delays
        self._at_once = replace(delays, bad_samples=1, counted_samples=1, on_delay_s=0.0)
        self._alarms = tuple(self._alarms_of(name) for name in STREAMS)
        self._sender_alarms = self._alarms_of_senders("one identity" if address is None else "{},{}".format(*address))
        self.alarm_specs = *(spec for alarms in self._alarms for spec in alarms), *self._sender_alarms
        self._start()

    def _alarms_of(self, name: str) -> _StreamAlarms:
        at_once = self._at_once
        stopped = f"{name} stopped, while the vehicle is still heard"
        frozen = f"{name} is frozen: the same attitude on and on"
        slow = f"{name} comes at less than half of its usual rate"
        return _StreamAlarms(
            silent=self._alarm_spec(f"{name} silent", "alarm", stopped, at_once),
            frozen=self._alarm_spec(f"{name} frozen", "alarm", frozen, at_once),
            invalid=self._alarm_spec(
                f"{name} invalid", "alarm", f"{name} carries NaN or infinity", self._delays, unit="1"
            ),
            slow=self._alarm_spec(f"{name} slow", "warning", slow, at_once, unit="1"),
        )

    def _alarms_of_senders(self, identity: str) -> tuple[AlarmSpec, AlarmSpec]:
        """Of SENDERS and of VERSIONS: what has been seen time and again needs no further delay."""
        two = f"two senders use {identity}: clocks, attitudes or heartbeats of both come in turn"
        beside = (
            f"two senders use {identity}: MAVLink 1 and 2 come in turn, numbered apart, and one without an attitude"
        )
        return (
            self._alarm_spec("senders", "alarm", two, self._at_once, unit="times"),
            self._alarm_spec("versions", "warning", beside, self._at_once, unit="times"),
        )

    def start_boot(self) -> None:
        """Forget what counts within one boot alone."""
        super().start_boot()
        self._start()

    def _start(self) -> None:
        settings = self._settings
        self._streams, self._vehicle = np.zeros(2, _STREAM), np.zeros(1, _VEHICLE)
        for name in ("q", "sent", "other_q", "value"):
            self._streams[name] = np.nan
        self._streams["period_us"] = self._streams["frame_index"] = -1
        self._streams["limit"] = 0.0, settings.frozen_after_s * _FROZEN_SHARE, 0.5, 1.0 / settings.slow_below
        vehicle = self._vehicle[0]
        vehicle["stale_periods"], vehicle["stale_after_us"] = settings.stale_periods, settings.stale_after_s * 1e6
        vehicle["frozen_after_s"], vehicle["moved_rad"] = settings.frozen_after_s, settings.moved_rad
        vehicle["slow_after_us"] = round(settings.slow_after_s * 1e6)
        self._transfers = _NONE

    def judge(self, batch: CheckBatch, ballot: Ballot) -> None:
        """Rate what came, and what did not."""
        if batch.statements:
            sent = [say.frame_index for say in batch.statements if isinstance(say, ParameterSet)]
            self._transfers = np.concatenate((self._transfers[-_PARAMETERS:], np.array(sent, np.int64)))
        line, euler, quaternion = batch.line, batch.euler, batch.quaternion
        assert euler.rpy_rad is not None
        messages = Messages(
            frame_index=line.frame_index,
            stream=line.stream,
            t_us=line.t_boot_us,
            period_us=line.period_us,
            lost=line.lost,
            received=line.received,
            euler_rpy_rad=euler.rpy_rad,
            euler_q_nb=euler.q_nb,
            quaternion_q_nb=quaternion.q_nb,
        )
        self._follow(messages, batch.stream_changes, ballot)

    def silent(self, turns: list[StreamChange], ballot: Ballot) -> None:
        """Rate silences that were found on receive time, while no timed message came."""
        self._follow(_NO_MESSAGES, turns, ballot)

    def senders(self, signs: list[SenderSign], frame_index: Int64s, t_boot_us: Int64s, ballot: Ballot) -> None:
        """Rate signs of more than one sender, each with a message's frame (n,) and boot time (n,)."""
        for sign, at, t_us in zip(signs, frame_index.tolist(), t_boot_us.tolist(), strict=True):
            times = np.array([float(sign.times)])
            never = np.zeros(1, np.bool_)
            ballot.rate(
                self._sender_alarms[sign.what],
                Rated(
                    frame_index=np.array([at]),
                    t_boot_us=np.array([t_us]),
                    value=times,
                    limit=np.array([0.5]),
                    bad=times > 0.5,
                    low=never,
                    detail=np.array([NO_DETAIL]),
                ),
            )

    def _follow(self, messages: Messages, turns: list[StreamChange], ballot: Ballot) -> None:
        silences, n = _silences(turns), len(messages.t_us)
        if n or len(silences):
            follow(
                messages,
                silences,
                self._transfers,
                self._streams,
                self._vehicle,
                self._places(ballot),
                ballot.votes(5 * n + len(silences)),
                self._watching(n),
            )

    def why_not(self) -> str:
        """Why nothing was judged."""
        return "neither ATTITUDE nor ATTITUDE_QUATERNION was received"


def _silences(turns: list[StreamChange]) -> Int64s:
    """Where no timed message came, although the vehicle was heard (m, 4): frame, stream, boot time, how long, µs."""
    found = [(turn.frame_index, turn.stream, turn.t_boot_us, turn.silent_us) for turn in turns if turn.what == "silent"]
    return np.array(sorted(found, key=lambda row: row[0]), np.int64) if found else _NO_SILENCES


_NONE = np.empty(0, np.int64)
_NO_SILENCES = np.empty((0, 4), np.int64)
_NO_MESSAGES = Messages(*(_NONE,) * 6, np.empty((0, 3)), np.empty((0, 4)), np.empty((0, 4)))
