"""The two attitude streams themselves: silent while the vehicle is heard, frozen, slow, or without numbers.

A silence is counted in time in which the vehicle was heard, whatever message it was heard by: on its boot clock where
that is told, else on the link's clock. It counts from the last sample, or from the last message of a transfer, which
slows streams or stops them. A rate that somebody asked for is the usual one from then on. A stream that was switched
off is silent all the same, whoever wanted it.
"""

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
from gcs_bridge.columns import FloatRows, Floats, Int64s, Mask, Records
from gcs_bridge.jit import helper, kernel
from gcs_bridge.settings import AlarmSettings, StreamSettings
from gcs_bridge.telemetry.heard import HeardFrames
from gcs_bridge.telemetry.rate_requests import Address, RateChange, RateRequest
from gcs_bridge.telemetry.samples import STREAMS
from gcs_bridge.telemetry.senders import SenderSign
from gcs_bridge.telemetry.stream_liveness import OTHER

_WINDOWS = 24  # of the own rate, whose median is the usual one
_LEAST_WINDOWS = 3
_HEARD_US = 1_000_000  # of the time between two of the vehicle's messages, what it counts as heard
_LOSS_MESSAGES = 256  # timed messages over which the loss is taken
_NEVER = math.log(1e-7)  # probability with which a silence is by chance
_MOST_PERIODS = 20.0  # that a silence needs, however much was lost
# So many messages of a transfer, each within so long behind the one before, are one. A slow radio brings one item of a
# mission in that time; single parameters that are told now and then are no transfer.
_TRANSFER, _TRANSFER_GAP_US = 2, 1_500_000
_FROZEN_SHARE = 0.999  # of the time after which a stream is frozen: with that very sample it is

