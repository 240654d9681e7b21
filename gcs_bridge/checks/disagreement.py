"""How far the quaternion is from the Euler angles: what `euler_quaternion` judges, draws and explains by."""

from __future__ import annotations

import numpy as np

from gcs_bridge.columns import Floats, FrameColumns, Mask, record

__all__ = ["NO_DISAGREEMENT", "Disagreement"]


@record
class Disagreement(FrameColumns):
    """The quaternion seen from the Euler angles, n pairs: all in rad.

    `angle` (n,) of the rotation between them; `tilt` and `heading` (n,) its parts, heading NaN where it means nothing;
    `rotvec_body`, `rotvec_world` (n, 3) the rotation in FRD body axes and in NED; `limit` (n,); `judged` (n,) whether a
    pair could be told good or bad at all; `counted` (n,) whether it has a vote in the alarm.
    """

    angle: Floats
    tilt: Floats
    heading: Floats
    rotvec_body: Floats
    rotvec_world: Floats
    limit: Floats
    judged: Mask
    counted: Mask


NO_DISAGREEMENT = Disagreement(
    frame_index=np.empty(0, np.int64),
    angle=np.empty(0),
    tilt=np.empty(0),
    heading=np.empty(0),
    rotvec_body=np.empty((0, 3)),
    rotvec_world=np.empty((0, 3)),
    limit=np.empty(0),
    judged=np.empty(0, np.bool_),
    counted=np.empty(0, np.bool_),
)
