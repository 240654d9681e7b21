"""A vehicle's boot clock: unwraps `time_boot_ms`, tells reboots from reordering, and doubts a time that stands alone.

Milliseconds since boot wrap after 49.7 days (a step of about −2³²), restart near zero with a reboot, and step back by a
few seconds where frames were reordered. Every rule looks at what came before and at nothing else, so a live link and a
recording, in pieces of any size, give the same times.

What comes late of the boot before, as from a buffer that is sent beside what is new, is no boot of its own, and is not
used. A vehicle that has restarted and sends no attitude yet is known by what else it sends: times of other messages
that went with its clock before, or a sequence that begins anew.
"""

from __future__ import annotations

from functools import cache
from typing import Annotated, NamedTuple

import numpy as np

from gcs_bridge.columns import Int64Rows, Int64s, Mask, Records
from gcs_bridge.jit import helper, kernel
from gcs_bridge.mavlink.decode import offsets, place_of, unsigned_in
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.scan import Bytes, Frames
from gcs_bridge.telemetry.link_clock import HEARD_US
from gcs_bridge.telemetry.messages import OTHER, TIMED, UNTIMED
from gcs_bridge.telemetry.sorting import Kinds, Share, SortedFrames

WRAP_US = 2**32 * 1000
REORDER_US = 6_000_000  # seen: 4.7 s in a recording that is otherwise good
YOUNG_US = 15_000_000  # a boot this young that falls silent and comes back earlier was a restart, not reordered frames
YOUNG_REORDER_US = 500_000
RESTART_SILENCE_US = 1_000_000
JUMP_US = 60_000_000  # a longer step forward needs the receive time, or a second message, to be believed

# A sample of the boot before may come so much earlier than its last one, and for so long nothing but such samples: a
# vehicle that restarts for the third time begins near zero, and goes on.
_EARLIER_US, _EARLIER_RUN_US = 1_000_000, 10_000_000
_RIVALS = 5  # messages of another clock, each later than the one before, that are believed beside one that goes on
# Behind a silence of its own, which is longer than from one heartbeat to the next, a sequence that begins anew; behind
# a longer one some of its first frames may be missing.
_RESTART_SILENCE_US, _RESTART_SEQ = 1_500_000, 5
_LONG_SILENCE_US, _EARLY_SEQ = 2_500_000, 31
_RESTARTED_US = 10_000_000  # and so long nothing that tells a time: it has restarted
# Messages with a time of their own that fell back to near zero, and for how long, before they are believed.
_WITNESSES, _WITNESSED_US = 3, 1_000_000
_WITNESS_SLACK_US = 10_000_000  # that a receiver's clock may be wrong by

_GOES_ON, _DOUBTED, _REBOOT, _STEP, _LATE = range(5)  # what a message does to the clock
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
        ("unbelieved", "i8", (2,)),  # messages of the two streams so far whose time was not believed
        # The boot before, on its own milliseconds: the latest time, −1: none, and where a run of such messages began.
        ("earlier_us", "i8"),
        ("earlier_run_us", "i8"),
        # Messages of another clock, between those of this one.
        ("rival_us", "i8"),
        ("rivals", "i8"),
        # Whether it may have restarted: by all of its frames.
        ("frame_rx_us", "i8"),  # when the latest one came, −1: none yet
        ("seq", "i8"),
        ("restarting", "?"),
        ("restarting_us", "i8"),  # for how long it was heard since
        ("restart_lost", "i8"),  # frames that were missing then, and that came since
        ("restart_came", "i8"),
        # By messages with a time of their own.
        ("by_witness", "?"),  # no other time was told in this boot
        ("witnesses", "i8"),
        ("witness_us", "i8"),  # the first one's time
    ]
)
WITNESS = np.dtype([("t_us", "i8"), ("same", "?")])  # of one message: whether its time went with the vehicle's clock


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


class OtherTimes(NamedTuple):
    """Where messages have a time that does not keep the clock: by message id (−1: nowhere) the row in the others.

    Per row where the time begins in the payload, how many bytes it has, and how many µs its unit has.
    """

    row_of_id: Int64s
    offset: Int64s
    size: Int64s
    scale: Int64s


# Helpers of kernels carry no types: numba types them anew wherever they are compiled into one.


@helper
def _goes_on(clock, step_us, silence_us):  # type: ignore[no-untyped-def]  # typed by numba
    """Whether a step of the time needs no closer look: the common case."""
    if clock.doubted_us >= 0 or not -REORDER_US <= step_us <= JUMP_US:
        return False
    return clock.latest_us >= YOUNG_US or silence_us < RESTART_SILENCE_US or step_us >= -YOUNG_REORDER_US


@helper
def _is_of_earlier(clock, own_us):  # type: ignore[no-untyped-def]  # typed by numba
    """Whether a message goes on where the boot before had come to; not where nothing else has come for some time."""
    if clock.earlier_us < 0 or not -_EARLIER_US <= own_us - clock.earlier_us <= JUMP_US:
        return False
    if clock.earlier_run_us < 0:
        clock.earlier_run_us = own_us
    if own_us - clock.earlier_run_us > _EARLIER_RUN_US:
        return False
    clock.earlier_us = max(clock.earlier_us, own_us)
    return True


