"""Whether one sender uses an identity, or several: clocks, attitudes, heartbeats or versions that alternate.

One sender goes on where it was. Where two send under one (system, component), the messages go back and forth between
two of each, and *each goes on where it was left*. That, time and again, is the sign; a step, a reboot, frames that come
late or are lost lead nowhere back. One vehicle that is heard twice has one clock and one attitude. Frames that are
numbered apart are no sign by themselves: a vehicle numbers them apart on each of its ports.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from gcs_bridge.attitude.euler import quaternion_of_rpy
from gcs_bridge.attitude.quaternion import length
from gcs_bridge.columns import Floats, Int64Rows, Int64s, Records
from gcs_bridge.jit import helper, kernel
from gcs_bridge.mavlink.decode import float_in, offsets, place_of, unsigned_in
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.scan import Bytes, Frames
from gcs_bridge.telemetry.attitude_tracks import (
    SHAKEN_RAD_S2,
    SUDDEN_RAD_S2,
    off_rad,
    reach_rad,
    surely_reaches,
    turn_rad,
)
from gcs_bridge.telemetry.attitudes import NORM_TOLERANCE
from gcs_bridge.telemetry.messages import KIND
from gcs_bridge.telemetry.samples import ATTITUDE, ATTITUDE_QUATERNION
from gcs_bridge.telemetry.sorting import Kinds, Share, SortedFrames

_EULER, _QUATERNION = KIND[ATTITUDE], KIND[ATTITUDE_QUATERNION]
_TIME, _BEAT = KIND["SYSTEM_TIME"], KIND["HEARTBEAT"]
_CLOCKED = 3  # messages whose clock is followed: kinds 0 to 2

_TRACKS = 4  # senders that are told apart
_CALM_US = 4_000_000  # so long it is told that it is over: longer than alarms take to go

# Clocks. Those of one vehicle are one; frames that come late were sent by it up to 6 s before (see clocks).
_APART_US = 6_000_000
_CLOCKS = 10  # times back and forth, while both boots last
_OVERLAP_US = 5_000_000  # messages of the boot before, that waited in a queue, were sent before the next one began
_NEAR_US = 1_000_000  # clocks nearer than this are one: what two paths of one link differ by
_STEADY_US = 150_000  # two clocks less than 6 s apart stay so far apart; a queue that drains does not
_STEADY_CLOCKS = 30

# Attitudes.
_LIVE_S = 2.5  # an attitude that is older is compared with nothing
_THERE_SHARE = 1 / 5  # of the way from the one, how near to the other's last attitude is back there
_THERE_RAD = np.radians(1.0)
_WHOLE_TURN_RAD = 2 * np.pi  # no angle in radians is larger
_ATTITUDES, _CALM_ATTITUDES = 8, 20  # times back and forth, farther than shaken, than sudden turns
_CLEAN = 0.75  # at least so many times as often as to anywhere else: one that is slow is found anew each time

_KINDS, _MODES = 4, 12  # heartbeats: times back and forth between two types or autopilots, between two modes
_VERSIONS = 20  # times back and forth between MAVLink 1 and 2, each numbered apart
_LOST = 8  # frames in a row that may be missing
_V1 = 0xFE

SENDERS, VERSIONS = range(2)  # what is told: two senders; frames of another version, under which no attitude comes
_OF_CLOCKS, _OF_STEADY_CLOCKS, _OF_ATTITUDES, _OF_CALM_ATTITUDES, _OF_KINDS, _OF_MODES, _OF_VERSIONS = range(7)
_SIGNS = 7
_NEEDED = np.array([_CLOCKS, _STEADY_CLOCKS, _ATTITUDES, _CALM_ATTITUDES, _KINDS, _MODES, _VERSIONS])
# Without a sign for so long, those before count no more. Modes may be changed back and forth, but not with each beat.
_IDLE_US = np.array([10_000_000, 10_000_000, 10_000_000, 10_000_000, 10_000_000, 2_500_000, 10_000_000])
_LONG_AGO = -(2**62)
_MANY = 100  # times that are told; more are as many

_STATE = np.dtype(
    [
        ("now_us", "i8"),
        ("latest_ms", "i8"),
        # How often each sign was seen, when last, and how often something else was.
        ("times", "i8", (_SIGNS,)),
        ("seen_us", "i8", (_SIGNS,)),
        ("misses", "i8", (_SIGNS,)),
        # Clocks of each timed message, as a vehicle may stamp two by two clocks: their tracks, message by message,
        # which of them goes on, and how far apart the steady ones are.
        ("ms", "i8", (_CLOCKED * _TRACKS,)),  # −1: none
        ("heard_us", "i8", (_CLOCKED * _TRACKS,)),
        ("began_us", "i8", (_CLOCKED * _TRACKS,)),  # receive time at which it was zero, at most; −1: unknown
        ("first_ms", "i8", (_CLOCKED * _TRACKS,)),
        ("clock", "i8", (_CLOCKED,)),
        ("apart_us", "i8"),
        # Attitudes of both streams: which track goes on.
        ("attitude", "i8", (2,)),
        # Heartbeats: the two last ones, and which of them came last; of their types, of their modes.
        ("said", "i8", (4,)),
        ("says", "i8", (2,)),
        # MAVLink 1 and 2: the last frame's number of each, which came last, and how many attitudes came in each.
        ("seq", "i8", (2,)),
        ("attitudes", "i8", (2,)),
        ("version", "i8"),
        # What was told.
        ("new", "i8", (2,)),
        ("told", "i8", (2,)),
        ("calm_us", "i8", (2,)),
    ]
)


class SenderSign(NamedTuple):
    """With a frame: how often it went back and forth (0: not any more), of SENDERS or of VERSIONS."""

    frame_index: int
    what: int
    times: int


@helper
def _count(state: Any, sign: Any) -> Any:
    """Once more it went back to where it had been."""
    if abs(state.now_us - state.seen_us[sign]) > _IDLE_US[sign]:
        state.times[sign] = state.misses[sign] = 0
    state.times[sign] += 1
    state.seen_us[sign] = state.now_us
    state.new[1 if sign == _OF_VERSIONS else 0] = 1


@helper
def _fits(state: Any, track: Any, ms: Any) -> Any:
    """Whether a clock goes on with this time."""
    if state.ms[track] < 0:
        return False
    step_us = (ms - state.ms[track]) * 1000
    elapsed_us = max(state.now_us - state.heard_us[track], 0)
    return -_NEAR_US <= step_us <= _NEAR_US + elapsed_us + elapsed_us // 2


@helper
def _follow_clock(state: Any, message: Any, ms: Any, rx_us: Any) -> Any:
    """Take the next time of a message."""
    since = message * _TRACKS
    on = since + state.clock[message]
    track = on
    if not _fits(state, on, ms):
        oldest = since
        for other in range(since, since + _TRACKS):
            if _fits(state, other, ms):
                track = other
            if state.heard_us[other] < state.heard_us[oldest]:
                oldest = other
        if track == on:
            track = oldest
            state.ms[track], state.first_ms[track], state.began_us[track] = ms, ms, -1
        else:
            _count_clocks(state, on, track, ms)
    state.clock[message] = track - since
    state.ms[track] = max(state.ms[track], ms)
    state.heard_us[track] = state.now_us
    if rx_us >= 0:
        began_us = rx_us - ms * 1000
        state.began_us[track] = began_us if state.began_us[track] == -1 else min(state.began_us[track], began_us)


@helper
def _count_clocks(state: Any, left: Any, track: Any, ms: Any) -> Any:
    """It went from one clock back to another: see how far they are apart, and whether they last together."""
    there_us = state.ms[left] * 1000 + max(state.now_us - state.heard_us[left], 0)
    apart_us = there_us - ms * 1000
    if abs(apart_us) > _APART_US:
        older, younger = (track, left) if apart_us < 0 else (left, track)
        if state.began_us[older] != -1 and state.began_us[younger] != -1:
            overlap_us = state.ms[older] * 1000 + state.began_us[older] - state.began_us[younger]
        else:
            overlap_us = (
                min(state.ms[older] - state.first_ms[older], state.ms[younger] - state.first_ms[younger]) * 1000
            )
        _count(state, _OF_CLOCKS)
        if overlap_us < _OVERLAP_US:
            state.times[_OF_CLOCKS] = min(state.times[_OF_CLOCKS], _CLOCKS - 1)
    elif abs(apart_us) > _NEAR_US:
        if abs(abs(apart_us) - state.apart_us) > _STEADY_US:
            state.times[_OF_STEADY_CLOCKS], state.apart_us = 0, abs(apart_us)
        _count(state, _OF_STEADY_CLOCKS)


@helper
def _goes_on_alone(mine: Any, on: Any, q: Any, w: Any, ms: Any) -> Any:
    """Whether a stream's track goes on with an attitude, and no other one is there: so it nearly always is."""
    for track in range(_TRACKS):
        if (abs(ms - mine[track, 7]) <= _LIVE_S * 1000) != (track == on):
            return False
    return surely_reaches(mine[on], q, w, ms)


