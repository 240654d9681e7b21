"""The plot of the disagreement: bars as high as the values, the limit where it is, gaps where nothing was compared."""

from msgspec.structs import replace

from gcs_bridge.judging.snapshot import CheckNow, VehicleNow
from gcs_bridge.screen.canvas import Canvas
from gcs_bridge.screen.history import History, Second
from gcs_bridge.screen.plot import draw_plot
from tests.helpers.seen_now import alarm, vehicle


def at(value: float, t_boot_s: float = 0.0, limit: float = 0.5) -> VehicleNow:
    check = CheckNow(name="euler_quaternion", verdict="agree", alarms=(alarm(value, limit, t_boot_s=t_boot_s),))
    return vehicle(checks=(check,))


def plotted(*seconds: Second | None, width: int = 30, height: int = 4) -> list[str]:
    canvas = Canvas(width, height)
    draw_plot(canvas.whole, seconds)
    return ["".join(row) for row in canvas.signs]


def test_a_bar_is_as_high_as_its_value() -> None:
    """On a scale to 30°: 25° fill 3⅓ of four rows, 7.5° one; the latest stands at the right."""
    rows = plotted(Second(7.5, 0.5), Second(25.0, 0.5))
    assert [row[-1] for row in rows] == ["▃", "█", "█", "█"]
    assert [row[-2] for row in rows] == [" ", " ", " ", "█"]
    assert rows[0].split()[0] == "30°"


def test_the_limit_lies_across() -> None:
    """Healthy, it is the middle of the plot, twice the limit its top; a value below it leaves it visible."""
    rows = plotted(*[Second(1e-6, 0.5)] * 10)
    assert rows[0].split()[0] == "1°"
    assert [row[-10:] for row in rows] == [" " * 10, "┄" * 10, " " * 10, " " * 10]


def test_what_was_not_compared_is_a_gap() -> None:
    """Neither a bar nor a limit."""
    rows = plotted(Second(0.4, 0.5), None, Second(0.4, 0.5))
    assert [row[-2] for row in rows] == [" "] * 4
    assert rows[3][-1] == rows[3][-3] == "█"


def test_the_largest_of_a_second_is_kept() -> None:
    """Looked at four times a second; what was seen before counts no second time."""
    history = History()
    for now_s, value, t_boot_s in ((10.0, 0.1, 1.0), (10.3, 9.0, 1.3), (10.6, 0.2, 1.6), (11.1, 0.3, 2.1)):
        history.look(at(value, t_boot_s), now_s)
    history.look(at(0.3, 2.1), 12.4)  # nothing came since
    assert history.last(9) == [Second(9.0, 0.5), Second(0.3, 0.5), None]
    assert history.last(1) == [None]
    assert history.last(0) == []


def test_a_pause_is_a_gap_and_memory_does_not_grow() -> None:
    """Stopped for a day, it holds ten minutes of nothing, and then goes on."""
    history = History()
    history.look(at(0.1, 1.0), 0.0)
    history.look(at(0.1, 9.0), 86_400.0)
    assert len(history.last(10_000)) == 600
    assert history.last(2) == [None, Second(0.1, 0.5)]


def test_what_is_no_number_is_left_out() -> None:
    """NaN, and a vehicle of which nothing was compared."""
    history = History()
    history.look(at(float("nan"), 1.0), 1.0)
    history.look(replace(vehicle(), checks=()), 2.0)
    assert history.last(5) == [None, None]
