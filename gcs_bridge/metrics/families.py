"""What is exported: Prometheus's families, each with its labels and its meaning, and how a snapshot fills them.

docs/metrics.md explains them. A counter never goes back while the program runs, and there are as many series as there
are links and listed vehicles, whatever is sent.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric

from gcs_bridge._version import __version__
from gcs_bridge.contract import readable
from gcs_bridge.judging.snapshot import AlarmNow, LinkNow, VehicleNow
from gcs_bridge.metrics.check_state import CHECK_STATES, state_of
from gcs_bridge.metrics.published import Published, Raised, Raises
from gcs_bridge.telemetry.identity import VehicleId

__all__ = ["FAMILIES", "OTHERS", "Family", "Labels", "Samples", "SnapshotCollector"]

Labels = tuple[str, ...]
"""The values of a series' labels, in the order of its family's."""

OTHERS = "others"
"""The `vehicle` of frames of whoever has no series: ground stations, cameras, copies, made-up vehicles."""
_PREFIX = "gcs_bridge_"
_CURRENT_S = 5.0  # a residual that is older is no residual of now, and is left out: a gap, not a line that goes on
_LINK = ("link",)
_VEHICLE = (*_LINK, "vehicle")
_MESSAGE = (*_VEHICLE, "message")
_CHECK = (*_VEHICLE, "check")
_ALARM = (*_CHECK, "alarm")


@dataclass(frozen=True)
class Family:
    """One family: its name without the prefix, its labels, what it tells and in which unit."""

    name: str
    labels: tuple[str, ...]
    help: str

    @property
    def full_name(self) -> str:
        """As it is scraped."""
        return _PREFIX + self.name

    @property
    def counts(self) -> bool:
        """Whether it is a counter; else a gauge."""
        return self.name.endswith("_total")


class Samples(NamedTuple):
    """What one scrape has of a family: of each series the labels and the value."""

    family: Family
    rows: Sequence[tuple[Labels, float]]

    def as_metric(self) -> Metric:
        """For Prometheus's library."""
        kind = CounterMetricFamily if self.family.counts else GaugeMetricFamily
        metric = kind(self.family.full_name, self.family.help, labels=self.family.labels)
        for labels, value in self.rows:
            metric.add_metric(labels, value)
        return metric


FAMILIES = (
    Family("build_info", ("version",), "1, with the version of gcs-bridge"),
    Family("link_up", _LINK, "1 while the link is there, 0 while it is waited for"),
    Family("bytes_total", _LINK, "Bytes that came"),
    Family("skipped_bytes_total", _LINK, "Bytes that belong to no intact frame"),
    Family("damaged_frames_total", _LINK, "Frames with a wrong checksum; whose they were cannot be known"),
    Family("unlisted_vehicles", _LINK, "Components that claim to be vehicles and have no series of their own"),
    Family("frames_total", _VEHICLE, f"Intact frames of known messages; {OTHERS}: of whoever has no series"),
    Family("lost_frames_total", _VEHICLE, "Frames that the sequence numbers miss"),
    Family("vehicle_age_seconds", _VEHICLE, "Time since the last frame of the vehicle"),
    Family("messages_total", _MESSAGE, "Messages that are compared, those that could not be used included"),
    Family("message_age_seconds", _MESSAGE, "Time since the last message of this name"),
    Family("alarm_state", (*_CHECK, "state"), f"1 for the state that the check is in: {', '.join(CHECK_STATES)}"),
    Family("alarms_total", (*_CHECK, "severity"), "Alarms and warnings that were raised, repeats included"),
    Family("residual_degrees", _ALARM, "The latest difference that an alarm judges, of those in degrees"),
    Family("limit_degrees", _ALARM, "Its limit at that sample: it grows with what the sample cannot tell"),
    Family("residual_ratio", _ALARM, "The latest difference over its limit, whatever its unit: above 1 it is beyond"),
)


