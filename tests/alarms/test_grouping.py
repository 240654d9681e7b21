"""Which raises belong together, at the borders of the rule."""

from gcs_bridge.alarms.grouping import RaiseGrouping
from gcs_bridge.settings import AlarmSettings


def grouped(*raises: tuple[float, str]) -> list[str | None]:
    grouping = RaiseGrouping(AlarmSettings())
    return [grouping.group(name, round(t_s * 1e6)) for t_s, name in raises]


def test_where_the_borders_of_groups_are() -> None:
    """A repeat within 30 s, three in less than 60 s, ten in less than 600 s; the border itself is outside."""
    assert grouped((0, "a"), (29.999999, "a")) == [None, "repeat"]
    assert grouped((0, "a"), (30, "a")) == [None, None]
    assert grouped((0, "a"), (1, "b")) == [None, None]
    assert grouped((0, "a"), (30, "a"), (59.999999, "a"))[-1] == "chatter"
    assert grouped((0, "a"), (30, "a"), (60, "a"))[-1] is None
    minutes = [(60.0 * i, name) for i, name in enumerate("abcdefghij")]
    assert grouped(*minutes) == [None] * 9 + ["flood"]
    assert grouped(*minutes[:9], (600.0, "j"))[-1] is None
    assert grouped(*minutes[:9], (599.999999, "j"))[-1] == "flood"
