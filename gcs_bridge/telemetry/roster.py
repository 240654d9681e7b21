"""Who was heard on a link at all, vehicle or not: frames and the last heartbeat of every (system, component)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge.columns import Int64s
from gcs_bridge.jit import kernel
from gcs_bridge.mavlink.decode import offsets, unsigned_in
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.scan import Bytes, Frames
from gcs_bridge.telemetry.messages import KIND, kind_of_id
from gcs_bridge.telemetry.sorting import Kinds
from gcs_bridge.telemetry.statement_reader import autopilot_name, type_name

_COMPONENTS = 65536
_BEAT = KIND["HEARTBEAT"]


class Heard(NamedTuple):
    """One (system, component): how many frames came of it, and what it says that it is, "unknown" where it does not."""

    sysid: int
    compid: int
    frames: int
    autopilot: str
    type: str

    @property
    def address(self) -> tuple[int, int]:
        """System and component."""
        return self.sysid, self.compid


@kernel
def _note(
    frames: Frames,
    buffer: Bytes,
    kind_of: Kinds,
    beat_at: Int64s,
    count: Int64s,
    said: npt.NDArray[np.int32],
) -> None:
    """Count frames by their senders, and keep what heartbeats say: autopilot · 256 + type."""
    for row in range(frames.size):
        frame = frames[row]
        if frame.duplicate:
            continue
        key = np.int64(frame.sysid) * 256 + np.int64(frame.compid)
        count[key] += 1
        if kind_of[frame.msgid] == _BEAT:
            payload = (buffer, np.int64(frame.payload), np.int64(frame.length))
            said[key] = unsigned_in(payload, beat_at[0], 1) * 256 + unsigned_in(payload, beat_at[1], 1)


class Roster:
    """Of one link."""

    def __init__(self, dialect: Dialect) -> None:
        """Start with nobody heard."""
        self._dialect = dialect
        self._kind_of = kind_of_id(dialect)
        self._beat_at = offsets(dialect["HEARTBEAT"], "autopilot", "type")
        self._count = np.zeros(_COMPONENTS, np.int64)
        self._said = np.full(_COMPONENTS, -1, np.int32)

    def note(self, buffer: Bytes, frames: Frames) -> None:
        """Take the next frames (n,), found in `buffer`."""
        _note(frames, buffer, self._kind_of, self._beat_at, self._count, self._said)

    def heard(self) -> list[Heard]:
        """All that were heard, by system and component."""
        return [
            Heard(
                key >> 8,
                key & 0xFF,
                int(self._count[key]),
                autopilot_name(self._dialect, said >> 8) if (said := int(self._said[key])) >= 0 else "unknown",
                type_name(self._dialect, said & 0xFF) if said >= 0 else "unknown",
            )
            for key in np.flatnonzero(self._count).tolist()
        ]
