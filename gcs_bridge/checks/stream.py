"""The two attitude streams themselves: silent while the vehicle is heard, frozen, slow, or without numbers."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from statistics import median
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from msgspec.structs import replace

from gcs_bridge import attitude
from gcs_bridge.alarms.rated import Rated
from gcs_bridge.alarms.spec import AlarmSpec
from gcs_bridge.alarms.votes import Ballot
from gcs_bridge.checks.base import Check, rated
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.columns import Floats, Int64s, Mask, RunningMax, last_where
from gcs_bridge.settings import AlarmSettings, StreamSettings
from gcs_bridge.telemetry.samples import STREAMS, AttitudeSamples, finite
from gcs_bridge.telemetry.statements import ParameterSet
from gcs_bridge.telemetry.stream_liveness import StreamChange

_WINDOWS = 24  # of the own rate, whose median is the usual one
_LEAST_WINDOWS = 3
_HEARD_US = 1_000_000  # of the time between two of the vehicle's messages, what it counts as heard
_LOSS_MESSAGES = 256  # timed messages over which the loss is taken
_NEVER = 1e-7  # probability with which a silence is by chance
_MOST_PERIODS = 20.0  # that a silence needs, however much was lost
_TRANSFER_HZ = 2.0
_TRANSFER = 3  # parameters in one window: ArduPilot slows its streams while it sends them


class _Stream:
    """What is followed of one stream within one boot."""

    def __init__(self, settings: StreamSettings) -> None:
        self._settings = settings
        self._window_us = round(settings.slow_after_s * 1e6)
        self._last: Floats | None = None  # the last sample's numbers
        self._run_us = 0  # since when the numbers are the same
        self._other_at_run: Floats = np.full(4, np.nan)
        self._fresh = False  # whether the last sample's numbers were new
        self._other: Floats = np.full(4, np.nan)
        self._latest_us = RunningMax()
        self._window: tuple[int, int] | None = None  # time and frame_index at its beginning
        self._count = 0
        self._whole = True
        self._rates: deque[int] = deque(maxlen=_WINDOWS)
        self.period_us = -1
        self._timed_us = RunningMax()  # of the vehicle's latest timed message
        self._heard_us = 0  # time so far in which the vehicle was heard
        self._heard_last_us, self._ordinal_last = -1, -1  # the same at the stream's last sample

    def silent(
        self, k: int, batch: CheckBatch, least_periods: Floats, transfers: Int64s, delays: AlarmSettings
    ) -> Rated:
        """How long the stream has been silent at each timed message, in time in which the vehicle was heard.

        A silence of the whole vehicle is none of the stream; nor is one while parameters are sent.
        """
        line = batch.line
        since_us = np.diff(self._timed_us.feed(line.t_boot_us))
        heard = np.cumsum(np.concatenate(([self._heard_us], np.minimum(since_us, _HEARD_US))))[1:]
        last = last_where(line.stream == k)
        at_last, ordinal_at_last = (
            np.append(heard, self._heard_last_us),
            np.append(line.frame_index, self._ordinal_last),
        )
        silent_us = heard - at_last[last]
        known = last_where((line.stream == k) & (line.period_us >= 0))
        period_us = np.append(line.period_us, self.period_us)[known]
        sent = np.searchsorted(transfers, line.frame_index) - np.searchsorted(transfers, ordinal_at_last[last])
        transfer = (sent >= _TRANSFER) & (sent >= _TRANSFER_HZ * silent_us * 1e-6)
        usable = (at_last[last] >= 0) & (period_us >= 0) & ~transfer
        limit_us = np.maximum(self._settings.stale_after_s * 1e6, least_periods * period_us)
        if len(heard):
            self._heard_us = int(heard[-1])
            self._heard_last_us, self._ordinal_last = int(at_last[last[-1]]), int(ordinal_at_last[last[-1]])
            self.period_us = int(period_us[-1])
        value = np.where(usable, silent_us, 0) * 1e-6
        on_line = rated(line.t_boot_us, line.frame_index, value, np.maximum(limit_us, 1.0) * 1e-6, delays)
        silences = _silences(batch.stream_changes, k)
        return on_line if not silences else Rated.in_arrival((on_line, _at_deadlines(silences, delays)))

    def frozen(self, samples: AttitudeSamples, other: AttitudeSamples) -> tuple[Floats, Mask]:
        """For how long, s, each sample's numbers have been the same; and whether the other stream moved meanwhile."""
        numbers = np.ascontiguousarray(samples.q_nb if samples.rpy_rad is None else samples.rpy_rad)
        seen = np.concatenate((self._other[None], other.q_nb))
        beside = seen[
            np.searchsorted(other.frame_index, samples.frame_index)
        ]  # the other stream's latest, at each sample
        last = np.full(numbers.shape[1], np.nan) if self._last is None else self._last
        before = np.concatenate((last[None], numbers))[:-1]
        differs = numbers != before  # NaN differs from itself, and is no frozen attitude
        changed = np.logical_or.reduce([differs[:, column] for column in range(differs.shape[1])])
        start = last_where(changed)
        run_us = np.where(start >= 0, samples.t_boot_us[start], self._run_us)
        # The other stream's attitude counts from the first repetition on: at the change it may be the one from before.
        repeats = ~changed & np.concatenate(([self._fresh], changed[:-1]))
        first = last_where(repeats)
        at_run = np.where((first >= 0)[:, None], beside[first], self._other_at_run)
        self._run_us, self._other_at_run, self._fresh = int(run_us[-1]), at_run[-1], bool(changed[-1])
        self._last = numbers[-1]
        same_s = (samples.t_boot_us - run_us) * 1e-6
        moved = np.zeros(len(numbers), np.bool_)
        rows = np.flatnonzero(same_s >= self._settings.frozen_after_s)
        if len(rows):
            moved[rows] = attitude.angle_between(at_run[rows], beside[rows]) > self._settings.moved_rad
        return np.asarray(same_s), moved

    def hear_other(self, other: AttitudeSamples) -> None:
        """Remember the other stream's last attitude."""
        if len(other):
            self._other = other.q_nb[-1]

    def slow(self, samples: AttitudeSamples, transfers: Int64s) -> Iterator[tuple[int, int, float]]:
        """Time, frame and share of the usual rate, at the end of each window without a silence."""
        frame_index = samples.frame_index
        if self._window is None:
            self._window = (int(samples.t_boot_us[0]), int(frame_index[0]))
        latest = self._latest_us.feed(samples.t_boot_us)
        silent = np.diff(latest) > self._settings.stale_after_s * 1e6
        begin = 0
        while True:
            end = int(np.searchsorted(latest[1:], self._window[0] + self._window_us))
            self._count += end - begin
            self._whole &= not silent[begin : end + 1].any()
            if end == len(frame_index):
                return
            t_us, at = int(latest[end + 1]), int(frame_index[end])
            sent = np.searchsorted(transfers, at) - np.searchsorted(transfers, self._window[1])
            if self._whole and sent < _TRANSFER:
                if len(self._rates) >= _LEAST_WINDOWS:
                    yield t_us, at, self._count / max(median(self._rates), 1)
                self._rates.append(self._count)
            self._window, self._count, self._whole, begin = (t_us, at), 0, True, end