@helper
def _follow_attitude(state: Any, tracks: Any, stream: Any, q: Any, w: Any, ms: Any) -> Any:
    """Take the next attitude of a stream. Rows of `tracks`: q, body rates, time; all NaN where there is none."""
    mine, on = tracks[stream], state.attitude[stream]
    best = on if _goes_on_alone(mine, on, q, w, ms) else _track_of(state, mine, stream, q, w, ms)
    state.attitude[stream] = best
    row = mine[best]
    row[0], row[1], row[2], row[3] = q
    row[4], row[5], row[6] = w
    row[7] = ms


@helper
def _track_of(state: Any, mine: Any, stream: Any, q: Any, w: Any, ms: Any) -> Any:
    """The track that an attitude belongs to; what it tells of the senders is counted."""
    on = state.attitude[stream]
    best, free, least_rad = -1, on, np.inf
    for track in range(_TRACKS):
        if abs(ms - mine[track, 7]) <= _LIVE_S * 1000:
            track_rad = off_rad(mine[track], q, w, ms)
            if track_rad < least_rad:
                best, least_rad = track, track_rad
        if free == on or (not np.isnan(mine[free, 7]) and not mine[track, 7] >= mine[free, 7]):
            free = track  # the one left longest ago, or that was never taken
    is_live = abs(ms - mine[on, 7]) <= _LIVE_S * 1000
    away_rad = turn_rad(mine[on], q)
    if best < 0:
        best = free
    elif is_live and not away_rad <= reach_rad(mine[on], w, ms, SUDDEN_RAD_S2):
        if best != on and least_rad <= max(_THERE_RAD, _THERE_SHARE * away_rad):
            if away_rad > reach_rad(mine[on], w, ms, SHAKEN_RAD_S2):
                _count(state, _OF_ATTITUDES)
            if least_rad <= _THERE_RAD:
                _count(state, _OF_CALM_ATTITUDES)
        else:
            best = free
            state.misses[_OF_ATTITUDES] += 1
            state.misses[_OF_CALM_ATTITUDES] += 1
    return best


