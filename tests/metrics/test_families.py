"""What is exported of a flight: by the frames that were sent, never by what the program says of itself."""

import re
import struct
from collections.abc import Callable, Sequence

import pytest
from prometheus_client import CollectorRegistry, generate_latest

from gcs_bridge.events import AlarmRaised, Event, vehicle_of
from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.metrics.families import FAMILIES, SnapshotCollector
from gcs_bridge.metrics.published import Published, Raised
from gcs_bridge.metrics.text import Writer
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from tests.helpers import wire
from tests.helpers.paths import ROOT
from tests.helpers.scraped import PREFIX, Scraped, assert_counters_went_on

S = 1_000_000
LINK = "udpin:127.0.0.1:14550"
HEALTHY = wire.flight(wire.Motion(8.0, seed=3), 8.0)
FAULTY = list(wire.records(inject(wire.tlog(HEALTHY), [parse_fault("yaw_offset:25")], from_s=2.0)))
Records = Sequence[tuple[int, bytes]]


class Run:
    """A monitor, and what is scraped of it; `most` vehicles of a link are listed."""

    def __init__(self, *links: str, most: int = 64) -> None:
        self.monitor = Monitor()
        self._collector = SnapshotCollector(links or (LINK,))
        self._writer = Writer(generate_latest)
        self._most = most
        self._raises: dict[Raised, int] = {}
        for number in range(len(links) or 1):
            self.monitor.open_link(number, datagrams=True)

    def tell(self, events: list[Event]) -> None:
        for event in events:
            if isinstance(event, AlarmRaised):
                raised = Raised(vehicle_of(event), event.check or "", event.severity)
                self._raises[raised] = self._raises.get(raised, 0) + 1

    def fly(self, records: Records, link: int = 0) -> None:
        for at in range(0, len(records), 20):
            self.tell(self.monitor.feed_datagrams([(data, t_us) for t_us, data in records[at : at + 20]], link))

    def pass_time(self, t_rx_us: int) -> None:
        self.tell(self.monitor.advance(t_rx_us))

    def text(self) -> str:
        snapshot = self.monitor.snapshot(most_vehicles=self._most)
        published = Published(snapshot, dict(self._raises))
        return self._writer.text(self._collector.collect(published), CollectorRegistry()).decode()

    def scrape(self) -> Scraped:
        return Scraped(self.text())


def later(records: Records, by_us: int) -> list[tuple[int, bytes]]:
    """The same frames, received later."""
    return [(t_us + by_us, data) for t_us, data in records]


# --- what a flight shows ---------------------------------------------------------------------------------------------


