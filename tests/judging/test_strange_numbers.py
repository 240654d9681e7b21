"""Numbers that mean nothing, times that are none, and disagreements without an end: what they must not do."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

import gcs_bridge
from gcs_bridge.judging.diagnosis_cases import DiagnosisCases
from gcs_bridge.judging.sent import JOINED
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from tests.helpers import wire
from tests.helpers.everyday import one_in

HZ = 50


class _File:
    data = b""

    def write(self, data: bytes) -> None:
        self.data = data


def level(
    seconds: float, *, upside_down_from_s: float = math.inf, strange: dict[float, Any]
) -> list[tuple[bytes, int]]:
    """Datagrams of a level vehicle at rest; its accelerometer feels the other side from a time on.

    `strange`: by time a down acceleration, m/s², or a value of AHRS_TRIM_X.
    """
    link = mavlink.MAVLink(_File(), srcSystem=1, srcComponent=1)
    came = []
    for i in range(round(seconds * HZ)):
        t_s, ms = i / HZ, i * 1000 // HZ
        sent = []
        if i % HZ == 0:
            sent.append(mavlink.MAVLink_heartbeat_message(2, 12, 81, 0, 4, 3))
        what = strange.get(t_s, {})
        if "trim" in what:
            sent.append(mavlink.MAVLink_param_value_message(b"AHRS_TRIM_X", what["trim"], 9, 1, 0))
        sent.append(mavlink.MAVLink_attitude_message(ms, 0, 0, 0, 0.001, 0, 0))
        sent.append(mavlink.MAVLink_attitude_quaternion_message(ms, 1, 0, 0, 0, 0.001, 0, 0))
        down = what.get("acceleration", 9.81 if t_s >= upside_down_from_s else -9.81)
        sent.append(mavlink.MAVLink_highres_imu_message(ms * 1000, 0, 0, down, 0.001, *[0] * 9, 0xFFFF))
        came += [(message.pack(link), wire.START_US + ms * 1000) for message in sent]
    return came


def alarmed(datagrams: list[tuple[bytes, int]]) -> set[str]:
    monitor = gcs_bridge.Monitor()
    monitor.feed_datagrams(datagrams)
    vehicle = monitor.close().to_dict()["files"][0]["vehicles"][0]
    return {alarm["check"] for alarm in vehicle["alarms"]}


@pytest.mark.slow
@pytest.mark.parametrize("garbage", one_in(2, [1e18, -1e18, math.inf, math.nan]))
def test_one_wild_acceleration_is_damage(garbage: float) -> None:
    """It raises nothing by itself, and hides nothing: a vehicle upside down is told 30 s later all the same."""
    strange = {10.0: {"acceleration": garbage}}
    assert alarmed(level(40.0, strange=strange)) == set()
    assert alarmed(level(60.0, upside_down_from_s=40.0, strange=strange)) == {"gravity"}


def test_a_trim_that_is_no_number_is_none() -> None:
    """AHRS_TRIM_X of NaN explains nothing away."""
    assert alarmed(level(60.0, upside_down_from_s=40.0, strange={5.0: {"trim": math.nan}})) == {"gravity"}


@pytest.mark.parametrize(
    ("t_rx_us", "error"),
    [(1.7e15, TypeError), ("now", TypeError), (1_700_000_000_000_000_000, ValueError), (-2, ValueError)],
)
def test_what_is_no_receive_time_is_refused(t_rx_us: Any, error: type[Exception]) -> None:
    """A float, a text, nanoseconds, a time before 1970: in words, and nothing is taken."""
    monitor = gcs_bridge.Monitor()
    with pytest.raises(error, match="t_rx_us is"):
        monitor.feed(wire.heartbeat(), t_rx_us)
    with pytest.raises(error, match="t_rx_us is"):
        monitor.feed_datagrams([(wire.heartbeat(), t_rx_us)])
    with pytest.raises(error, match="t_rx_us is"):
        monitor.advance(t_rx_us)
    monitor.feed(wire.heartbeat(), wire.START_US)
    assert monitor.snapshot().links[0].frames == 1


@pytest.mark.slow
def test_a_recording_beside_a_link_is_another_vehicle() -> None:
    """Alarms of both have ids of their own, and one is acknowledged alone."""
    faulty = inject(wire.tlog(wire.flight(wire.Motion(12.0, seed=3), 12.0)), [parse_fault("yaw_offset:25")], from_s=4.0)
    monitor = gcs_bridge.Monitor()
    frames = list(wire.records(faulty))
    told = [*monitor.feed_datagrams([(frame, t_us) for t_us, frame in frames]), *monitor.feed_recording(faulty)]
    live, recorded = (event["id"] for event in told if event["event"] == "alarm_raised")
    assert live != recorded
    monitor.acknowledge(recorded, frames[-1][0])
    alarms = [file["vehicles"][0]["alarms"][0] for file in monitor.close().to_dict()["files"]]
    assert {alarm["id"]: alarm["acknowledged"] for alarm in alarms} == {live: False, recorded: True}


@pytest.mark.slow
def test_a_disagreement_without_end_keeps_no_more_than_is_asked_about(monkeypatch: pytest.MonkeyPatch) -> None:
    """Once no answer can become better, what the doctor would need goes: as much is kept as on a healthy flight."""
    kept: list[int] = []  # pairs, by batch
    pairs: list[int] = []
    keep = DiagnosisCases.keep

    def counting(self: DiagnosisCases, *batch: Any) -> None:
        keep(self, *batch)
        kept.append(len(self._kept))
        pairs.append(len(batch[1]))

    monkeypatch.setattr(DiagnosisCases, "keep", counting)
    faulty = inject(
        wire.tlog(wire.flight(wire.Motion(150.0, seed=3), 150.0)), [parse_fault("yaw_offset:25")], from_s=4.0
    )
    monitor = gcs_bridge.Monitor()
    frames = list(wire.records(faulty))
    for first in range(0, len(frames), 10):
        monitor.feed_datagrams([(frame, t_us) for t_us, frame in frames[first : first + 10]])
    (alarm,) = monitor.close().to_dict()["files"][0]["vehicles"][0]["alarms"]
    assert alarm["cleared_boot_s"] is None
    by_second, slack = sum(pairs) / 150.0, JOINED * max(pairs)
    assert max(kept) < 81 * by_second + slack  # from 10 s before the onset to 30 s behind the last answer, 40 s long
    assert kept[-1] < 31 * by_second + slack
