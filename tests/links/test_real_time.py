"""Live is as recorded: at the speed at which it was flown, over real sockets."""

from concurrent.futures import ThreadPoolExecutor

import pytest

from tests.helpers.all_fixtures import differences, over_tcp, over_udp
from tests.helpers.live_links import fixture, recorded_judgement, tlog_of


@pytest.mark.slow
def test_some_seconds_of_three_flights() -> None:
    """A copter with a fault, two vehicles, a reboot, over UDP and TCP: judged as recorded, and so is what was recorded.

    All six at once, as each takes its seconds; `all_fixtures` flies all recordings to their ends.
    """
    flights = [
        fixture("a_copter_square", from_s=75, to_s=79.5, fault="yaw_offset:25"),
        fixture("e_two_vehicles", to_s=4.5),
        fixture("f_reboot", from_s=10.5, to_s=15),
    ]
    fault, _, reboot = (recorded_judgement(tlog_of(flight))[0] for flight in flights)
    assert fault["alarms"]
    assert len(reboot["boots"]) == 2
    with ThreadPoolExecutor(6) as pool:
        runs = [pool.submit(differences, flight, way) for flight in flights for way in (over_udp, over_tcp)]
        assert [run.result() for run in runs] == [""] * 6
