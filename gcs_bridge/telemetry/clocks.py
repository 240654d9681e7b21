"""A vehicle's boot clock: unwraps `time_boot_ms`, tells reboots from reordering, and doubts a time that stands alone.

Milliseconds since boot wrap after 49.7 days (a step of about −2³²), restart near zero with a reboot, and step back by a
few seconds where frames were reordered. Every rule looks at what came before and at nothing else, so a live link and a
recording, in pieces of any size, give the same times.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge.columns import Int64s, Mask
from gcs_bridge.jit import helper, kernel
from gcs_bridge.mavlink.decode import offsets, unsigned_in
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.scan import Bytes, Frames
from gcs_bridge.telemetry.messages import TIMED, UNTIMED
from gcs_bridge.telemetry.sorting import Kinds, Share, SortedFrames

WRAP_US = 2**32 * 1000
REORDER_US = 6_000_000  # seen: 4.7 s in a recording that is otherwise good
YOUNG_US = 15_000_000  # a boot this young that falls silent and comes back earlier was a restart, not reordered frames
YOUNG_REORDER_US = 500_000
RESTART_SILENCE_US = 1_000_000
JUMP_US = 60_000_000  # a longer step forward needs the receive time, or a second message, to be believed

_GOES_ON, _DOUBTED, _REBOOT, _STEP = range(4)  # what a message does to the clock
_NAMES = {_REBOOT: "reboot", _STEP: "clock_step"}
CLOCK = np.dtype(
    [
        ("boot", "i8"),
        ("latest_us", "i8"),  # latest believed time in this boot, −1: none
        ("epoch_us", "i8"),  # of the wraps so far
        ("rx_us", "i8"),
        ("doubted_us", "i8"),  # by its own milliseconds alone, −1: the last message was believed
        # Of the message that is doubted.
        ("message", "i8"),
        ("row", "i8"),  # in its batch, −1: that is over
        ("t_rx_us", "i8"),
        ("lost", "i8"),
        ("received", "i8"),
        ("in_window", "?"),
    ]
)


class ClockChange(NamedTuple):
    """Where a clock did something else than go on: the new time, how far it stepped, and the frame that showed it."""

    frame_index: int
    t_rx_us: int
    boot: int
    kind: str  # "reboot" or "clock_step"
    t_boot_us: int
    step_us: int


FRAME_INDEX, MESSAGE, ROW, BOOT, T_BOOT_US, T_RX_US, LOST, RECEIVED = range(8)


class TimedMessages(NamedTuple):
    """Messages with a believed boot time, in order of arrival; n of them.

    `columns` (8, n): FRAME_INDEX of the frame by which its time was believed; MESSAGE, index into TIMED; ROW of its own
    frame in the batch, −1 where it came with a batch before: its payload is `held`; BOOT, T_BOOT_US, T_RX_US; LOST,
    RECEIVED frames of the vehicle so far. `in_window` (n,). `before`: boot and boot time of the last one before these,
    time −1 if there is none.
    """

    columns: Int64s
    in_window: Mask
    before: tuple[int, int]
    held: Bytes


# Helpers of kernels carry no types: numba types them anew wherever they are compiled into one.


@helper
def _goes_on(clock, step_us, silence_us):  # type: ignore[no-untyped-def]  # typed by numba
    """Whether a step of the time needs no closer look: the common case."""
    if clock.doubted_us >= 0 or not -REORDER_US <= step_us <= JUMP_US:
        return False
    return clock.latest_us >= YOUNG_US or silence_us < RESTART_SILENCE_US or step_us >= -YOUNG_REORDER_US


@helper
def _read_time(clock, ms, rx_us):  # type: ignore[no-untyped-def]  # typed by numba
    """Take the next message: what it does to the clock, its time, how far that steps; the time of the one in doubt.

    The first message behind a reboot, or behind a jump, is not believed before a second one confirms it.
    """
    own_us = ms * 1000
    t_us = own_us + clock.epoch_us
    latest_us = clock.latest_us if clock.latest_us >= 0 else t_us
    if _goes_on(clock, t_us - latest_us, rx_us - clock.rx_us):
        clock.latest_us, clock.rx_us = max(latest_us, t_us), rx_us
        return _GOES_ON, t_us, t_us - latest_us, 0
    elapsed_us = rx_us - clock.rx_us if rx_us >= 0 and clock.rx_us >= 0 else 0
    furthest_us = max(JUMP_US, 2 * elapsed_us)
    if -REORDER_US <= t_us + WRAP_US - latest_us <= furthest_us:
        t_us += WRAP_US  # past the wrap; the epoch follows once this is believed
    elif clock.epoch_us and -REORDER_US <= t_us - WRAP_US - latest_us <= furthest_us:
        t_us -= WRAP_US  # from before the wrap, late
    step_us, first_us = t_us - latest_us, latest_us
    young = latest_us < YOUNG_US and elapsed_us >= RESTART_SILENCE_US
    said = _GOES_ON
    if not -(YOUNG_REORDER_US if young or clock.doubted_us >= 0 else REORDER_US) <= step_us <= furthest_us:
        if clock.doubted_us < 0 or not -REORDER_US <= own_us - clock.doubted_us <= JUMP_US:
            clock.doubted_us = own_us
            return _DOUBTED, t_us, step_us, 0
        said, first_us = _STEP, clock.doubted_us + t_us - own_us
        if step_us < 0:  # a second message from the past: the vehicle has started anew
            said, first_us, t_us = _REBOOT, clock.doubted_us, own_us
            clock.boot += 1
    clock.doubted_us, clock.rx_us = -1, rx_us
    clock.latest_us = max(first_us, t_us)
    clock.epoch_us = clock.latest_us // WRAP_US * WRAP_US
    return said, t_us, step_us, first_us


@helper
def _doubt(clock, frame, message, row, received, in_window):  # type: ignore[no-untyped-def]  # typed by numba
    """Keep what is to be known of a message, should it be believed after all."""
    clock.message, clock.row, clock.received, clock.in_window = message, row, received, in_window
    clock.t_rx_us, clock.lost = frame.t_rx_us, frame.lost


@helper
def _believe(timed, n, frame_index, message, row, boot, t_boot_us, t_rx_us, lost, received):  # type: ignore[no-untyped-def]  # typed by numba
    timed[FRAME_INDEX, n], timed[MESSAGE, n], timed[ROW, n], timed[BOOT, n] = frame_index, message, row, boot
    timed[T_BOOT_US, n], timed[T_RX_US, n], timed[LOST, n], timed[RECEIVED, n] = t_boot_us, t_rx_us, lost, received


@kernel
def _follow(
    clock: npt.NDArray[np.void],
    frames: Frames,
    buffer: Bytes,
    kind: Kinds,
    in_window: Mask,
    arrival: Int64s,
    start: int,
    end: int,
    first: int,
    offset: Int64s,
    came: int,
    timed: Int64s,
    inside: Mask,
    changes: Int64s,
) -> tuple[int, int, int]:
    """Read the timed ones of a component's frames, of which `came` came before; `first`: the index of frame 0.

    `offset`: where time_boot_ms begins in the payload of each kind. Return how many were believed, how often the clock
    changed, and which row is in doubt at the end, −1: none.
    """
    state = clock[0]
    n = n_changes = 0
    for i in range(start, end):
        row = arrival[i]
        message = np.int64(kind[row])
        if message >= UNTIMED:
            continue
        frame, received = frames[row], came + i - start
        ms = unsigned_in((buffer, frame.payload, frame.length), offset[message], 4)
        said, t_us, step_us, first_us = _read_time(state, ms, frame.t_rx_us)
        if said == _DOUBTED:
            _doubt(state, frame, message, row, received, in_window[row])
            continue
        if said != _GOES_ON:  # the one before is believed after all: it counts from now on
            inside[n] = state.in_window
            _believe(
                timed, n, first + row, state.message, state.row, state.boot, first_us, state.t_rx_us, state.lost,
                state.received,
            )  # fmt: skip
            n += 1
            changes[n_changes, 0], changes[n_changes, 1], changes[n_changes, 2] = first + row, frame.t_rx_us, state.boot
            changes[n_changes, 3], changes[n_changes, 4], changes[n_changes, 5] = said, first_us, step_us
            n_changes += 1
        inside[n] = in_window[row]
        _believe(timed, n, first + row, message, row, state.boot, t_us, frame.t_rx_us, frame.lost, received)
        n += 1
    doubted = state.row if state.doubted_us >= 0 else -1
    state.row = -1
    return n, n_changes, doubted


class BootClock:
    """The boot clock of one vehicle, fed with its timed messages in order of arrival."""

    def __init__(self, dialect: Dialect) -> None:
        """Start before the first message."""
        self._offset = _time_offsets(dialect)
        self._state = np.zeros(1, CLOCK)
        for name in ("latest_us", "doubted_us", "row"):
            self._state[name] = -1
        self._last = (0, -1)  # boot and boot time last believed
        self._held: Bytes | None = None  # the payload of the message that is doubted

    def read(self, batch: SortedFrames, share: Share, received: int) -> tuple[TimedMessages, list[ClockChange]]:
        """Take a component's next messages; `received`: how many frames of it came before.

        The first message behind a reboot, or behind a jump, is not believed before a second one confirms it: it comes
        with that one, or never.
        """
        before, held = self._last, self._held
        most = share.starts[UNTIMED] - share.start
        if not most:
            return TimedMessages(_NO_TIMES, _NO_MASK, before, _NO_BYTES), []
        most += held is not None
        timed, inside = np.empty((8, most), np.int64), np.empty(most, np.bool_)
        changes = np.empty((most // 2 + 1, 6), np.int64)
        n, n_changes, doubted = _follow(
            self._state,
            batch.frames,
            batch.buffer,
            batch.kind,
            batch.in_window,
            batch.arrival,
            share.start,
            share.end,
            batch.first,
            self._offset,
            received,
            timed,
            inside,
            changes,
        )
        self._held = None
        if doubted >= 0:
            frame = batch.frames[doubted]
            payload = batch.buffer[frame["payload"] : frame["payload"] + frame["length"]]
            self._held = np.append(payload, np.uint8(0))  # which may be empty
        if n < most:
            timed, inside = timed[:, :n].copy(), inside[:n]
        if n:
            self._last = int(timed[BOOT, -1]), int(timed[T_BOOT_US, -1])
        return TimedMessages(timed, inside, before, _NO_BYTES if held is None else held), [
            ClockChange(frame_index, t_rx_us, boot, _NAMES[kind], t_boot_us, step_us)
            for frame_index, t_rx_us, boot, kind, t_boot_us, step_us in changes[:n_changes].tolist()
        ]


@cache
def _time_offsets(dialect: Dialect) -> Int64s:
    """Where time_boot_ms begins in the payload of each of TIMED, as far as the dialect has them."""
    return np.array([offsets(dialect[name], "time_boot_ms")[0] if name in dialect else 0 for name in TIMED], np.int64)


_NO_BYTES: Bytes = np.empty(0, np.uint8)
_NO_TIMES: Int64s = np.empty((8, 0), np.int64)
_NO_MASK: Mask = np.empty(0, np.bool_)
OFFSET = np.dtype(
    [
        ("boot", "i8"),
        ("known", "?"),  # whether a message came within this boot
        ("same", "?"),  # whether it is the boot clock
        ("ahead_us", "i8"),  # of the boot clock, at most
    ]
)
SAME_CLOCK_US = 1_000_000


@helper
def on_boot_clock(offset, boot, t_us, latest_us):  # type: ignore[no-untyped-def]  # typed by numba
    """The boot time, µs, of a message at `t_us` on its own clock (`time_usec`), when the boot clock said `latest_us`.

    A clock that is near the boot clock at first is the boot clock: others count from 1970, or from a start seconds to
    hours away. Of these the smallest offset is the nearest to the true one, as no message is heard before its stamp.
    """
    ahead_us = latest_us - t_us
    if not offset.known or offset.boot != boot:
        offset.known, offset.boot = True, boot
        offset.same, offset.ahead_us = abs(ahead_us) < SAME_CLOCK_US, ahead_us
    offset.ahead_us = max(offset.ahead_us, ahead_us)
    return t_us if offset.same else t_us + offset.ahead_us