STANDS = "the clock stands still: samples come with one and the same time"
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
        ("counts", "i8", (_WINDOWS,)),  # a ring
        # What was asked for.
        ("asked_count", "f8"),  # samples in a window, 0: nothing less than was usual then
        ("asked_period_us", "f8"),  # 0: it is not known
    ]
)
_VEHICLE = np.dtype(
    [
        ("messages", "i8"),  # that carry a time
        ("latest_us", "i8"),
        ("heard_us", "i8"),  # time in which the vehicle was heard, up to its last message with a time
        ("beside_us", "i8"),  # and since then, by its other frames
        ("link_us", "i8"),  # the link's time at its last frame, −1: there was none
        ("restarting", "i8"),  # whether it may have restarted
        ("transfers", "i8"),  # messages of the latest transfer
        ("transfer_us", "i8"),  # the link's time at the last of them
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


# Helpers of the kernel carry no types: numba types them anew wherever they are compiled into it.


@helper
def _hear(vehicle, t_us):  # type: ignore[no-untyped-def]  # typed by numba
    """Count the time in which the vehicle is heard: a silence of all of it is none of a stream."""
    if not vehicle.messages:
        vehicle.latest_us = t_us
    vehicle.heard_us += min(max(t_us - vehicle.latest_us, 0), max(vehicle.beside_us, _HEARD_US))
    vehicle.latest_us = max(vehicle.latest_us, t_us)
    vehicle.beside_us = 0


@helper
def _hear_frame(vehicle, streams, heard, i):  # type: ignore[no-untyped-def]  # typed by numba
    """Count the time in which the vehicle is heard by a frame of it, and begin each silence anew with a transfer."""
    at_us = heard.heard_us[i]
    if vehicle.link_us >= 0:
        vehicle.beside_us += min(max(at_us - vehicle.link_us, 0), _HEARD_US)
    vehicle.link_us = at_us
    vehicle.restarting = heard.restarting[i]
    if heard.transfer[i]:
        vehicle.transfers = vehicle.transfers + 1 if at_us - vehicle.transfer_us <= _TRANSFER_GAP_US else 1
        vehicle.transfer_us = at_us
        if vehicle.transfers >= _TRANSFER:
            for stream in streams:
                stream.slowed = 1
                if not _is_silent(stream, vehicle):  # what stopped before is no matter of the transfer
                    stream.heard_us = vehicle.heard_us + vehicle.beside_us


@helper
def _is_slowed(vehicle):  # type: ignore[no-untyped-def]  # typed by numba
    """Whether a transfer goes on."""
    return vehicle.transfers >= _TRANSFER and vehicle.link_us - vehicle.transfer_us <= _TRANSFER_GAP_US


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
def _silent_s(stream, vehicle):  # type: ignore[no-untyped-def]  # typed by numba
    """For how long the stream has been silent, in time in which the vehicle was heard."""
    if stream.frame_index < 0 or stream.period_us < 0:
        return 0.0
    return max(vehicle.heard_us + vehicle.beside_us - stream.heard_us, 0) * 1e-6


@helper
def _silent_limit_s(stream, vehicle, period_us):  # type: ignore[no-untyped-def]  # typed by numba
    """How long a silence of a stream of that period may be, at the share of frames that is lost."""
    period_us = max(period_us, stream.asked_period_us)
    return max(vehicle.stale_after_us, vehicle.least_periods * period_us, 1.0) * 1e-6


@helper
def _is_silent(stream, vehicle):  # type: ignore[no-untyped-def]  # typed by numba
    """Whether it has been silent for too long, as the vehicle's frames tell that carry no time."""
    limit_s = _silent_limit_s(stream, vehicle, max(stream.period_us, stream.rx_period_us))
    return _silent_s(stream, vehicle) > limit_s


@helper
def _take_request(stream, vehicle, rate_hz):  # type: ignore[no-untyped-def]  # typed by numba
    """Somebody asked for another rate, NaN: it is not known which; what was usual is learned anew."""
    usual = _usual(stream) if stream.windows >= _LEAST_WINDOWS else stream.asked_count
    asked = rate_hz * vehicle.slow_after_us * 1e-6
    stream.asked_count = asked if 0.0 < asked < usual else 0.0
    stream.asked_period_us = 1e6 / rate_hz if rate_hz > 0.0 else 0.0
    stream.windows = stream.count = stream.silent = 0
    stream.window_us, stream.slowed = stream.latest_us, _is_slowed(vehicle)


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
def _slower(stream, vehicle, t_us):  # type: ignore[no-untyped-def]  # typed by numba
    """At the end of a window without a silence, how many times slower than usual the stream came; else NaN."""
    if stream.frame_index < 0:
        stream.latest_us = stream.window_us = t_us
    silent = t_us - stream.latest_us > vehicle.stale_after_us
    stream.latest_us = max(stream.latest_us, t_us)
    stream.silent |= silent
    slower = np.nan
    if stream.latest_us >= stream.window_us + vehicle.slow_after_us:
        if not stream.silent and not stream.slowed:
            usual = _usual(stream) if stream.windows >= _LEAST_WINDOWS else stream.asked_count
            if usual > 0.0:
                slower = 1.0 / max(stream.count / max(usual, 1.0), 1e-3)
            stream.counts[stream.windows % _WINDOWS] = stream.count
            stream.windows += 1
        stream.window_us, stream.count, stream.slowed = stream.latest_us, 0, _is_slowed(vehicle)
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
    messages: Messages, heard: Frames, requests: Requests, streams: Annotated[Records, _STREAM],
    vehicles: Annotated[Records, _VEHICLE], places: Int64s, votes: Votes, watched: Watched,
) -> None:  # fmt: skip
    """Follow a vehicle's timed messages, its frames among which they are, and requests, in order of arrival."""
    vehicle = vehicles[0]
    streams[0].row = streams[1].row = 0
    n = frames = asked = 0
    while n < messages.t_us.size or frames < heard.frame_index.size:
        is_timed = n < messages.t_us.size
        if frames < heard.frame_index.size and (not is_timed or heard.frame_index[frames] <= messages.frame_index[n]):
            frame_index = heard.frame_index[frames]
            while asked < requests.frame_index.size and requests.frame_index[asked] < frame_index:
                _take_request(streams[requests.stream[asked]], vehicle, requests.rate_hz[asked])
                asked += 1
            _hear_frame(vehicle, streams, heard, frames)
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
        _take_request(streams[requests.stream[asked]], vehicle, requests.rate_hz[asked])
        asked += 1


@helper
def _find_silence(streams, vehicle):  # type: ignore[no-untyped-def]  # typed by numba
    """Put down silences that are too long, with a frame that carries no time: it shows nothing else.

    Only where none that carries a time has come for as long as that may take: it tells more.
    """
    if vehicle.restarting or vehicle.beside_us <= _HEARD_US:
        return
    for stream in streams:
        if _is_silent(stream, vehicle):
            stream.value[_SILENT] = _silent_s(stream, vehicle)
            stream.limit[_SILENT] = _silent_limit_s(stream, vehicle, max(stream.period_us, stream.rx_period_us))


@helper
def _take_message(messages, i, streams, vehicle, watched):  # type: ignore[no-untyped-def]  # typed by numba
    """Take the next message, and put down what the alarms are to vote on."""
    frame_index, k, t_us = messages.frame_index[i], messages.stream[i], messages.t_us[i]
    _hear(vehicle, t_us)
    _follow_loss(vehicle, messages.lost[i], messages.received[i])
    if k != OTHER:
        q = messages.euler_q_nb if k == 0 else messages.quaternion_q_nb
        numbers = messages.euler_rpy_rad if k == 0 else q
        if streams[k].row < q.shape[0]:
            _take_sample(streams[k], streams[1 - k], vehicle, frame_index, t_us, numbers, q)
            watch(watched, t_us, _interval_s(vehicle, t_us), True)
        if messages.period_us[i] >= 0:
            streams[k].period_us, streams[k].rx_period_us = messages.period_us[i], messages.rx_period_us[i]
    for stream in streams:
        stream.value[_SILENT] = _silent_s(stream, vehicle)
        stream.limit[_SILENT] = _silent_limit_s(stream, vehicle, stream.period_us)


@helper
def _take_sample(stream, other, vehicle, frame_index, t_us, numbers, q):  # type: ignore[no-untyped-def]  # typed by numba
    """Take the next sample of a stream, of which `numbers` are as they were sent, and see what it tells."""
    row = stream.row
    stream.row += 1
    same_s = _same_s(stream, other, numbers[row], t_us)
    frozen = same_s >= vehicle.frozen_after_s and _moved_rad(stream, other) > vehicle.moved_rad
    stream.value[_FROZEN] = same_s if frozen else 0.0
    stream.value[_INVALID] = 0.0 if is_known(q[row]) else 1.0
    stream.value[_SLOW] = _slower(stream, vehicle, t_us)
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
        self._pauses = self._paused_us = 0  # of the receiver
        self._stood = False  # whether the clock stood still
        self._at_odds: set[tuple[Address, Address]] = set()  # stations that undo each other's rates
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
        for name in ("period_us", "rx_period_us", "frame_index"):
            self._streams[name] = -1
        self._streams["limit"] = 0.0, settings.frozen_after_s * _FROZEN_SHARE, 0.5, 1.0 / settings.slow_below
        vehicle = self._vehicle[0]
        vehicle["stale_periods"], vehicle["stale_after_us"] = settings.stale_periods, settings.stale_after_s * 1e6
        vehicle["frozen_after_s"], vehicle["moved_rad"] = settings.frozen_after_s, settings.moved_rad
        vehicle["slow_after_us"] = round(settings.slow_after_s * 1e6)
        vehicle["link_us"] = -1

    def judge(self, batch: CheckBatch, ballot: Ballot) -> None:
        """Rate what came, and what did not."""
        line, euler, quaternion = batch.line, batch.euler, batch.quaternion
        assert euler.rpy_rad is not None
        messages = Messages(
            frame_index=line.frame_index,
            stream=line.stream,
            t_us=line.t_boot_us,
            period_us=line.period_us,
            rx_period_us=line.rx_period_us,
            lost=line.lost,
            received=line.received,
            euler_rpy_rad=euler.rpy_rad,
            euler_q_nb=euler.q_nb,
            quaternion_q_nb=quaternion.q_nb,
        )
        for turn in batch.stream_changes:
            if turn.what == "paused":
                self._pauses += 1
                self._paused_us += turn.silent_us
            self._stood |= turn.what == "stands"
        self._follow(messages, batch.heard, batch.wishes, ballot)

    def hear(self, heard: HeardFrames, wishes: list[RateRequest], ballot: Ballot) -> None:
        """Take frames behind the last message with a time."""
        self._follow(_NO_MESSAGES, heard, wishes, ballot)

    def hear_wish(self, change: RateChange) -> None:
        """Take who asked for which rate, for the report."""
        if change.undo_each_other and change.request.by is not None and change.instead_of is not None:
            one, other = sorted((change.request.by, change.instead_of))
            self._at_odds.add((one, other))

    @property
    def tells(self) -> bool:
        """Whether the samples have times of their own to judge them by."""
        return not self._stood or self.judged_us > 0

    @property
    def remark(self) -> str | None:
        """What is no fault of the streams, and is behind what they do."""
        said = [STANDS] if self._stood and self.tells else []
        if self._pauses:
            times = "once" if self._pauses == 1 else f"{self._pauses} times"
            said.append(f"the receiver paused {times}, {self._paused_us * 1e-6:.1f} s in all")
        said += [
            f"{one[0]},{one[1]} and {other[0]},{other[1]} undo each other's rates"
            for one, other in sorted(self._at_odds)
        ]
        return "; ".join(said) or None

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

    def _follow(self, messages: Messages, heard: HeardFrames, wishes: list[RateRequest], ballot: Ballot) -> None:
        n = len(messages.t_us)
        if n or len(heard):
            follow(
                messages,
                Frames(heard.frame_index, heard.heard_us, heard.transfer, heard.restarting),
                _requests(wishes) if wishes else _NO_REQUESTS,
                self._streams,
                self._vehicle,
                self._places(ballot),
                # Of frames that carry no time only the first one that finds a silence changes an alarm.
                ballot.votes(5 * n + 2 * (n + 1)),
                self._watching(n),
            )

    def why_not(self) -> str:
        """Why nothing was judged."""
        return STANDS if self._stood else "neither ATTITUDE nor ATTITUDE_QUATERNION was received"


def _requests(wishes: list[RateRequest]) -> Requests:
    """Of each stream that was meant."""
    rows = [
        (wish.frame_index, stream, math.nan if wish.rate_hz is None else wish.rate_hz)
        for wish in wishes
        for stream in wish.streams
    ]
    frame_index, stream, rate_hz = zip(*rows, strict=True)
    return Requests(np.array(frame_index, np.int64), np.array(stream, np.int64), np.array(rate_hz, np.float64))


_NONE = np.empty(0, np.int64)
_NO_REQUESTS = Requests(_NONE, _NONE, np.empty(0))
_NO_MESSAGES = Messages(*(_NONE,) * 7, np.empty((0, 3)), np.empty((0, 4)), np.empty((0, 4)))