@helper
def _follow_said(state: Any, place: Any, sign: Any, said: Any) -> Any:
    """Take what the next heartbeat says, as a number; the two things said last are in 2·place and behind it."""
    here = 2 * place + state.says[place]
    there = 2 * place + 1 - state.says[place]
    if said == state.said[here]:
        return
    if said == state.said[there]:
        _count(state, sign)
    else:
        state.said[there] = said
    state.says[place] = 1 - state.says[place]


@helper
def _follow_version(state: Any, version: Any, seq: Any, attitude: Any) -> Any:
    """Take the next frame's version, 0 or 1, and number; `attitude`: whether it carries one."""
    if version != state.version and state.seq[version] >= 0:
        ahead, ahead_of_other = (seq - state.seq[version]) & 0xFF, (seq - state.seq[1 - version]) & 0xFF
        if 0 < ahead <= _LOST and not 0 < ahead_of_other <= _LOST:
            _count(state, _OF_VERSIONS)
        else:
            state.misses[_OF_VERSIONS] += 1
    state.version, state.seq[version] = version, seq
    state.attitudes[version] += attitude


@helper
def _stands(state: Any, sign: Any) -> Any:
    """Whether a sign was seen often enough, of late."""
    if state.times[sign] < _NEEDED[sign] or abs(state.now_us - state.seen_us[sign]) > _IDLE_US[sign]:
        return False
    if sign == _OF_VERSIONS:
        first, second = state.attitudes
        if (first > 0) == (second > 0):
            return False
    return state.times[sign] >= _CLEAN * state.misses[sign]


@helper
def _version(frame: Any, buffer: Any) -> Any:
    """0 of a frame of MAVLink 1, 1 of MAVLink 2: the latter's header is longer, and numbered at another place."""
    if frame.payload < 6 or buffer[frame.payload - 6] != _V1:
        return 1
    is_first = buffer[frame.payload - 4] == frame.seq and buffer[frame.payload - 3] == frame.sysid
    return 0 if is_first and buffer[frame.payload - 2] == frame.compid else 1


@helper
def _tell(state: Any, what: Any, frame_index: Any, signs: Any, n: Any) -> Any:
    """Put down what is to be told with an attitude's frame; how many signs there are then."""
    times = 0
    for sign in range(_SIGNS):
        if (sign == _OF_VERSIONS) == (what == 1) and _stands(state, sign):
            times = max(times, state.times[sign])
    if times:
        state.told[what], state.calm_us[what] = 1, -1
        if not state.new[what]:
            return n
    elif state.told[what]:
        if state.calm_us[what] < 0:
            state.calm_us[what] = state.now_us
        state.told[what] = abs(state.now_us - state.calm_us[what]) <= _CALM_US
    else:
        return n
    state.new[what] = 0
    signs[n, 0], signs[n, 1], signs[n, 2] = frame_index, what, min(times, _MANY)
    return n + 1


