"""How all that moves on a live link lies, told in one piece: a piece costs as much as a hundred rows.

rerun knows the frame of each entity by a name that follows from its path, and one entity may tell where the frames of
others are. So what is drawn is the same as if each were told by itself, and it costs as much for many vehicles as for
one. In files, where rows are gathered, each entity has its own.

    frames     the frame of each body, horizon, place … in that of its parent
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import rerun as rr

from gcs_bridge.columns import Floats
from gcs_bridge.viewer.arrays import CHILD_FRAME, PARENT_FRAME, PLACE, TURN
from gcs_bridge.viewer.below import FRAME
from gcs_bridge.viewer.drawing import Drawing
from gcs_bridge.viewer.rows import POSE, Rows
from gcs_bridge.viewer.times import Times

__all__ = ["FRAMES", "Frames"]

FRAMES = "frames"
_PATTERNS, _PATHS = 256, 1024  # of whose rows come one behind the other, and of all of them: they repeat


class Frames:
    """Gathers what moved, until it is sent."""

    def __init__(self) -> None:
        """Start with nothing moved."""
        self._moved: list[tuple[str, Times, Floats]] = []  # poses (n, 7), (n, 4) without a place, (n, 3) without a turn

    def take(self, rows: Rows) -> Rows | None:
        """Keep attitudes and poses; what else there is to be drawn, None: nothing."""
        for moves in (rows.attitudes, rows.poses):
            for path, values in moves.items():
                self._moved.append((path, rows.times, values))
        return rows.without_moves()

    def send(self, recording: Drawing) -> None:
        """Draw what was kept."""
        moved, self._moved = self._moved, []
        for boot in {times.boot for _, times, _ in moved}:
            several = [one for one in moved if one[1].boot == boot]
            times = Times.joined([times for _, times, _ in several])
            whole = np.zeros((len(times), POSE))
            whole[:, POSE - 4] = 1.0
            end = 0
            for _, _, values in several:
                start, end = end, end + len(values)
                whole[start:end, slice(POSE - 4, POSE) if values.shape[1] == 4 else slice(values.shape[1])] = values
            names = tuple((path, len(values)) for path, _, values in several)
            for part, rows in times.parts():
                poses = whole[rows]
                columns = [PLACE.column(poses[:, :3]), TURN.column(poses[:, 3:])]
                if len(part) == len(times):
                    columns += _names(names)
                else:
                    picked = np.repeat([path for path, _ in names], [n for _, n in names])[rows]
                    columns += _names(tuple((path, 1) for path in picked.tolist()))
                recording.send_columns(FRAMES, part.columns(recording.aligned), columns)


@lru_cache(_PATTERNS)
def _names(rows: tuple[tuple[str, int], ...]) -> list[rr.ComponentColumn]:
    """Whose rows these are, of each so many, and in whose frames they lie."""
    names = [name for path, n in rows for name in (_frames_of(path),) * n]
    return [CHILD_FRAME.column([child for child, _ in names]), PARENT_FRAME.column([parent for _, parent in names])]


@lru_cache(_PATHS)
def _frames_of(path: str) -> tuple[str, str]:
    """Its own frame and its parent's."""
    return f"{FRAME}{path}", f"{FRAME}{path.rpartition('/')[0]}"
