"""How long nothing can be raised: while that is so, who listens may judge several bursts at once."""

import pytest

from gcs_bridge.events import AlarmCleared, AlarmEvent, AlarmPending, AlarmRaised
from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from tests.helpers import wire

ON_DELAY_S, BOOT_S = 1.0, 10.0  # of the default profile; the boot clock at the start of wire.flight


def flown(seconds: float, fault: str, from_s: float, to_s: float) -> list[tuple[int, bytes]]:
    healthy = wire.tlog(wire.flight(wire.Motion(seconds, seed=3), seconds, euler_hz=10.0, quaternion_hz=10.0))
    return list(wire.records(inject(healthy, [parse_fault(fault)], from_s=from_s, to_s=to_s)))


def test_nothing_is_raised_or_cleared_while_it_is_calm() -> None:
    """Whatever is raised, or goes, was announced by a frame before: from then on it was not calm any more."""
    monitor = Monitor()
    calm_from_s: list[float] = []  # boot times behind which nothing was on its way
    told: list[AlarmEvent] = []
    for t_us, frame in flown(20.0, "yaw_offset:25", 6.0, 12.0):
        events = monitor.feed(frame, t_us)
        told += [event for event in events if isinstance(event, AlarmPending | AlarmRaised | AlarmCleared)]
        if monitor.calm_s():
            assert monitor.calm_s() == ON_DELAY_S
            calm_from_s.append((t_us - wire.START_US) / 1e6 + BOOT_S)
    (raised,) = (event for event in told if isinstance(event, AlarmRaised))
    (cleared,) = (event for event in told if isinstance(event, AlarmCleared))
    for event in (raised, cleared):
        assert event.boot_s is not None
        assert not [t_s for t_s in calm_from_s if event.boot_s - ON_DELAY_S < t_s < event.boot_s]
    # And most of the flight was calm: before it, while it stood, and behind it.
    assert raised.boot_s is not None
    assert cleared.boot_s is not None
    for since_s, until_s in ((13.0, 15.9), (raised.boot_s, cleared.boot_s - 2.5), (cleared.boot_s, 29.9)):
        assert min(t_s for t_s in calm_from_s if t_s >= since_s) < since_s + 0.2
        assert max(t_s for t_s in calm_from_s if t_s <= until_s) > until_s - 0.2


def test_before_a_vehicle_is_there_nothing_is_calm() -> None:
    """What is there first is told at once: a link, its first vehicle, its streams."""
    monitor = Monitor()
    assert monitor.calm_s() == 0.0
    monitor.feed(wire.heartbeat(), wire.START_US)
    assert monitor.calm_s() == 0.0


@pytest.mark.slow
def test_a_vehicle_that_is_lost_keeps_nobody_waiting() -> None:
    """Nor does one that never comes back keep the loop from being calm about the others."""
    monitor = Monitor()
    stays = wire.flight(wire.Motion(15.0, seed=3), 15.0, euler_hz=10.0, quaternion_hz=10.0)
    leaves = wire.flight(wire.Motion(3.0, seed=4), 3.0, sysid=2, euler_hz=10.0, quaternion_hz=10.0)
    for t_us, frame in sorted([*stays, *leaves]):
        monitor.feed(frame, t_us)
        at_s = (t_us - wire.START_US) / 1e6
        if 6.0 < at_s < 7.0:
            assert monitor.calm_s() == 0.0  # its streams are stale, and an alarm of that stands
        if at_s > 12.0:
            assert monitor.calm_s() == ON_DELAY_S
