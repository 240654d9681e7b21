"""A vehicle's boot clock: unwraps `time_boot_ms`, tells reboots from reordering, and doubts a time that stands alone.

What a time does to the clock `boot_time` says, what shows a restart without one `restarts`. Every rule looks at what
came before and at nothing else, so a live link and a recording, in pieces of any size, give the same times.
"""

from __future__ import annotations

from functools import cache
from typing import Annotated, Any, NamedTuple

import numpy as np

from gcs_bridge.columns import Int64Rows, Int64s, Mask, Records
from gcs_bridge.jit import helper, kernel
from gcs_bridge.mavlink.decode import offsets, place_of, unsigned_in
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.scan import Bytes, Frames
from gcs_bridge.telemetry.boot_time import CLOCK, DOUBTED, GOES_ON, LATE, REBOOT, STEP, read_time, start_boot
from gcs_bridge.telemetry.messages import KIND, OTHER, TIMED, UNTIMED
from gcs_bridge.telemetry.restarts import (
    WITNESS,
    OtherTimes,
    hear_status,
    hear_witness,
    other_times,
    suspect_restart,
)
from gcs_bridge.telemetry.sorting import Kinds, Share, SortedFrames

_HEARTBEAT = KIND["HEARTBEAT"]
_NAMES = {REBOOT: "reboot", STEP: "clock_step"}


class ClockChange(NamedTuple):
    """Where a clock did something else than go on: the new time, how far it stepped, and the frame that showed it."""

    frame_index: int
    t_rx_us: int
    boot: int
    kind: str  # "reboot" or "clock_step"
    t_boot_us: int  # −1: not known
    step_us: int  # 0: not known


FRAME_INDEX, MESSAGE, ROW, BOOT, T_BOOT_US, T_RX_US, LOST, RECEIVED = range(8)


class TimedMessages(NamedTuple):
    """Messages with a believed boot time, in order of arrival; n of them.

    `columns` (8, n): FRAME_INDEX of the frame by which its time was believed; MESSAGE, index into TIMED; ROW of its own
    frame in the batch, −1 where it came with a batch before: its payload is `held`; BOOT, T_BOOT_US, T_RX_US; LOST,
    RECEIVED frames of the vehicle so far. `in_window` (n,). `restarting` (k,) of all of the vehicle's frames whether it
    may have restarted before, and nothing has told its time since. `before`: boot and boot time of the last one before
    these, time −1 if there is none.
    """

    columns: Int64s
    in_window: Mask
    restarting: Mask
    before: tuple[int, int]
    held: Bytes


@helper
def _doubt(clock: Any, frame: Any, message: Any, row: Any, received: Any, in_window: Any) -> Any:
    """Keep what is to be known of a message, should it be believed after all."""
    clock.message, clock.row, clock.received, clock.in_window = message, row, received, in_window
    clock.t_rx_us, clock.lost = frame.t_rx_us, frame.lost


@helper
def _note(
    changes: Any, n: Any, frame_index: Any, t_rx_us: Any, boot: Any, kind: Any, t_boot_us: Any, step_us: Any
) -> Any:
    """Put down a change of the clock; return how many there are."""
    changes[n, 0], changes[n, 1], changes[n, 2] = frame_index, t_rx_us, boot
    changes[n, 3], changes[n, 4], changes[n, 5] = kind, t_boot_us, step_us
    return n + 1


@helper
def _believe(
    timed: Any,
    n: Any,
    frame_index: Any,
    message: Any,
    row: Any,
    boot: Any,
    t_boot_us: Any,
    t_rx_us: Any,
    lost: Any,
    received: Any,
) -> Any:
    timed[FRAME_INDEX, n], timed[MESSAGE, n], timed[ROW, n], timed[BOOT, n] = frame_index, message, row, boot
    timed[T_BOOT_US, n], timed[T_RX_US, n], timed[LOST, n], timed[RECEIVED, n] = t_boot_us, t_rx_us, lost, received


