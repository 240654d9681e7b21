"""What an alarm's record says of where a difference lies, and of how much it was."""

import numpy as np
import pytest

from gcs_bridge.alarms.rated import Worst
from gcs_bridge.alarms.record import AlarmRecord, axis_of

NAN = float("nan")


@pytest.mark.parametrize(
    ("tilt", "heading", "vector", "axis"),
    [
        (6, 0, (6, 0, 0), "tilt, about body x (roll)"),
        (6, 0, (0, -6, 0), "tilt, about body y (pitch)"),
        (6, 0, (4.2, 4.2, 0), "tilt"),
        (0, -25, (0, 0, -25), "heading"),
        (0, 25, (-17, 0, 18), "heading"),  # pitched by 45°: still about down
        (3, 5.2, (6, 0, 0), "tilt and heading, about body x (roll)"),
        (5, 5, (4, 3, 5), "tilt and heading"),
        (170, NAN, (0, 170, 0), "tilt, about body y (pitch)"),
        (NAN, NAN, (0, 3, 0), "body y (pitch)"),  # no attitude: a rate
        (NAN, NAN, (2, 2, 2), None),
        (NAN, NAN, (NAN, NAN, NAN), None),
        (0, 0, (0, 0, 0), None),
    ],
)
def test_where_a_difference_lies(tilt: float, heading: float, vector: tuple[float, ...], axis: str | None) -> None:
    """Its parts are named first; a body axis only where the turn is about it, and not where it is about down."""
    assert axis_of(np.radians([tilt, heading, *vector])) == axis


def test_a_record_keeps_the_peak_and_what_came_with_it() -> None:
    """The largest value of all that it is shown, in degrees, with its own parts; a smaller one changes nothing."""
    record = AlarmRecord.new(alarm_id="", check="", severity="alarm", boot=0, what="", is_not="", unit="deg")
    record.show(Worst(np.radians(6.0), np.radians([6.0, NAN, 6.0, 0.0, 0.0])))
    record.show(Worst(np.radians(5.0), np.radians([0.0, 5.0, 0.0, 0.0, 5.0])))
    assert (record.peak, record.tilt) == pytest.approx((6.0, 6.0))
    assert (record.heading, record.axis) == (None, "tilt, about body x (roll)")
    assert record.rotvec_body == pytest.approx([6.0, 0.0, 0.0])


def test_a_peak_without_a_direction() -> None:
    """Seconds stay seconds, and what has no parts shows none."""
    record = AlarmRecord.new(alarm_id="", check="", severity="alarm", boot=0, what="", is_not="", unit="s")
    record.show(Worst(2.5, np.full(5, NAN)))
    assert (record.peak, record.tilt, record.rotvec_body, record.axis) == (2.5, None, None, None)
