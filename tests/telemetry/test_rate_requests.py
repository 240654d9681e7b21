"""Who asked for which rate, told as stories: what is a change, whose wish it undoes, and who undoes whom."""

from gcs_bridge.telemetry.rate_requests import RateRequest, RateWishes
from gcs_bridge.telemetry.statements import ParameterSet

ONE, OTHER = (255, 190), (254, 230)
Wish = tuple[tuple[int, int] | None, float | None]


def asked(*wishes: Wish, how: str = "REQUEST_DATA_STREAM") -> list[tuple[Wish, tuple[int, int] | None, bool]]:
    """Each change: who asked for what, instead of whom, and whether the two undo each other."""
    kept = RateWishes()
    requests = [RateRequest(i, -1, (1, 1), by, how, (0, 1), hz) for i, (by, hz) in enumerate(wishes)]
    changes = [change for one in requests for change in kept.take([one], [])]
    return [((one.request.by, one.request.rate_hz), one.instead_of, one.undo_each_other) for one in changes]


def test_what_was_asked_for_already_is_no_change() -> None:
    """Said again, or by somebody else: the rate is the one that it is."""
    assert asked((ONE, 4.0), (ONE, 4.0), (OTHER, 4.0)) == [((ONE, 4.0), None, False)]


def test_another_rate_of_one_station_undoes_nobodys_wish() -> None:
    """It has changed its mind."""
    assert asked((ONE, 4.0), (ONE, 10.0)) == [((ONE, 4.0), None, False), ((ONE, 10.0), None, False)]


def test_two_stations_that_undo_each_other() -> None:
    """The second one is told of the first; when that asks again, they undo each other."""
    assert asked((ONE, 4.0), (OTHER, 10.0), (ONE, 4.0), (OTHER, 10.0)) == [
        ((ONE, 4.0), None, False),
        ((OTHER, 10.0), ONE, False),
        ((ONE, 4.0), OTHER, True),
        ((OTHER, 10.0), ONE, True),
    ]


def test_a_parameter_is_changed_by_whoever_sets_it_and_not_by_its_echo() -> None:
    """Read as 10, set to 4, told as 4: one change; told as 2 later: by somebody who is not heard."""
    kept = RateWishes()
    setting = RateRequest(2, -1, (1, 1), ONE, "SR0_EXTRA1", (0, 1), 4.0)
    told = [ParameterSet(frame, "SR0_EXTRA1", value) for frame, value in ((1, 10.0), (3, 4.0), (4, 4.0), (9, 2.0))]
    changes = list(kept.take([setting], told))
    assert [(change.request.frame_index, change.request.by, change.request.rate_hz) for change in changes] == [
        (2, ONE, 4.0),
        (9, None, 2.0),
    ]


def test_a_request_is_for_a_vehicle_or_for_all() -> None:
    """Zero means everybody."""
    for target, is_for in (((1, 1), True), ((1, 0), True), ((0, 0), True), ((2, 1), False), ((1, 2), False)):
        assert RateRequest(0, -1, target, ONE, "REQUEST_DATA_STREAM", (0,), 4.0).is_for((1, 1)) == is_for
