"""The `Monitor` of other programs is the one inside, with plain events."""

from inspect import signature

from gcs_bridge import Monitor
from gcs_bridge.chunks import Chunk, Framing
from gcs_bridge.contract import plain
from gcs_bridge.judging import monitor
from tests.helpers.live_links import fixture, tlog_of


def test_it_has_every_method_of_the_one_inside() -> None:
    """Under the same names, with the same arguments; but for what readers, links and the doctor alone make use of."""
    alone = ("census", "doctor_waits", "beside")
    inner = {"scan", "judge", "frames_of", "censuses", "calm_s", "is_asked", "answer"}
    public = {name for name in vars(monitor.Monitor) if not name.startswith("_")} - inner
    assert public == {name for name in vars(Monitor) if not name.startswith("_")}
    for name in [*public, "__init__"]:
        inside, outside = getattr(monitor.Monitor, name), getattr(Monitor, name)
        if callable(inside):
            offered = [one for one in signature(inside).parameters.values() if one.name not in alone]
            assert offered == list(signature(outside).parameters.values())


def test_its_events_are_those_inside() -> None:
    """As dicts, whichever way the bytes were given."""
    data = tlog_of(fixture("a_copter_square", from_s=75, to_s=81, fault="yaw_offset:25"))
    inside = [plain(event) for event in monitor.Monitor().feed_recording(data)]
    assert "alarm_raised" in {event["event"] for event in inside}
    assert Monitor().feed_recording(data) == Monitor().take([Chunk(data, -1, Framing.RECORDS)]) == inside