@helper
def _follow_rival(clock, own_us):  # type: ignore[no-untyped-def]  # typed by numba
    """How many messages have told of another clock that goes on, whatever came between."""
    if clock.rivals and 0 <= own_us - clock.rival_us <= JUMP_US:
        clock.rivals += own_us > clock.rival_us
    else:
        clock.rivals = 1
    clock.rival_us = own_us
    return clock.rivals


@helper
def _start_boot(clock, latest_us):  # type: ignore[no-untyped-def]  # typed by numba
    """The vehicle has started anew."""
    clock.boot += 1
    clock.earlier_us = latest_us % WRAP_US if latest_us >= 0 else -1
    clock.earlier_run_us = -1
    clock.rivals = clock.witnesses = 0


@helper
def _suspect_restart(clock, frame, rx_us):  # type: ignore[no-untyped-def]  # typed by numba
    """Whether the vehicle has restarted, as its frames alone show; whether it may have is kept."""
    seq, silent_us = np.int64(frame.seq), max(rx_us - clock.frame_rx_us, 0) if clock.frame_rx_us >= 0 else 0
    if clock.restarting:
        clock.restart_came += 1
        clock.restarting_us += min(silent_us, HEARD_US)
        if frame.lost - clock.restart_lost > clock.restart_came:  # no counter that began anew
            clock.restarting = False
    elif silent_us > _RESTART_SILENCE_US and seq != (clock.seq + 1) % 256:
        early = seq <= _EARLY_SEQ if silent_us > _LONG_SILENCE_US else seq <= _RESTART_SEQ
        if early:
            _begin_restart(clock, frame)
    clock.frame_rx_us, clock.seq = rx_us, seq
    return clock.restarting and clock.restarting_us >= _RESTARTED_US and clock.latest_us >= 0


@helper
def _begin_restart(clock, frame):  # type: ignore[no-untyped-def]  # typed by numba
    """From here on it may have restarted."""
    clock.restarting, clock.restarting_us = True, 0
    clock.restart_lost, clock.restart_came = frame.lost, 0


@helper
def _hear_witness(clock, witness, frame, own_us, rx_us):  # type: ignore[no-untyped-def]  # typed by numba
    """What a message with another time than the clock's own says of it, as `_read_time` does, −1: nothing."""
    witness.t_us = own_us
    if clock.latest_us < 0:
        if not (clock.by_witness and witness.same):
            return -1
        clock.latest_us, clock.rx_us, clock.restarting = own_us, rx_us, False
        return _GOES_ON
    latest_us = clock.latest_us - clock.epoch_us
    ahead_us = own_us - latest_us
    if clock.by_witness and witness.same and -REORDER_US <= ahead_us <= JUMP_US:
        clock.latest_us, clock.rx_us = max(clock.latest_us, own_us + clock.epoch_us), rx_us
        return _GOES_ON
    if abs(ahead_us) <= REORDER_US or abs(ahead_us + WRAP_US) <= REORDER_US:
        witness.same = True
        clock.witnesses, clock.restarting = 0, False  # the vehicle goes on
        return -1
    elapsed_us = rx_us - clock.rx_us if rx_us >= 0 and clock.rx_us >= 0 else JUMP_US
    if not witness.same or ahead_us > 0 or own_us > elapsed_us + _WITNESS_SLACK_US:
        return -1
    if not clock.witnesses or own_us < clock.witness_us:
        clock.witnesses, clock.witness_us = 0, own_us
        if not clock.restarting:
            _begin_restart(clock, frame)
    clock.witnesses += 1
    if clock.witnesses < _WITNESSES or own_us - clock.witness_us < _WITNESSED_US:
        return -1
    _start_boot(clock, clock.latest_us)
    clock.latest_us, clock.epoch_us, clock.doubted_us, clock.rx_us = own_us, 0, -1, rx_us
    clock.by_witness, clock.restarting = True, False
    return _REBOOT


@helper
def _read_time(clock, message, ms, rx_us):  # type: ignore[no-untyped-def]  # typed by numba
    """Take the next message: what it does to the clock, its time, how far that steps; the time of the one in doubt.

    The first message behind a reboot, or behind a jump, is not believed before a second one confirms it; −1 where that
    was not the message in doubt.
    """
    own_us = ms * 1000
    t_us = own_us + clock.epoch_us
    latest_us = clock.latest_us if clock.latest_us >= 0 else t_us
    if _goes_on(clock, t_us - latest_us, rx_us - clock.rx_us):
        clock.latest_us, clock.rx_us, clock.earlier_run_us = max(latest_us, t_us), rx_us, -1
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
        if _is_of_earlier(clock, own_us):
            clock.doubted_us = -1
            return _LATE, t_us, step_us, 0
        rivals = _follow_rival(clock, own_us)
        again = clock.doubted_us >= 0 and -REORDER_US <= own_us - clock.doubted_us <= JUMP_US
        if own_us == clock.doubted_us and message == clock.message:
            again = False  # it says what it said: no clock goes on there
        if not again and (rivals < _RIVALS or step_us >= 0):
            clock.doubted_us = own_us
            return _DOUBTED, t_us, step_us, 0
        said, first_us = _STEP, clock.doubted_us + t_us - own_us
        if step_us < 0:  # a second message from the past: the vehicle has started anew
            said, first_us, t_us = _REBOOT, clock.doubted_us, own_us
            _start_boot(clock, latest_us)
        first_us = first_us if again else -1
    clock.doubted_us, clock.rx_us, clock.earlier_run_us = -1, rx_us, -1
    clock.latest_us = max(first_us, t_us)
    clock.epoch_us = clock.latest_us // WRAP_US * WRAP_US
    return said, t_us, step_us, first_us


