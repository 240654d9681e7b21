"""Colours side by side are told apart by people who see no red, no green or no blue, on dark and on light."""

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from gcs_bridge.viewer import palette, panels, scene

Array = NDArray[np.float64]

# Machado, Oliveira, Fernandes (2009), severity 1: what of linear light is seen.
SEEN_BY = {
    "all": np.eye(3),
    "no red": np.array(
        ((0.152286, 1.052583, -0.204868), (0.114503, 0.786281, 0.099216), (-0.003882, -0.048116, 1.051998))
    ),
    "no green": np.array(
        ((0.367322, 0.860646, -0.227968), (0.280085, 0.672501, 0.047413), (-0.011820, 0.042940, 0.968881))
    ),
    "no blue": np.array(
        ((1.255528, -0.076749, -0.178779), (-0.078411, 0.930809, 0.147602), (0.004733, 0.691367, 0.303900))
    ),
}
APART = 18.0  # CIE76: eight times what is just seen of large fields side by side
DARK, LIGHT = (13, 13, 13), (255, 255, 255)  # what plots are drawn on
SIDE_BY_SIDE: dict[str, dict[str, palette.Colour]] = {
    "the two attitudes": {"quaternion": palette.QUATERNION, "Euler": palette.EULER},
    "body axes": {name: palette.LEVEL_AXES[axis] for axis, name in enumerate(("forward", "right", "down"))},
    "disagreement": {name: colour for name, (colour, _) in panels._POWERS.items()},
    "legend": {str(name): colour for name, (_, colour) in scene.LEGEND.items()},
    "vehicles": {str(place): colour for place, colour in enumerate(scene._VEHICLES)},
    "states": {"ok": palette.OK, "no compare": palette.UNKNOWN, "alarm": palette.ALARM, "not yet": palette.NOT_YET},
}
LINES = ("the two attitudes", "body axes", "disagreement")


def lab(colour: tuple[int, int, int], kind: str) -> Array:
    """A colour as somebody sees it, in CIE L*a*b* (D65)."""
    share = np.array(colour) / 255
    light = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    light = np.clip(SEEN_BY[kind] @ light, 0, 1)
    to_xyz = np.array(((0.4124, 0.3576, 0.1805), (0.2126, 0.7152, 0.0722), (0.0193, 0.1192, 0.9505)))
    x, y, z = np.cbrt(np.maximum(to_xyz @ light / (0.9505, 1.0, 1.089), 1e-9))
    return np.array((116 * y - 16, 500 * (x - y), 200 * (y - z)))


def apart(one: tuple[int, int, int], other: tuple[int, int, int], kind: str) -> float:
    return float(np.linalg.norm(lab(one, kind) - lab(other, kind)))


def test_the_measure_is_that_of_the_books() -> None:
    """White is L* 100, pure red (53.2, 80.1, 67.2); who sees no red takes red for much darker, and grey for grey."""
    assert lab((255, 255, 255), "all") == pytest.approx((100, 0, 0), abs=0.05)
    assert lab((255, 0, 0), "all") == pytest.approx((53.24, 80.09, 67.20), abs=0.1)
    assert lab((255, 0, 0), "no red")[0] < 45
    for kind in SEEN_BY:
        assert lab((128, 128, 128), kind) == pytest.approx(lab((128, 128, 128), "all"), abs=0.5)


@pytest.mark.parametrize("kind", SEEN_BY)
@pytest.mark.parametrize("name", SIDE_BY_SIDE)
def test_what_stands_side_by_side_is_told_apart(name: str, kind: str) -> None:
    """Each pair differs by eight times what is just seen."""
    for (one, colour), (other, beside) in itertools.combinations(SIDE_BY_SIDE[name].items(), 2):
        assert apart(colour, beside, kind) > APART, (one, other, apart(colour, beside, kind))


@pytest.mark.parametrize("kind", SEEN_BY)
def test_lines_are_seen_on_dark_and_on_light(kind: str) -> None:
    """Of each line both of a dark and of a light viewer's plots."""
    for name in LINES:
        for line, colour in SIDE_BY_SIDE[name].items():
            assert min(apart(colour, DARK, kind), apart(colour, LIGHT, kind)) > APART, line