@kernel
def _follow(
    clock: Annotated[Records, CLOCK],
    frames: Frames,
    buffer: Bytes,
    kind: Kinds,
    in_window: Mask,
    arrival: Int64s,
    start: int,
    end: int,
    first: int,
    offset: Int64s,
    status_at: int,
    times: OtherTimes,
    witness: Annotated[Records, WITNESS],
    came: int,
    timed: Int64Rows,
    inside: Mask,
    restarting: Mask,
    changes: Int64Rows,
) -> tuple[int, int, int]:
    """Read the timed ones of a component's frames, of which `came` came before; `first`: the index of frame 0.

    `offset`: where time_boot_ms begins in the payload of each kind, `status_at` the status in a heartbeat's. Return how
    many were believed, how often the clock changed, and which row is in doubt at the end, −1: none.
    """
    state = clock[0]
    n = n_changes = 0
    for i in range(start, end):
        row = arrival[i]
        message = np.int64(kind[row])
        frame, received = frames[row], came + i - start
        restarted = suspect_restart(state, frame, frame.t_rx_us)
        payload = buffer, np.int64(frame.payload), np.int64(frame.length)
        if message >= UNTIMED:
            before_us = state.latest_us
            if restarted:
                start_boot(state, state.latest_us)
                state.latest_us = state.doubted_us = -1
                state.epoch_us = 0
                state.by_witness, state.restarting = True, False
                n_changes = _note(changes, n_changes, first + row, frame.t_rx_us, state.boot, REBOOT, -1, 0)
            if message == _HEARTBEAT:
                hear_status(state, unsigned_in(payload, status_at, 1), frame)
            place = times.row_of_id[frame.msgid] if frame.msgid < times.row_of_id.size else -1
            if place >= 0:
                own_us = unsigned_in(payload, times.offset[place], times.size[place]) * times.scale[place]
                said = hear_witness(state, witness[place], frame, own_us, frame.t_rx_us)
                if said >= 0:
                    if said == REBOOT:
                        n_changes = _note(
                            changes, n_changes, first + row, frame.t_rx_us, state.boot, said, own_us, own_us - before_us
                        )
                    inside[n] = in_window[row]
                    _believe(timed, n, first + row, OTHER, row, state.boot, own_us, frame.t_rx_us, frame.lost, received)
                    n += 1
            restarting[i - start] = state.restarting
            continue
        ms = unsigned_in(payload, offset[message], 4)
        said, t_us, step_us, first_us = read_time(state, message, ms, frame.t_rx_us)
        restarting[i - start] = state.restarting
        if said in (DOUBTED, LATE):
            if message < state.unbelieved.size:
                state.unbelieved[message] += 1
            if said == DOUBTED:
                _doubt(state, frame, message, row, received, in_window[row])
            continue
        state.restarting, state.by_witness, state.witnesses = False, False, 0
        restarting[i - start] = False
        if said != GOES_ON:  # the one before is believed after all, if it is of this clock: it counts from now on
            if first_us >= 0:
                if state.message < state.unbelieved.size:
                    state.unbelieved[state.message] -= 1
                inside[n] = state.in_window
                _believe(
                    timed, n, first + row, state.message, state.row, state.boot, first_us, state.t_rx_us, state.lost,
                    state.received,
                )  # fmt: skip
                n += 1
            begin_us = first_us if first_us >= 0 else t_us
            n_changes = _note(changes, n_changes, first + row, frame.t_rx_us, state.boot, said, begin_us, step_us)
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
        self._status_at = place_of(dialect["HEARTBEAT"], "system_status")[0]
        self._state = np.zeros(1, CLOCK)
        for name in ("latest_us", "doubted_us", "row", "earlier_us", "earlier_run_us", "frame_rx_us", "status"):
            self._state[name] = -1
        self._times = other_times(dialect)
        self._witness = np.zeros(len(self._times.offset), WITNESS)
        self._last = (0, -1)  # boot and boot time last believed
        self._held: Bytes | None = None  # the payload of the message that is doubted

    @property
    def unbelieved(self) -> tuple[int, int]:
        """How many messages of each of the two streams carried a time that was not believed."""
        euler, quaternion = self._state["unbelieved"][0].tolist()
        return euler, quaternion

    def read(self, batch: SortedFrames, share: Share, received: int) -> tuple[TimedMessages, list[ClockChange]]:
        """Take a component's next messages; `received`: how many frames of it came before.

        The first message behind a reboot, or behind a jump, is not believed before a second one confirms it: it comes
        with that one, or never.
        """
        before, held = self._last, self._held
        came = share.end - share.start
        most = came + (held is not None)
        timed, inside = np.empty((8, most), np.int64), np.empty(most, np.bool_)
        restarting = np.empty(came, np.bool_)
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
            self._status_at,
            self._times,
            self._witness,
            received,
            timed,
            inside,
            restarting,
            changes,
        )
        if share.starts[UNTIMED] != share.start:
            self._held = None
        if doubted >= 0:
            frame = batch.frames[doubted]
            payload = batch.buffer[frame["payload"] : frame["payload"] + frame["length"]]
            self._held = np.append(payload, np.uint8(0))  # which may be empty
        if n < most:
            timed, inside = timed[:, :n].copy(), inside[:n]
        if n:
            self._last = int(timed[BOOT, -1]), int(timed[T_BOOT_US, -1])
        return TimedMessages(timed, inside, restarting, before, _NO_BYTES if held is None else held), [
            ClockChange(frame_index, t_rx_us, boot, _NAMES[kind], t_boot_us, step_us)
            for frame_index, t_rx_us, boot, kind, t_boot_us, step_us in changes[:n_changes].tolist()
        ]


@cache
def _time_offsets(dialect: Dialect) -> Int64s:
    """Where time_boot_ms begins in the payload of each of TIMED, as far as the dialect has them."""
    return np.array([offsets(dialect[name], "time_boot_ms")[0] if name in dialect else 0 for name in TIMED], np.int64)


_NO_BYTES: Bytes = np.empty(0, np.uint8)
NO_TIMES: Int64s = np.empty((8, 0), np.int64)