@helper
def _doubt(clock, frame, message, row, received, in_window):  # type: ignore[no-untyped-def]  # typed by numba
    """Keep what is to be known of a message, should it be believed after all."""
    clock.message, clock.row, clock.received, clock.in_window = message, row, received, in_window
    clock.t_rx_us, clock.lost = frame.t_rx_us, frame.lost


@helper
def _note(changes, n, frame_index, t_rx_us, boot, kind, t_boot_us, step_us):  # type: ignore[no-untyped-def]  # typed by numba
    """Put down a change of the clock; return how many there are."""
    changes[n, 0], changes[n, 1], changes[n, 2] = frame_index, t_rx_us, boot
    changes[n, 3], changes[n, 4], changes[n, 5] = kind, t_boot_us, step_us
    return n + 1


@helper
def _believe(timed, n, frame_index, message, row, boot, t_boot_us, t_rx_us, lost, received):  # type: ignore[no-untyped-def]  # typed by numba
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
    times: OtherTimes,
    witness: Annotated[Records, WITNESS],
    came: int,
    timed: Int64Rows,
    inside: Mask,
    restarting: Mask,
    changes: Int64Rows,
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
        frame, received = frames[row], came + i - start
        restarted = _suspect_restart(state, frame, frame.t_rx_us)
        payload = buffer, np.int64(frame.payload), np.int64(frame.length)
        if message >= UNTIMED:
            before_us = state.latest_us
            if restarted:
                _start_boot(state, state.latest_us)
                state.latest_us = state.doubted_us = -1
                state.epoch_us = 0
                state.by_witness, state.restarting = True, False
                n_changes = _note(changes, n_changes, first + row, frame.t_rx_us, state.boot, _REBOOT, -1, 0)
            place = times.row_of_id[frame.msgid] if frame.msgid < times.row_of_id.size else -1
            if place >= 0:
                own_us = unsigned_in(payload, times.offset[place], times.size[place]) * times.scale[place]
                said = _hear_witness(state, witness[place], frame, own_us, frame.t_rx_us)
                if said >= 0:
                    if said == _REBOOT:
                        n_changes = _note(
                            changes, n_changes, first + row, frame.t_rx_us, state.boot, said, own_us, own_us - before_us
                        )
                    inside[n] = in_window[row]
                    _believe(timed, n, first + row, OTHER, row, state.boot, own_us, frame.t_rx_us, frame.lost, received)
                    n += 1
            restarting[i - start] = state.restarting
            continue
        ms = unsigned_in(payload, offset[message], 4)
        said, t_us, step_us, first_us = _read_time(state, message, ms, frame.t_rx_us)
        restarting[i - start] = state.restarting
        if said in (_DOUBTED, _LATE):
            if message < state.unbelieved.size:
                state.unbelieved[message] += 1
            if said == _DOUBTED:
                _doubt(state, frame, message, row, received, in_window[row])
            continue
        state.restarting, state.by_witness, state.witnesses = False, False, 0
        restarting[i - start] = False
        if said != _GOES_ON:  # the one before is believed after all, if it is of this clock: it counts from now on
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
        self._state = np.zeros(1, CLOCK)
        for name in ("latest_us", "doubted_us", "row", "earlier_us", "earlier_run_us", "frame_rx_us"):
            self._state[name] = -1
        self._times = _other_times(dialect)
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


@cache
def _other_times(dialect: Dialect) -> OtherTimes:
    """Of all messages with `time_boot_ms` or `time_usec`, but those that keep the clock."""
    rows = [
        (dialect[name].msgid, *place_of(dialect[name], field), scale)
        for field, scale in (("time_boot_ms", 1000), ("time_usec", 1))
        for name in dialect.with_field(field)
        if name not in TIMED
    ]
    ids, *columns = np.array(rows, np.int64).reshape(-1, 4).T.copy()
    row_of_id = np.full(len(dialect.tables.row_of_id), -1, np.int64)
    row_of_id[ids] = np.arange(len(ids))
    return OtherTimes(row_of_id, *columns)


_NO_BYTES: Bytes = np.empty(0, np.uint8)
NO_TIMES: Int64s = np.empty((8, 0), np.int64)
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
