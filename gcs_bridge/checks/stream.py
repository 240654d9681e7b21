"""The two attitude streams themselves: silent while the vehicle is heard, frozen, slow, or without numbers.

What each message and frame tells of that, `stream_following` finds. A stream that was switched off is silent all the
same, whoever wanted it.
"""

from __future__ import annotations

import math
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from msgspec.structs import replace

from gcs_bridge.alarms.ballot import Ballot
from gcs_bridge.alarms.rated import Rated
from gcs_bridge.alarms.spec import AlarmSpec
from gcs_bridge.checks.base import NO_DETAIL, Check
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.checks.stream_following import STREAM, VEHICLE, Frames, Messages, Requests, Slowdowns, follow
from gcs_bridge.columns import Int64s
from gcs_bridge.settings import AlarmSettings, StreamSettings
from gcs_bridge.telemetry.heard import HeardFrames
from gcs_bridge.telemetry.others import OfOthers
from gcs_bridge.telemetry.radio_flow import Slowdown
from gcs_bridge.telemetry.rate_requests import Address, RateChange, RateRequest
from gcs_bridge.telemetry.samples import STREAMS
from gcs_bridge.telemetry.senders import SenderSign

_FROZEN_SHARE = 0.999  # of the time after which a stream is frozen: with that very sample it is
TWO_SENDERS = "two senders use"
"""What the alarms of two senders begin with."""
STANDS = "the clock stands still: samples come with one and the same time"


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
        self._radios: set[Address] = set()  # that made streams slower
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
                f"{name} invalid", "alarm", f"{name} carries NaN or infinity", self._delays, unit=""
            ),
            slow=self._alarm_spec(f"{name} slow", "warning", slow, at_once, unit="1"),
        )

    def _alarms_of_senders(self, identity: str) -> tuple[AlarmSpec, AlarmSpec]:
        """Of SENDERS and of VERSIONS: what has been seen time and again needs no further delay."""
        two = f"{TWO_SENDERS} {identity}: clocks, attitudes or heartbeats of both come in turn"
        beside = f"{TWO_SENDERS} {identity}: MAVLink 1 and 2 come in turn, numbered apart, and one without an attitude"
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
        self._streams, self._vehicle = np.zeros(2, STREAM), np.zeros(1, VEHICLE)
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
        self._follow(messages, batch.heard, batch.said_by_others, ballot)

    def hear(self, heard: HeardFrames, said: list[OfOthers], ballot: Ballot) -> None:
        """Take frames behind the last message with a time, and what others said meanwhile."""
        self._follow(_NO_MESSAGES, heard, said, ballot)

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
        if self._radios:
            radios = " and ".join(f"{sysid},{compid}" for sysid, compid in sorted(self._radios))
            said.append(f"a radio, {radios}, ran out of buffer, for which autopilots slow their streams")
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

    def _follow(self, messages: Messages, heard: HeardFrames, said: list[OfOthers], ballot: Ballot) -> None:
        n = len(messages.t_us)
        wishes: list[RateRequest] = []
        slowdowns: list[Slowdown] = []
        for one in said:
            if isinstance(one, Slowdown):
                slowdowns.append(one)
                self._radios |= {one.by} if one.slowed else set()
            else:
                wishes.append(one)
        if n or len(heard):
            follow(
                messages,
                Frames(heard.frame_index, heard.heard_us, heard.transfer, heard.restarting),
                _requests(wishes) if wishes else _NO_REQUESTS,
                _slowdowns(slowdowns) if slowdowns else _NO_SLOWDOWNS,
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


def _slowdowns(told: list[Slowdown]) -> Slowdowns:
    frame_index, _, slowed, longer_us = zip(*told, strict=True)
    return Slowdowns(np.array(frame_index, np.int64), np.array(slowed, np.bool_), np.array(longer_us, np.int64))


_NONE = np.empty(0, np.int64)
_NO_SLOWDOWNS = Slowdowns(_NONE, np.empty(0, np.bool_), _NONE)
_NO_REQUESTS = Requests(_NONE, _NONE, np.empty(0))
_NO_MESSAGES = Messages(*(_NONE,) * 7, np.empty((0, 3)), np.empty((0, 4)), np.empty((0, 4)))
