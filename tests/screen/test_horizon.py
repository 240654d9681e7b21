"""The artificial horizon turns the right way: facts that any pilot could check by hand."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from gcs_bridge.screen.canvas import Canvas, Role
from gcs_bridge.screen.horizon import draw_heading, draw_horizon
from tests.helpers.seen_now import quaternion

WIDTH, HEIGHT = 41, 21  # odd: there is a middle
MIDDLE = HEIGHT // 2
EDGES = " ▁▂▃▄▅▆▇█"


def picture(roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0) -> Canvas:
    canvas = Canvas(WIDTH, HEIGHT)
    draw_horizon(canvas.whole, quaternion(roll, pitch, yaw))
    return canvas


def ground(canvas: Canvas, column: int) -> float:
    """How many rows of a column are ground; the vehicle's own sign counts as half."""

    def share(sign: str, role: Role) -> float:
        filled = EDGES.find(sign) / 8
        return {Role.GROUND: 1.0, Role.SKY: 0.0, Role.EDGE: filled, Role.EDGE_UPSIDE_DOWN: 1 - filled}.get(role, 0.5)

    rows = zip(canvas.signs, canvas.roles, strict=True)
    return sum(share(signs[column], roles[column]) for signs, roles in rows)


def grounds(canvas: Canvas) -> NDArray[np.float64]:
    return np.array([ground(canvas, column) for column in range(WIDTH)])


def test_level_is_level() -> None:
    """Half sky, half ground, everywhere; whatever the heading."""
    for yaw in (0.0, 123.0, -90.0):
        assert grounds(picture(yaw=yaw)) == pytest.approx(HEIGHT / 2, abs=0.5)


@pytest.mark.parametrize("roll", [5.0, 20.0, 40.0])
def test_banked_to_the_right_the_horizon_falls_to_the_left(roll: float) -> None:
    """Right wing down: the world turns anticlockwise, the ground rises at the right, by the tangent of the bank."""
    rise = np.diff(grounds(picture(roll=roll)))
    assert (rise >= -0.13).all()  # an eighth of a row is the finest there is
    columns = np.arange(6, WIDTH - 6)
    fit = np.polyfit(columns, grounds(picture(roll=roll))[columns], 1)[0] if roll < 30 else None
    if fit is not None:
        assert fit == pytest.approx(0.5 * math.tan(math.radians(roll)), rel=0.1)  # a column is half a row wide


def test_left_is_the_mirror_of_right() -> None:
    """Left wing down: the same the other way round."""
    assert grounds(picture(roll=-25.0)) == pytest.approx(grounds(picture(roll=25.0))[::-1], abs=0.26)


def test_the_nose_up_shows_more_sky() -> None:
    """By 10° the horizon is lower, as far as 10° are in a picture that shows 30° up to its border."""
    down_rows = math.tan(math.radians(10)) / math.tan(math.radians(30)) * HEIGHT / 2
    assert grounds(picture(pitch=10.0)) == pytest.approx(HEIGHT / 2 - down_rows, abs=0.5)
    assert grounds(picture(pitch=-10.0)) == pytest.approx(HEIGHT / 2 + down_rows, abs=0.5)


def test_nose_up_in_a_bank_shows_less_ground_under_the_nose() -> None:
    """Pitch is seen at right angles to the horizon, however it lies."""
    assert ground(picture(roll=30.0, pitch=10.0), WIDTH // 2) < HEIGHT / 2 - 2


def test_upside_down_the_ground_is_above() -> None:
    """On its back: the upper half is ground."""
    canvas = picture(roll=180.0)
    assert grounds(canvas) == pytest.approx(HEIGHT / 2, abs=0.5)
    assert canvas.roles[0][0] is Role.GROUND
    assert canvas.roles[HEIGHT - 1][0] is Role.SKY


def test_inverted_and_banked() -> None:
    """Rolled by 160° to the right: what was the ground's right side up has turned on, above it now."""
    canvas = picture(roll=160.0)
    assert canvas.roles[0][0] is Role.GROUND
    # The horizon's line has turned anticlockwise by 160°: as a line that is 20° clockwise, it rises to the left.
    ground_above = grounds(canvas)
    assert ground_above[0] < ground_above[-1]


def test_straight_up_and_down() -> None:
    """At the poles there is nothing but sky, or ground; and nothing goes wrong."""
    for pitch, share in ((90.0, 0.0), (-90.0, HEIGHT)):
        assert grounds(picture(pitch=pitch)) == pytest.approx(share, abs=0.51)


def test_the_same_attitude_is_the_same_picture() -> None:
    """q, −q and 3q are one attitude."""
    q = quaternion(20.0, 5.0, 70.0)
    pictures = []
    for factor in (1.0, -1.0, 3.0):
        canvas = Canvas(WIDTH, HEIGHT)
        draw_horizon(canvas.whole, tuple(factor * part for part in q))  # type: ignore[arg-type]  # four of them
        pictures.append(canvas.text())
    assert pictures[0] == pictures[1] == pictures[2]


def test_marks_are_where_ten_degrees_are() -> None:
    """Level, "10" stands above and below the middle, where 10° of a view of 30° are."""
    rows = [row for row, line in enumerate(picture().text().splitlines()) if "10" in line]
    off = round(math.tan(math.radians(10)) / math.tan(math.radians(30)) * HEIGHT / 2)
    assert rows == [MIDDLE - off, MIDDLE + off]


@pytest.mark.parametrize("size", [(0, 0), (1, 1), (3, 1), (2, 30), (200, 3)])
def test_any_size_will_do(size: tuple[int, int]) -> None:
    """Too small a place is left blank, and nothing is drawn beyond it."""
    canvas = Canvas(*size)
    draw_horizon(canvas.whole, quaternion(33.0, 10.0))
    draw_heading(canvas.whole, 350.0)
    assert all(len(row) == size[0] for row in canvas.signs)


def test_the_heading_runs_to_the_right() -> None:
    """Facing 080°, north-east lies to the left, east to the right, and the middle says 080."""
    canvas = Canvas(61, 1)
    draw_heading(canvas.whole, 80.0)
    line = canvas.text()
    assert line.index("060") < line.index("080") < line.index("E")
    assert abs(line.index("080") + 1 - 30) <= 1
    canvas = Canvas(61, 1)
    draw_heading(canvas.whole, -0.2)
    assert canvas.text().index("330") < canvas.text().index("000") < canvas.text().index("030")