class SnapshotCollector:
    """Makes samples of what was published; used by one thread at a time."""

    def __init__(self, links: Sequence[str]) -> None:
        """Start with nothing; `links`: their names, by number."""
        self._links = [readable(name) for name in links]
        self._highest: dict[Labels, float] = {}

    def collect(self, published: Published) -> Iterator[Samples]:
        """All families, with what is known."""
        scrape = _Scrape(self._highest)
        scrape.add("build_info", (__version__,), 1)
        self._fill(scrape, published)
        return (Samples(family, scrape.rows[family.name]) for family in FAMILIES)

    def _fill(self, scrape: _Scrape, published: Published) -> None:
        listed = dict.fromkeys(range(len(self._links)), 0)  # frames, by link
        for vehicle in published.snapshot.vehicles:
            number = vehicle.link or 0
            listed[number] += vehicle.received
            scrape.add_vehicle((self._links[number], f"{vehicle.sysid}.{vehicle.compid}"), vehicle, published.raises)
        for link in published.snapshot.links:
            assert isinstance(link.name, int)  # a run that listens reads no recording
            scrape.add_link(self._links[link.name], link, listed[link.name])


class _Scrape:
    """The samples of one scrape by family, while they are added."""

    def __init__(self, highest: dict[Labels, float]) -> None:
        """`highest`: what counters showed so far, by name and labels, kept from scrape to scrape."""
        self.rows: dict[str, list[tuple[Labels, float]]] = {family.name: [] for family in FAMILIES}
        self._counters = {family.name for family in FAMILIES if family.counts}
        self._highest = highest

    def add(self, name: str, labels: Labels, value: float | None) -> None:
        """A sample; none where the value is not known."""
        if value is None or not math.isfinite(value):
            return
        if name in self._counters:  # a frame that was counted as lost may come late
            key = (name, *labels)
            value = self._highest[key] = max(value, self._highest.get(key, 0))
        self.rows[name].append((labels, value))

    def add_link(self, name: str, link: LinkNow, listed: int) -> None:
        """What is known of a link, of whose frames `listed` have a vehicle's name."""
        labels = (name,)
        self.add("link_up", labels, link.is_open)
        self.add("bytes_total", labels, link.bytes)
        self.add("skipped_bytes_total", labels, link.skipped_bytes)
        self.add("damaged_frames_total", labels, link.bad_crc)
        self.add("unlisted_vehicles", labels, link.unlisted)
        self.add("frames_total", (name, OTHERS), link.frames - listed)

    def add_vehicle(self, labels: tuple[str, str], vehicle: VehicleNow, raises: Raises) -> None:
        """What is known of a vehicle."""
        who = VehicleId(vehicle.link, vehicle.sysid, vehicle.compid)
        self.add("frames_total", labels, vehicle.received)
        self.add("lost_frames_total", labels, vehicle.lost)
        self.add("vehicle_age_seconds", labels, vehicle.age_s)
        for message, stream in vehicle.streams.items():
            self.add("messages_total", (*labels, message), stream.count)
            self.add("message_age_seconds", (*labels, message), vehicle.message_age_s[message])
        for check in vehicle.checks:
            of_check = (*labels, check.name)
            state = state_of(check)
            for one in CHECK_STATES:
                self.add("alarm_state", (*of_check, one), one == state)
            for severity in sorted({alarm.severity for alarm in check.alarms}):
                self.add("alarms_total", (*of_check, severity), raises.get(Raised(who, check.name, severity), 0))
            for alarm in check.alarms:
                if _is_current(alarm, vehicle):
                    self._add_alarm((*of_check, alarm.name), alarm)

    def _add_alarm(self, labels: Labels, alarm: AlarmNow) -> None:
        assert alarm.value is not None
        assert alarm.limit is not None
        if alarm.unit == "deg":
            self.add("residual_degrees", labels, alarm.value)
            self.add("limit_degrees", labels, alarm.limit)
        if alarm.limit > 0:
            self.add("residual_ratio", labels, alarm.value / alarm.limit)


def _is_current(alarm: AlarmNow, vehicle: VehicleNow) -> bool:
    """Whether an alarm's latest sample tells of now: by the vehicle's clock, and by when it was heard."""
    if alarm.t_boot_s is None or vehicle.t_boot_s is None or vehicle.age_s is None:
        return False
    return vehicle.t_boot_s - alarm.t_boot_s <= _CURRENT_S and vehicle.age_s <= _CURRENT_S
