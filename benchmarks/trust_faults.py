"""How soon a fault is told, that is put into the flight of a healthy vehicle: silence is easy to have, and no virtue.

The fault begins in the middle of a recording. Its onset is the first moment at which what is sent is far enough from
what had been sent without the fault; a fault that does not stay visible (a pitch sign while level) counts for nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import radians
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from benchmarks.trust_links import Link
from gcs_bridge import attitude
from gcs_bridge.diagnosis.causes import CAUSES
from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.judging.observation import Observation
from gcs_bridge.mavlink.dialect import load_dialect
from gcs_bridge.mavlink.scanner import Scanner
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from gcs_bridge.telemetry.samples import AttitudeSamples

FAULTS = (
    "yaw_offset:1",
    "yaw_offset:5",
    "yaw_offset:25",
    "mount_offset:0,4,0",
    "world_offset:4,0,0",
    "time_skew:150",
    "quaternion_conjugate",
    "quaternion_xyzw",
    "enu_flu",
    "roll_sign",
    "roll_pitch_swapped",
    "euler_degrees",
    "quaternion_unnormalised:1.05",
    "frozen_quaternion",
)
LINKS = (
    Link(25.0, 0.0, "none"),
    Link(10.0, 0.0, "none"),
    Link(10.0, 0.2, "none"),
    Link(10.0, 0.0, "staggered"),
    Link(4.0, 0.0, "none"),
    Link(4.0, 0.2, "none"),
)
START = 0.45  # of the recording's duration
_VISIBLE = radians(0.8)  # or of the norm
_VISIBLE_S = 3.0  # so long without a pause, or it is not expected to be found

_Key = tuple[int, int, int]  # system, component, boot


class Case(NamedTuple):
    """What came of one fault in one vehicle's flight: delay from its onset, s, None: not found; and by which check."""

    recording: str
    vehicle: str
    link: Link
    fault: str
    onset_s: float
    delay_s: float | None
    check: str | None


class _Streams:
    """Keeps both attitudes of every vehicle and boot."""

    def __init__(self, data: bytes) -> None:
        self.of: dict[_Key, list[tuple[AttitudeSamples, AttitudeSamples]]] = {}
        monitor = Monitor(observer=self._keep)
        monitor.feed_recording(data)
        self.report = monitor.close().to_dict()["files"][0]

    def _keep(self, seen: Observation) -> None:
        key = (*seen.vehicle.address, seen.segment.boot)
        self.of.setdefault(key, []).append((seen.segment.euler, seen.segment.quaternion))

    def stream(self, key: _Key, number: int) -> AttitudeSamples:
        return AttitudeSamples.joined([both[number] for both in self.of[key]])


def try_faults(path: Path, links: Sequence[Link] = LINKS) -> list[Case]:
    """Every fault in one recording, over every link."""
    data = path.read_bytes()
    return [case for link in links for case in _over(path.stem, link, link.bring(data))]


def _over(recording: str, link: Link, data: bytes) -> Iterator[Case]:
    sound = _Streams(data)
    t_rx_us = Scanner(load_dialect("all"), timed=True).scan(data, final=True)["t_rx_us"]
    lasts_s = (int(t_rx_us.max()) - int(t_rx_us[t_rx_us > 0][0])) / 1e6
    for fault in FAULTS:
        faulty = _Streams(inject(data, [parse_fault(fault)], from_s=START * lasts_s))
        for key in sound.of:
            times_s = _begin_and_onset_s(sound, faulty, key, fault)
            if times_s is not None:
                name = f"{key[0]}.{key[1]}"
                yield Case(recording, name, link, fault, times_s[1], *_found(faulty, key, *times_s))


def _begin_and_onset_s(sound: _Streams, faulty: _Streams, key: _Key, fault: str) -> tuple[float, float] | None:
    """Boot times of the first falsified message, and from which on the fault was visible for a while."""
    number = 0 if CAUSES[parse_fault(fault).name].message == 30 else 1
    was, now = sound.stream(key, number), faulty.stream(key, number)
    if len(was) < 2 or len(sound.stream(key, 1 - number)) < 2 or len(now) != len(was):
        return None
    changed = (was.t_boot_us != now.t_boot_us) | (was.q_nb != now.q_nb).any(axis=1)
    if fault.startswith("frozen"):
        changed = np.maximum.accumulate(changed)
    t_s = was.t_boot_us * 1e-6
    late = np.searchsorted(was.t_boot_us, now.t_boot_us).clip(max=len(was) - 1)  # what should be sent with this stamp
    visible = changed & (_differs(was.q_nb[late], now.q_nb) > _VISIBLE)
    for row in np.flatnonzero(visible & ~np.concatenate(([False], visible[:-1]))):
        end = row + int(np.argmin(np.append(visible[row:], False)))
        if t_s[end - 1] - t_s[row] >= _VISIBLE_S:
            return float(t_s[np.argmax(changed)]), float(t_s[row])
    return None


def _differs(q: npt.NDArray[np.float64], sent: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """The angle between them, or how far the norm is off."""
    angle = attitude.angle_between(attitude.normalise(q), attitude.normalise(sent))
    return np.asarray(np.maximum(angle, np.abs(np.linalg.norm(sent, axis=1) - 1.0)))


def _found(faulty: _Streams, key: _Key, begin_s: float, onset_s: float) -> tuple[float | None, str | None]:
    """How long after the onset the first alarm was raised, 0 if it was before, and by which check."""
    raised = [
        (max(alarm["raised_boot_s"] - onset_s, 0.0), alarm["check"])
        for vehicle in faulty.report["vehicles"]
        for alarm in vehicle["alarms"]
        if (vehicle["sysid"], vehicle["compid"], alarm["boot"]) == key and alarm["severity"] == "alarm"
        if alarm["raised_boot_s"] >= begin_s
    ]
    return min(raised, default=(None, None))


def rows(cases: Sequence[Case]) -> Iterator[tuple[str, ...]]:
    """Fault by fault and link by link: how many were found, and how soon."""
    for fault in FAULTS:
        of = [[case for case in cases if case.fault == fault and case.link == link] for link in LINKS]
        yield f"`{fault}`", *map(_shown, of)


def _shown(cases: Sequence[Case]) -> str:
    delays = [case.delay_s for case in cases if case.delay_s is not None]
    if not delays:
        return f"0 of {len(cases)}"
    median, high = np.percentile(delays, [50, 95])
    return f"{len(delays)} of {len(cases)}: {median:.1f}, {high:.1f}"
