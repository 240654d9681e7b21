"""What the tests' own helpers compute, against SciPy."""

import numpy as np
from scipy.spatial.transform import Rotation

from tests.helpers.turn import Turn


def test_turns_are_scipys() -> None:
    """Made of vectors, also tiny ones, and of angles; turned one after the other, back, and vectors by them."""
    random = np.random.default_rng(1)
    vectors = random.uniform(-2.5, 2.5, (100, 3)) * random.choice([1e-14, 1e-3, 1.0], (100, 1))
    rpy_deg = random.uniform((-180, -89, -180), (180, 89, 180), (100, 3))
    turned, scipys = [], []
    for rotvec, (roll, pitch, yaw), force in zip(vectors, rpy_deg, random.normal(size=(100, 3)), strict=True):
        turn = Turn.from_rpy_deg(roll, pitch, yaw) * Turn.from_rotvec(rotvec)
        scipy = Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True) * Rotation.from_rotvec(rotvec)
        turned.append([*turn, *turn.rpy_rad(), *turn.apply(force), *turn.inv().apply(force)])
        w_last = scipy.as_quat()
        scipys.append(
            [w_last[3], *w_last[:3], *scipy.as_euler("ZYX")[::-1], *scipy.apply(force), *scipy.inv().apply(force)]
        )
    found, expected = np.array(turned), np.array(scipys)
    expected[:, :4] *= np.sign((found[:, :4] * expected[:, :4]).sum(axis=1, keepdims=True))  # q and −q are one turn
    np.testing.assert_allclose(found, expected, atol=1e-12)