def _silences(turns: list[StreamChange], stream: int) -> list[StreamChange]:
    """Where no timed message came, although the vehicle was heard."""
    return [turn for turn in turns if turn.stream == stream and turn.what == "silent"]


def _at_deadlines(silences: list[StreamChange], delays: AlarmSettings) -> Rated:
    """Silences, each bad at its deadline."""
    t_us = np.array([turn.t_boot_us for turn in silences], np.int64)
    silent_s = np.array([turn.silent_us * 1e-6 for turn in silences])
    return rated(t_us, np.array([turn.frame_index for turn in silences], np.int64), silent_s, 0.0, delays)


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

    def __init__(self, settings: StreamSettings, delays: AlarmSettings) -> None:
        """Start with nothing judged."""
        super().__init__()
        self._settings = settings
        self._delays = delays
        self._at_once = replace(delays, bad_samples=1, counted_samples=1, on_delay_s=0.0)
        self._alarms = tuple(self._alarms_of(name) for name in STREAMS)
        self.alarm_specs = tuple(spec for alarms in self._alarms for spec in alarms)
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

    def start_boot(self) -> None:
        """Forget what counts within one boot alone."""
        super().start_boot()
        self._start()

    def _start(self) -> None:
        self._streams = tuple(_Stream(self._settings) for _ in STREAMS)
        self._heard_us = RunningMax()
        self._transfers: Int64s = np.empty(0, np.int64)
        self._frames: tuple[Int64s, Int64s] = np.empty(0, np.int64), np.empty(0, np.int64)

    def judge(self, batch: CheckBatch, ballot: Ballot) -> None:
        """Rate what came, and what did not."""
        sides = (batch.euler, batch.quaternion)
        sent = [say.frame_index for say in batch.statements if isinstance(say, ParameterSet)]
        self._transfers = np.concatenate((self._transfers, np.array(sent, np.int64)))[-1000:]
        least = self._least_periods(batch)
        for k, (alarms, stream) in enumerate(zip(self._alarms, self._streams, strict=True)):
            samples, frame_index = sides[k], sides[k].frame_index
            ballot.rate(alarms.silent, stream.silent(k, batch, least, self._transfers, self._at_once))
            if len(samples):
                same_s, moved = stream.frozen(samples, sides[1 - k])
                value = np.where(moved, same_s, 0.0)
                frozen = rated(
                    samples.t_boot_us, frame_index, value, self._settings.frozen_after_s * 0.999, self._at_once
                )
                ballot.rate(alarms.frozen, frozen)
                invalid = np.where(finite(samples.q_nb), 0.0, 1.0)
                ballot.rate(alarms.invalid, rated(samples.t_boot_us, frame_index, invalid, 0.5, self._delays))
                windows = np.array(list(stream.slow(samples, self._transfers))).reshape(-1, 3)
                share = 1.0 / np.maximum(windows[:, 2], 1e-3)
                at = windows[:, 1].astype(np.int64)
                slow = rated(windows[:, 0].astype(np.int64), at, share, 1.0 / self._settings.slow_below, self._at_once)
                ballot.rate(alarms.slow, slow)
            stream.hear_other(sides[1 - k])
        arrival = np.argsort(np.concatenate([samples.frame_index for samples in sides]), kind="stable")
        t_us = np.concatenate([samples.t_boot_us for samples in sides])[arrival]
        self._watch_streams(t_us)

    def _watch_streams(self, t_us: Int64s) -> None:
        """Every sample is judged; the report's numbers are the intervals between them, of both streams together."""
        if len(t_us):
            self._watch(t_us, np.diff(self._heard_us.feed(t_us)) * 1e-6, np.ones(len(t_us), np.bool_))

    def silent(self, turns: list[StreamChange], ballot: Ballot) -> None:
        """Rate silences that were found on receive time, while no timed message came."""
        for k, alarms in enumerate(self._alarms):
            found = _silences(turns, k)
            if found:
                ballot.rate(alarms.silent, _at_deadlines(found, self._at_once))

    def _least_periods(self, batch: CheckBatch) -> Floats:
        """How many periods of silence mean something, by the share of the vehicle's frames that was lost of late."""
        lost, received = (
            np.concatenate((before, now))
            for before, now in zip(self._frames, (batch.line.lost, batch.line.received), strict=True)
        )
        row = np.arange(len(self._frames[0]), len(lost))
        since = np.maximum(row - _LOSS_MESSAGES, 0)
        missing, came = lost[row] - lost[since], received[row] - received[since]
        self._frames = lost[-_LOSS_MESSAGES:], received[-_LOSS_MESSAGES:]
        share = np.clip(missing / np.maximum(missing + came, 1), 1e-3, 0.9)
        periods = np.minimum(np.log(_NEVER) / np.log(share), _MOST_PERIODS)
        return np.asarray(np.maximum(self._settings.stale_periods, periods))

    def why_not(self) -> str:
        """Why nothing was judged."""
        return "neither ATTITUDE nor ATTITUDE_QUATERNION was received"
