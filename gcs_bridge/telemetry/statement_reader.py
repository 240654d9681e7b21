"""Statements from the wire: heartbeats, parameters, texts, whether it has landed, flags of the estimator.

Most messages say the same again: those are told apart in a kernel, and cost no more.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gcs_bridge.columns import Int64s, Records
from gcs_bridge.jit import kernel
from gcs_bridge.mavlink.decode import decode, place_of, unsigned_in
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.scan import Bytes, Frames
from gcs_bridge.telemetry.messages import KIND, STATEMENT_KINDS
from gcs_bridge.telemetry.sorting import Share, SortedFrames
from gcs_bridge.telemetry.statements import (
    FlagsSet,
    LandedSet,
    ModeSet,
    ReadySet,
    Statement,
    TextSaid,
    parameters,
    text_of,
)

_ARMED = 128  # MAV_MODE_FLAG_SAFETY_ARMED
_LANDED = {1: True, 2: False, 3: False, 4: False}  # MAV_LANDED_STATE; 0: it does not know
_FLAGS = {"EKF_STATUS_REPORT": "flags", "ESTIMATOR_STATUS": "flags", "ODOMETRY": "reset_counter"}
_SENSORS = tuple(f"onboard_control_sensors_{what}" for what in ("present", "enabled", "health"))
_AHRS = 0x200000  # MAV_SYS_STATUS_AHRS
_ATTITUDE = 1  # EKF_ATTITUDE and ESTIMATOR_ATTITUDE
_UNINITIALISED = 1024  # EKF_UNINITIALIZED
_AUTOPILOTS = {3: "ardupilot"}  # MAV_AUTOPILOT_ARDUPILOTMEGA, as everybody calls it; others by MAVLink's own name


@kernel
def _differing(
    frames: Frames,
    buffer: Bytes,
    by_message: Int64s,
    start: int,
    end: int,
    offset: int,
    last: Bytes,
    rows: Int64s,
) -> int:
    """Find the messages from `start` to `end` of `by_message` that say something else than the one before.

    What they say is as many bytes from `offset` on as `last` has, the last one's, save one: that is 0 before the first.
    Return how many `rows` there are.
    """
    n, size = 0, last.size - 1
    for i in range(start, end):
        row = by_message[i]
        payload = (buffer, np.int64(frames[row].payload), np.int64(frames[row].length))
        differs = last[size] == 0
        last[size] = 1
        for at in range(size):
            byte = unsigned_in(payload, offset + at, 1)
            differs |= byte != last[at]
            last[at] = byte
        if differs:
            rows[n] = row
            n += 1
    return n


class StatementReader:
    """Reads what one vehicle says of itself."""

    def __init__(self, dialect: Dialect) -> None:
        """Start with nothing said."""
        self._dialect = dialect
        self._last: dict[str, Bytes] = {}
        self._flags: dict[str, int] = {}
        self._ready: dict[str, bool] = {}
        self._mode: tuple[int, int, int, bool] | None = None

    def read(self, batch: SortedFrames, share: Share, autopilot: str) -> list[Statement]:
        """All statements, in order of arrival; `autopilot`: its name as far as known."""
        told: list[Statement] = []
        if not share.has_any(STATEMENT_KINDS):
            return told
        for frame_index, _, beat in self._news(batch, share, "HEARTBEAT"):
            autopilot_number, type_number = int(beat["autopilot"]), int(beat["type"])
            mode = autopilot_number, type_number, int(beat["custom_mode"]), bool(beat["base_mode"] & _ARMED)
            if mode != self._mode:
                self._mode = mode
                names = autopilot_name(self._dialect, autopilot_number), type_name(self._dialect, type_number)
                told.append(ModeSet(frame_index, *names, *mode[2:]))
        if share.counts[KIND["PARAM_VALUE"]]:
            rows = batch.rows(share, KIND["PARAM_VALUE"])
            told += parameters(self._records(batch, "PARAM_VALUE", rows), batch.first + rows, autopilot)
        for frame_index, state in self._all(batch, share, "EXTENDED_SYS_STATE"):
            told.append(LandedSet(frame_index, _LANDED.get(int(state["landed_state"]))))
        for frame_index, said in self._all(batch, share, "STATUSTEXT"):
            told.append(TextSaid(frame_index, text_of(said)))
        for name, field in _FLAGS.items():
            for frame_index, _, flags in self._news(batch, share, name, field):
                what, value = f"{name}.{field}", int(flags[field])
                if self._flags.setdefault(what, value) != value:
                    told.append(FlagsSet(frame_index, what, self._flags[what], value))
                self._flags[what] = value
                if name != "ODOMETRY":
                    told += self._readiness(frame_index, name, bool(value & _ATTITUDE) and not value & _UNINITIALISED)
        for frame_index, _, status in self._news(batch, share, "SYS_STATUS", _SENSORS[-1]):
            present, enabled, healthy = (bool(status[field] & _AHRS) for field in _SENSORS)
            if present and enabled:
                told += self._readiness(frame_index, "SYS_STATUS", healthy)
        return sorted(told, key=lambda statement: statement.frame_index) if len(told) > 1 else told

    def _readiness(self, frame_index: int, source: str, ready: bool) -> Iterator[ReadySet]:
        """Whether the attitude is ready, where the source said something else before, or nothing."""
        if self._ready.get(source) is not ready:
            self._ready[source] = ready
            yield ReadySet(frame_index, source, ready)

    def _all(self, batch: SortedFrames, share: Share, name: str) -> Iterator[tuple[int, np.void]]:
        """Frame index and fields of each message of this name."""
        if share.counts[KIND[name]]:
            rows = batch.rows(share, KIND[name])
            yield from zip((batch.first + rows).tolist(), self._records(batch, name, rows), strict=True)

    def _news(
        self, batch: SortedFrames, share: Share, name: str, field: str | None = None
    ) -> Iterator[tuple[int, int, np.void]]:
        """Frame index, receive time and fields of messages that differ from the one before; in `field`, or at all."""
        count = share.counts[KIND[name]]
        if not count:
            return
        message = self._dialect[name]
        offset, size = (0, message.dtype.itemsize) if field is None else place_of(message, field)
        last = self._last.setdefault(name, np.zeros(size + 1, np.uint8))
        rows = np.empty(count, np.int64)
        start, end = share.starts[KIND[name] : KIND[name] + 2]
        n = _differing(batch.frames, batch.buffer, batch.by_message, start, end, offset, last, rows)
        if n:
            rows = rows[:n]
            times = batch.frames["t_rx_us"][rows].tolist()
            yield from zip((batch.first + rows).tolist(), times, self._records(batch, name, rows), strict=True)

    def _records(self, batch: SortedFrames, name: str, rows: Int64s) -> Records:
        return decode(batch.buffer, np.take(batch.frames, rows), self._dialect[name])


def autopilot_name(dialect: Dialect, number: int) -> str:
    """As in the report."""
    return _AUTOPILOTS.get(number) or dialect.enum_name("MAV_AUTOPILOT", number)


def type_name(dialect: Dialect, number: int) -> str:
    """As in the report."""
    return dialect.enum_name("MAV_TYPE", number)
