"""What whoever looks on is shown: vehicles, from their first sample on, and nothing else."""

from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.judging.observation import Observation
from tests.helpers import wire

INVALID, GIMBAL = 8, 26  # MAV_AUTOPILOT_INVALID, MAV_TYPE_GIMBAL


def shown(records: list[tuple[int, bytes]], cuts: int) -> dict[str, int]:
    """How many attitudes of each component are shown, of a recording that comes in so many pieces."""
    counts: dict[str, int] = {}

    def observe(observation: Observation) -> None:
        name = observation.vehicle.name
        counts[name] = counts.get(name, 0) + len(observation.segment.euler)

    monitor = Monitor(observer=observe)
    data = wire.tlog(records)
    size = -(-len(data) // cuts)
    for at in range(0, len(data), size):
        monitor.feed_recording(data[at : at + size])
    monitor.finish()
    return counts


def attitudes(count: int, compid: int) -> list[tuple[int, bytes]]:
    return [
        (wire.START_US + 100_000 * i + compid, wire.attitude(1000 + 100 * i, (0.1, 0.2, 0.3), compid=compid, seq=i))
        for i in range(count)
    ]


def test_a_component_that_is_no_vehicle_is_not_shown() -> None:
    """A gimbal that says so and sends attitudes, and one that has sent too few to be known; the vehicle is."""
    said = wire.heartbeat(autopilot=INVALID, vehicle=GIMBAL, compid=154)
    records = [(wire.START_US, said), *attitudes(50, 154), *attitudes(50, 1), *attitudes(5, 7)]
    records.sort()
    for cuts in (1, 7, 200):
        assert shown(records, cuts) == {"1.1": 50}


def test_a_vehicle_is_shown_from_its_beginning() -> None:
    """Its attitudes before its first heartbeat, too, by which it is known: once, and in their order."""
    records = [*attitudes(8, 1), (wire.START_US + 10_000_000, wire.heartbeat(seq=8))]
    records += [(t_us + 20_000_000, frame) for t_us, frame in attitudes(8, 1)]
    for cuts in (1, 5, 100):
        assert shown(records, cuts) == {"1.1": 16}
