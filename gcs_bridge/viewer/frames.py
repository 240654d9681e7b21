"""How all that moves on a live link lies, told in one piece: a piece costs as much as a hundred rows.

rerun knows the frame of each entity by a name that follows from its path, and one entity may tell where the frames of
others are. So what is drawn is the same as if each were told by itself, and it costs as much for many vehicles as for
one. In files, where rows are gathered, each entity has its own.

    frames     the frame of each body, horizon, place … in that of its parent
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gcs_bridge.columns import Floats
from gcs_bridge.viewer.arrays import CHILD_FRAME, PARENT_FRAME, PLACE, TURN
from gcs_bridge.viewer.below import FRAME
from gcs_bridge.viewer.drawing import Drawing
from gcs_bridge.viewer.rows import POSE, Rows
from gcs_bridge.viewer.times import Times

__all__ = ["FRAMES", "Frames"]

FRAMES = "frames"
_UNTURNED = (0.0, 0.0, 0.0, 1.0)


class _Moved(NamedTuple):
    path: str
    times: Times
    poses: Floats  # (n, 7)


class Frames:
    """Gathers what moved, until it is sent."""

    def __init__(self) -> None:
        """Start with nothing moved."""
        self._moved: list[_Moved] = []

    def take(self, rows: Rows) -> Rows:
        """Keep attitudes and poses; what else there is to be drawn."""
        for path, xyzw in rows.attitudes.items():
            self._moved.append(_Moved(path, rows.times, np.column_stack((np.zeros((len(xyzw), 3)), xyzw))))
        for path, poses in rows.poses.items():
            whole = poses
            if poses.shape[1] < POSE:
                whole = np.column_stack((poses, np.tile(_UNTURNED, (len(poses), 1))))
            self._moved.append(_Moved(path, rows.times, whole))
        return replace(rows, attitudes={}, poses={})

    def send(self, recording: Drawing) -> None:
        """Draw what was kept."""
        moved, self._moved = self._moved, []
        for boot in {one.times.boot for one in moved}:
            several = [one for one in moved if one.times.boot == boot]
            times = Times.joined([one.times for one in several])
            poses = np.concatenate([one.poses for one in several])
            children = np.repeat([one.path for one in several], [len(one.poses) for one in several])
            for part, rows in times.parts():
                names = children[rows].tolist()
                columns = [
                    PLACE.column(poses[rows, :3]),
                    TURN.column(poses[rows, 3:]),
                    CHILD_FRAME.column([f"{FRAME}{name}" for name in names]),
                    PARENT_FRAME.column([f"{FRAME}{name.rpartition('/')[0]}" for name in names]),
                ]
                recording.send_columns(FRAMES, part.columns(recording.aligned), columns)
