"""Live is as recorded: at the speed at which it was flown, over real sockets."""

from concurrent.futures import ThreadPoolExecutor

import pytest

from tests.helpers.all_fixtures import differences, over_tcp, over_udp
from tests.helpers.live_links import fixture, recorded_judgement, tlog_of

SECONDS = 20


@pytest.mark.slow
def test_twenty_seconds_of_three_flights() -> None:
    """A copter with a fault, two vehicles, a reboot, over UDP and TCP: judged as recorded, and so is what was recorded.

    All six at once, as each takes its twenty seconds.
    """
    flights = [
        fixture("a_copter_square", to_s=SECONDS, fault="yaw_offset:25"),
        fixture("e_two_vehicles", to_s=SECONDS),
        fixture("f_reboot", to_s=SECONDS),
    ]
    assert any(vehicle["alarms"] for vehicle in recorded_judgement(tlog_of(flights[0])))
    with ThreadPoolExecutor(6) as pool:
        runs = [pool.submit(differences, flight, way) for flight in flights for way in (over_udp, over_tcp)]
        assert [run.result() for run in runs] == [""] * 6