@kernel
def _follow(
    states: Annotated[Records, _STATE],
    tracks: Annotated[Floats, 3],
    frames: Frames,
    buffer: Bytes,
    kind: Kinds,
    arrival: Int64s,
    start: int,
    end: int,
    first: int,
    euler_at: Int64s,
    quaternion_at: Int64s,
    time_at: int,
    beat_at: Int64s,
    signs: Int64Rows,
) -> int:
    """Follow a component's frames; return how many `signs` of more than one sender there are to be told."""
    state, n = states[0], 0
    for i in range(start, end):
        row = arrival[i]
        frame, what = frames[row], np.int64(kind[row])
        is_attitude = what in (_EULER, _QUATERNION)
        state.now_us = frame.t_rx_us if frame.t_rx_us >= 0 else state.latest_ms * 1000
        _follow_version(state, _version(frame, buffer), np.int64(frame.seq), np.int64(is_attitude))
        if not (is_attitude or what in (_TIME, _BEAT)):
            continue
        payload = (buffer, np.int64(frame.payload), np.int64(frame.length))
        if what == _BEAT:
            autopilot, vehicle = unsigned_in(payload, beat_at[0], 1), unsigned_in(payload, beat_at[1], 1)
            mode = unsigned_in(payload, beat_at[3], 4) * 2 + (unsigned_in(payload, beat_at[2], 1) >> 7)
            _follow_said(state, 0, _OF_KINDS, autopilot * 256 + vehicle)
            _follow_said(state, 1, _OF_MODES, mode)
            continue
        at = euler_at if what == _EULER else quaternion_at
        ms = unsigned_in(payload, at[0] if is_attitude else time_at, 4)
        state.latest_ms = ms
        _follow_clock(state, what, ms, frame.t_rx_us)
        if not is_attitude:
            continue
        if what == _EULER:
            roll, pitch, yaw = float_in(payload, at[4]), float_in(payload, at[5]), float_in(payload, at[6])
            q = quaternion_of_rpy(roll, pitch, yaw)
            if max(abs(roll), abs(pitch), abs(yaw)) > _WHOLE_TURN_RAD:  # degrees: small motions go round and round
                state.times[_OF_ATTITUDES] = state.times[_OF_CALM_ATTITUDES] = 0
        else:
            q = (
                float_in(payload, at[4]), float_in(payload, at[5]), float_in(payload, at[6]), float_in(payload, at[7]),
            )  # fmt: skip
        w = float_in(payload, at[1]), float_in(payload, at[2]), float_in(payload, at[3])
        norm = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
        if abs(norm - 1.0) <= NORM_TOLERANCE and np.isfinite(length(w)):
            _follow_attitude(state, tracks, what, q, w, ms)
        n = _tell(state, SENDERS, first + row, signs, n)
        n = _tell(state, VERSIONS, first + row, signs, n)
    return n


class Senders:
    """Of one (system, component): followed from frame to frame, in order of arrival."""

    def __init__(self, dialect: Dialect) -> None:
        """Start with nothing heard."""
        rates = ("rollspeed", "pitchspeed", "yawspeed")
        self._euler_at = offsets(dialect[ATTITUDE], "time_boot_ms", *rates, "roll", "pitch", "yaw")
        self._quaternion_at = offsets(dialect[ATTITUDE_QUATERNION], "time_boot_ms", *rates, "q1", "q2", "q3", "q4")
        self._time_at = place_of(dialect["SYSTEM_TIME"], "time_boot_ms")[0]
        self._beat_at = offsets(dialect["HEARTBEAT"], "autopilot", "type", "base_mode", "custom_mode")
        self._state = np.zeros(1, _STATE)
        for name in ("ms", "began_us", "first_ms", "said", "seq", "calm_us"):
            self._state[name] = -1
        self._state["seen_us"] = self._state["heard_us"] = _LONG_AGO
        self._tracks = np.full((2, _TRACKS, 8), np.nan)

    def read(self, batch: SortedFrames, share: Share) -> list[SenderSign]:
        """Take a component's next frames; what they say of its senders, each with the frame of an attitude."""
        signs = np.empty((2 * (share.counts[_EULER] + share.counts[_QUATERNION]), 3), np.int64)
        n = _follow(
            self._state,
            self._tracks,
            batch.frames,
            batch.buffer,
            batch.kind,
            batch.arrival,
            share.start,
            share.end,
            batch.first,
            self._euler_at,
            self._quaternion_at,
            self._time_at,
            self._beat_at,
            signs,
        )
        return [SenderSign(*sign) for sign in signs[:n].tolist()] if n else _NONE


_NONE: list[SenderSign] = []