def test_a_healthy_flight() -> None:
    """Frames, messages, ages and states are those of what was sent; nothing differs, and nothing was raised."""
    run = Run()
    run.fly(HEALTHY)
    run.pass_time(HEALTHY[-1][0] + S // 2)
    seen = run.scrape()
    assert seen.one("link_up", link=LINK) == 1
    assert seen.one("bytes_total", link=LINK) == sum(len(data) for _, data in HEALTHY)
    assert seen.one("skipped_bytes_total") == seen.one("damaged_frames_total") == 0
    assert seen.one("frames_total", vehicle="1.1") == len(HEALTHY) == 8 + 200 + 200
    assert seen.one("frames_total", vehicle="others") == 0
    assert seen.one("lost_frames_total", link=LINK, vehicle="1.1") == 0
    assert seen.one("vehicle_age_seconds") == pytest.approx(0.5)
    for message in ("ATTITUDE", "ATTITUDE_QUATERNION"):
        assert seen.one("messages_total", link=LINK, vehicle="1.1", message=message) == 200
        assert seen.one("message_age_seconds", message=message) == pytest.approx(0.5)
    assert seen.state("euler_quaternion") == "normal"
    assert seen.state("gravity") == seen.state("secondary_estimate") == "no_compare"  # nothing of it came
    assert seen.one("residual_degrees", check="euler_quaternion", alarm="pairs") < 1e-3
    assert 0.5 < seen.one("limit_degrees", check="euler_quaternion", alarm="pairs") < 0.6
    assert {value for _, value in seen.all("alarms_total")} == {0}
    assert seen.one("unlisted_vehicles", link=LINK) == 0


def test_a_fault() -> None:
    """25° of yaw are 25°, 40 to 50 times the limit, and one alarm, counted once."""
    run = Run()
    run.fly(FAULTY)
    seen = run.scrape()
    here = {"link": LINK, "vehicle": "1.1", "check": "euler_quaternion"}
    assert seen.one("residual_degrees", alarm="pairs", **here) == pytest.approx(25.0, abs=1e-3)
    assert 40 < seen.one("residual_ratio", alarm="pairs", **here) < 50
    assert seen.state("euler_quaternion") == "alarm"
    assert seen.one("alarms_total", severity="alarm", **here) == 1
    assert seen.state("gyro") == "no_compare"


def test_ratios_have_every_unit_degrees_only_theirs() -> None:
    """Rates and norms have a ratio; a residual in degrees is one of a check that measures angles."""
    run = Run()
    run.fly(HEALTHY)
    seen = run.scrape()
    checks = {labels["check"] for labels, _ in seen.all("residual_degrees")}
    assert checks == {labels["check"] for labels, _ in seen.all("limit_degrees")}
    assert "euler_quaternion" in checks
    assert not checks & {"body_rates", "quaternion_norm", "stream", "gyro"}
    assert {"body_rates", "quaternion_norm"} <= {labels["check"] for labels, _ in seen.all("residual_ratio")}


def test_what_stops_leaves_a_gap() -> None:
    """A stream that stops takes its residual with it: that was before; age and state say so."""
    run = Run()
    half = HEALTHY[len(HEALTHY) // 2][0]
    euler_alone = [one for one in HEALTHY if one[0] < half or one[1][7] != 31]
    run.fly([one for one in euler_alone if one[0] < half + 100_000])
    assert run.scrape().all("residual_degrees", check="euler_quaternion")
    run.fly([one for one in euler_alone if one[0] >= half + 100_000])
    more = wire.flight(wire.Motion(8.0, seed=4), 3.0, quaternion_hz=0, start_us=HEALTHY[-1][0], boot_ms=18_000)
    run.fly(more)
    seen = run.scrape()
    assert seen.all("residual_degrees", check="euler_quaternion") == []
    assert seen.state("euler_quaternion") == "no_compare"
    assert seen.one("message_age_seconds", message="ATTITUDE_QUATERNION") > 6
    assert seen.one("message_age_seconds", message="ATTITUDE") < 0.1


def test_nothing_yet() -> None:
    """Before the first byte: the link is up, and there is nothing else but what counts from 0."""
    seen = Run().scrape()
    assert seen.one("link_up", link=LINK) == 1
    assert seen.one("frames_total", vehicle="others") == 0
    assert seen.all("alarm_state") == []


# --- counters --------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_counters_never_go_back() -> None:
    """Late frames, a lost vehicle that returns, a link that closes and opens, a restart, damage: all only count on."""
    run = Run()
    held = HEALTHY[100]
    late = [*HEALTHY[:100], *HEALTHY[101:104], (HEALTHY[104][0], held[1]), *HEALTHY[104:]]
    end_us = HEALTHY[-1][0]
    restarted = wire.flight(wire.Motion(8.0, seed=5), 8.0, start_us=end_us + 40 * S, boot_ms=100)
    broken = [(t_us, data[:-1] + bytes((data[-1] ^ 1,))) for t_us, data in restarted[:5]]
    steps: list[Callable[[], None]] = [
        lambda: run.fly(late[:103]),  # one is missing
        lambda: run.fly(late[103:]),  # and comes late
        lambda: run.pass_time(end_us + 20 * S),  # lost
        lambda: run.fly(later(HEALTHY[-20:], 21 * S)),
        lambda: run.tell(run.monitor.close_link(0, end_us + 30 * S)),
        lambda: run.monitor.open_link(0, datagrams=True),
        lambda: run.fly(broken),
        lambda: run.fly(restarted),
    ]
    before = run.scrape()
    lost = []
    for step in steps:
        step()
        after = run.scrape()
        assert_counters_went_on(before, after)
        lost.append(after.one("lost_frames_total"))
        before = after
    assert lost[0] == 1
    assert before.one("damaged_frames_total") == 5
    assert before.one("messages_total", message="ATTITUDE") >= 400
    assert before.one("link_up") == 1


def test_a_link_that_has_gone() -> None:
    """It is down, and what is known of its vehicles stays, and ages."""
    run = Run()
    run.fly(HEALTHY)
    end_us = HEALTHY[-1][0]
    run.monitor.close_link(0, end_us)
    run.pass_time(end_us + 60 * S)
    seen = run.scrape()
    assert seen.one("link_up") == 0
    assert seen.one("vehicle_age_seconds") == pytest.approx(60.0)
    assert seen.state("euler_quaternion") == "no_compare"
    assert seen.all("residual_degrees") == []


# --- who is listed ---------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_two_links() -> None:
    """The same vehicle on both has its series on each, under the link's name."""
    run = Run("udpin:0.0.0.0:14550", "/dev/ttyACM0")
    run.fly(HEALTHY, link=0)
    run.fly(FAULTY, link=1)
    seen = run.scrape()
    states = {
        labels["link"]: labels["state"]
        for labels, value in seen.all("alarm_state", check="euler_quaternion", vehicle="1.1")
        if value
    }
    assert states == {"udpin:0.0.0.0:14550": "normal", "/dev/ttyACM0": "alarm"}
    assert seen.one("alarms_total", link="/dev/ttyACM0", check="euler_quaternion", severity="alarm") == 1
    assert seen.one("alarms_total", link="udpin:0.0.0.0:14550", check="euler_quaternion", severity="alarm") == 0


@pytest.mark.slow
def test_made_up_vehicles_have_no_series() -> None:
    """Some with enough to be judged, hundreds with a heartbeat: as many series as vehicles that may be listed.

    They are counted; who came first stays, whoever comes later, and all frames are somebody's.
    """
    run = Run(most=3)
    run.fly(HEALTHY[:100])
    first = run.scrape()
    made_up: list[tuple[int, bytes]] = []
    at_us = HEALTHY[100][0]
    for system in range(2, 12):
        made_up += wire.flight(wire.Motion(8.0, seed=3), 0.2, start_us=at_us, sysid=system)
    made_up += [(at_us, wire.heartbeat(sysid=system, compid=1)) for system in range(20, 250)]
    run.fly(made_up)
    run.fly(HEALTHY[100:])
    seen = run.scrape()
    assert {labels["vehicle"] for labels, _ in seen.all("alarm_state")} == {"1.1", "2.1", "3.1"}
    assert seen.one("unlisted_vehicles") == 8 + 230
    assert seen.one("frames_total", vehicle="1.1") == len(HEALTHY)
    assert sum(value for _, value in seen.all("frames_total")) == len(HEALTHY) + len(made_up)
    assert_counters_went_on(first, seen)


def test_a_ground_station_is_no_vehicle() -> None:
    """Its frames are others'."""
    run = Run()
    station = [
        (t_us, wire.heartbeat(autopilot=wire.NO_AUTOPILOT, vehicle=wire.GROUND_STATION, sysid=255, compid=190, seq=seq))
        for seq, (t_us, _) in enumerate(HEALTHY[::50])
    ]
    run.fly(sorted([*HEALTHY, *station]))
    seen = run.scrape()
    assert seen.one("frames_total", vehicle="others") == len(station)
    assert seen.one("frames_total", vehicle="1.1") == len(HEALTHY)


@pytest.mark.parametrize("name", ['a"b', "a\\b", "a\nb", "tty\udcff", "ä→"])
def test_names_of_links_are_written_as_text(name: str) -> None:
    """Quotes, backslashes, line ends and what is no text at all: read back, it is the name that events have."""
    (labels, value), *_ = Run(name).scrape().all("link_up")
    assert labels["link"] == name.replace("\udcff", "\\xff")
    assert value == 1


def test_numbers_that_are_none_have_no_sample() -> None:
    """NaN in every attitude: no residual says 0 or NaN."""
    nan = struct.unpack("<f", b"\0\0\xc0\x7f")[0]
    run = Run()
    frames = [(wire.START_US + 40_000 * i, wire.attitude(1000 + 40 * i, (nan,) * 3, seq=i)) for i in range(60)]
    beats = [(t_us, wire.heartbeat(seq=i + 60)) for i, (t_us, _) in enumerate(frames[::25])]
    run.fly([*frames, *beats])
    seen = run.scrape()
    assert seen.one("messages_total", message="ATTITUDE") == 60
    assert all(value == value and abs(value) < 1e18 for _, _, value in seen.samples)


# --- the form --------------------------------------------------------------------------------------------------------


def test_names_and_kinds() -> None:
    """The names that were promised are there, and what counts is a counter, what is measured a gauge."""
    run = Run()
    run.fly(FAULTY)
    kinds = run.scrape().kinds
    counters = {"frames_total", "damaged_frames_total", "lost_frames_total"}
    gauges = {"message_age_seconds", "residual_degrees", "limit_degrees", "alarm_state"}
    assert {kinds[name] for name in counters} == {"counter"}
    assert {kinds[name] for name in gauges} == {"gauge"}
    assert set(kinds) == {family.name for family in FAMILIES}


def test_the_page_lists_what_is_exported() -> None:
    """docs/metrics.md: every family with its labels, and no other."""
    page = (ROOT / "docs" / "metrics.md").read_text(encoding="utf-8")
    section = page.split("## What is exported")[1].split("\n- **")[0]
    rows = re.findall(r"^\| `(\w+)` \| ([\w, ]+) \|", section, re.MULTILINE)
    assert [(name, tuple(labels.split(", "))) for name, labels in rows] == [
        (family.name, family.labels) for family in FAMILIES
    ]


@pytest.mark.parametrize(
    "path",
    [
        "config/prometheus-alerts.yml",
        "config/grafana-dashboard.json",
        "docs/metrics.md",
        "tests/metrics/alerts_test.yml",
    ],
)
def test_what_is_asked_for_is_exported(path: str) -> None:
    """Rules, dashboard and page ask for no name that is not there, nor for a label that it has not."""
    labels = {family.full_name: {*family.labels, "job", "instance"} for family in FAMILIES}
    asked = re.findall(rf"\b({PREFIX}\w+)(?:\{{([^}}]*)\}})?", (ROOT / path).read_text(encoding="utf-8"))
    assert asked
    for name, matchers in asked:
        assert name in labels, name
        assert set(re.findall(r'(\w+)\s*=~?\s*\\?"', matchers)) <= labels[name], (name, matchers)
