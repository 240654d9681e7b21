"""Where a pinhole camera at the scene's eye sees the axes of a body; and where a picture shows them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial.transform import Rotation

from gcs_bridge.viewer.places import eye_of
from tests.helpers.viewer_tools import Picture

AXES = ((230, 70, 60), (70, 200, 80), (70, 130, 255))  # forward, right, down: as the view's title says
LENGTHS_M = (1.15, 1.0, 0.9)


def expected_deg(turned: Rotation) -> list[float]:
    """The directions of a body's axes in the picture, from its origin, clockwise from the right; one vehicle's."""
    eye = eye_of(1)
    ahead = np.subtract(eye.target, eye.position)
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, (0.0, 0.0, -1.0))
    right /= np.linalg.norm(right)
    below = np.cross(ahead, right)
    tips = turned.apply(np.diag(LENGTHS_M))
    seen = []
    for point in (np.zeros(3), *tips):
        from_eye = point - eye.position
        seen.append(np.array([from_eye @ right, from_eye @ below]) / (from_eye @ ahead))
    origin, *ends = seen
    return [math.degrees(math.atan2(*(end - origin)[::-1])) for end in ends]


def seen_deg(picture: Picture) -> list[float]:
    """The same as a picture of the view shows it: from where the arrows meet to what is farthest of each."""
    height, width = picture.shape[:2]
    part = picture[round(0.28 * height) :, round(0.4 * width) :]  # below the vehicle's name, right of the world's axes
    arrows = [_largest(np.abs(part - np.array(colour)).max(axis=2) <= 60) for colour in AXES]
    assert min(map(len, arrows)) > 15, [len(arrow) for arrow in arrows]
    meet = _meeting(arrows)
    ends = [arrow[np.argmax(np.linalg.norm(arrow - meet, axis=1))] - meet for arrow in arrows]
    return [math.degrees(math.atan2(*end[::-1])) for end in ends]


def _largest(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The pixels, x and y, of the largest piece that hangs together."""
    pieces, count = ndimage.label(mask, np.ones((3, 3)))
    sizes = ndimage.sum_labels(mask, pieces, np.arange(1, count + 1))
    found: NDArray[np.int64] = np.argwhere(pieces == np.argmax(sizes) + 1)[:, ::-1] if count else np.empty((0, 2), int)
    return found


def _meeting(arrows: list[NDArray[np.int64]]) -> NDArray[np.float64]:
    """Where the lines through the pixels of each arrow meet: nearest to all of them."""
    across, offsets = [], []
    for arrow in arrows:
        middle = arrow.mean(axis=0)
        normal = np.linalg.svd(arrow - middle)[2][1]
        across.append(normal)
        offsets.append(normal @ middle)
    found: NDArray[np.float64] = np.linalg.lstsq(np.array(across), np.array(offsets), rcond=None)[0]
    return found
