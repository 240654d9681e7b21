"""Recordings of real autopilots, replayed and judged against facts that pymavlink and SciPy found in them."""

import json
import math
from collections import Counter
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gcs_bridge
from gcs_bridge.mavlink.dialect import load_dialect
from gcs_bridge.mavlink.scanner import Scanner
from tests.helpers.everyday import one_in
from tests.helpers.paths import FIXTURES as SITL
from tests.helpers.report_entries import CHECKS
from tests.helpers.wire import messages

ALL = sorted(path.stem for path in SITL.glob("*.tlog"))
DAMAGED = {"h_lossy_dirty"}
WHOLE = [name for name in ALL if name not in DAMAGED]
PAIR = ("ATTITUDE", "ATTITUDE_QUATERNION")
IMU = ("RAW_IMU", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3", "HIGHRES_IMU")

Json = dict[str, Any]


@cache
def facts_of(name: str) -> Json:
    facts: Json = json.loads((SITL / f"{name}.facts.json").read_text(encoding="utf-8"))
    return facts


VEHICLES = [(name, key) for name in ALL for key in facts_of(name)["vehicles"]]


def named(key: str) -> tuple[int, int]:
    sysid, compid = key.split(",")
    return int(sysid), int(compid)


@cache
def judged(name: str) -> Json:
    (entry,) = gcs_bridge.check(SITL / f"{name}.tlog").to_dict()["files"]
    return dict(entry)


def judged_vehicle(name: str, key: str) -> tuple[Json, Json, Json]:
    """The report's vehicle, its euler_quaternion check, and the vehicle's facts."""
    vehicle = next(v for v in judged(name)["vehicles"] if (v["sysid"], v["compid"]) == named(key))
    check = next(check for check in vehicle["checks"] if check["name"] == "euler_quaternion")
    return vehicle, check, facts_of(name)["vehicles"][key]


@cache
def samples(name: str) -> Any:
    return gcs_bridge.read(SITL / f"{name}.tlog")


@cache
def heard(name: str) -> dict[tuple[tuple[int, int], str], list[tuple[int, Any]]]:
    """(record time, message) as pymavlink decodes attitudes and IMUs, by (system, component) and message name."""
    found: dict[tuple[tuple[int, int], str], list[tuple[int, Any]]] = {}
    data = (SITL / f"{name}.tlog").read_bytes()
    for _, t_us, message in messages(data, "ATTITUDE", "ATTITUDE_QUATERNION", "RAW_IMU", "HIGHRES_IMU"):
        source = message.get_srcSystem(), message.get_srcComponent()
        found.setdefault((source, message.get_type()), []).append((t_us, message))
    return found


def same_instant_deg(name: str, key: str) -> Any:
    """Angles between ATTITUDE and ATTITUDE_QUATERNION of equal times, by SciPy from pymavlink's fields.

    Times come twice only where there are two boots, which both messages share: the n-th ones belong together.
    """

    def by_time(message_name: str) -> dict[tuple[int, int], Any]:
        times: Counter[int] = Counter()
        of = {}
        for _, message in heard(name)[named(key), message_name]:
            of[message.time_boot_ms, times[message.time_boot_ms]] = message
            times[message.time_boot_ms] += 1
        return of

    euler, quaternion = by_time(PAIR[0]), by_time(PAIR[1])
    common = sorted(euler.keys() & quaternion.keys())
    if not common:
        return np.empty(0)
    a = Rotation.from_euler("ZYX", [[euler[t].yaw, euler[t].pitch, euler[t].roll] for t in common])
    b = Rotation.from_quat([[quaternion[t].q2, quaternion[t].q3, quaternion[t].q4, quaternion[t].q1] for t in common])
    return np.degrees((a.inv() * b).magnitude())


# --- check: the file -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ALL)
def test_verdict_of_the_file(name: str) -> None:
    """A recording is AGREE without an alarm or a warning of any check, differences made on purpose included, but for
    the two in which something is wrong.
    """
    entry = judged(name)
    alarms = [(alarm["check"], alarm["severity"]) for vehicle in entry["vehicles"] for alarm in vehicle["alarms"]]
    if facts_of(name)["other_alarms"]:
        assert entry["verdict"] == "alarm"
    else:
        assert (entry["verdict"], alarms) == ("agree", [])


@pytest.mark.parametrize("name", ALL)
def test_vehicles_of_the_file(name: str) -> None:
    """Exactly the autopilots are vehicles, with the names that MAVLink gives them: no ground station, no false id."""
    found = {f"{v['sysid']},{v['compid']}": (v["autopilot"], v["type"]) for v in judged(name)["vehicles"]}
    assert found == {key: (v["autopilot"], v["type"]) for key, v in facts_of(name)["vehicles"].items()}


@pytest.mark.parametrize("name", WHOLE)
def test_nothing_of_a_whole_recording_is_lost(name: str) -> None:
    """Every frame that pymavlink finds is found, signed and unknown ones told apart, and every byte accounted for."""
    facts, entry = facts_of(name), judged(name)
    salvage = entry["salvage"]
    expected = {"frames": facts["frames"], "unverified": facts["unknown_ids"], "signed": facts["signed"]}
    expected |= {"bad_crc": 0, "repaired_crc": 0, "skipped_bytes": 0, "gap_count": 0, "duplicates": 0}
    assert {key: salvage[key] for key in expected} == expected
    assert salvage["read_fraction"] == 1.0
    assert salvage["gaps"] == []
    assert entry["bytes"] == facts["bytes"]


def test_damage_is_counted() -> None:
    """Of a damaged recording no fewer frames are found than by pymavlink, and the rest shows up as damage."""
    facts, entry = facts_of("h_lossy_dirty"), judged("h_lossy_dirty")
    salvage = entry["salvage"]
    assert salvage["frames"] >= facts["frames"]
    # How many failed frames have an id that nobody knows hangs on where a reader looks on after damage (four that
    # pymavlink counts have a wrong length or time); that no byte is unaccounted for does not.
    scanner = Scanner(load_dialect(), timed=True)
    scanner.scan((SITL / "h_lossy_dirty.tlog").read_bytes(), final=True)
    found = scanner.raw_frames()
    assert len(found) == salvage["frames"] + salvage["unverified"]
    times = facts["bytes"] - salvage["skipped_bytes"] - sum(len(frame.data) for frame in found)
    assert 8 * (len(found) - salvage["bad_times"]) <= times <= 8 * len(found)
    assert salvage["unverified"] > 0
    assert salvage["bad_crc"] > 0
    assert salvage["gap_count"] > len(salvage["gaps"]) == 100
    # 1 % of the bytes are wrong: of the 2,500 frames and more that were sent, some 40 bytes each, a third is gone.
    assert salvage["read_fraction"] == pytest.approx(1 - salvage["skipped_bytes"] / facts["bytes"])
    assert 0.6 < salvage["read_fraction"] < 0.8
    for key, vehicle in facts["vehicles"].items():
        streams = judged_vehicle("h_lossy_dirty", key)[0]["streams"]
        for message in (*PAIR, "RAW_IMU", "AHRS2"):
            assert streams[message]["count"] >= vehicle["messages"][message]


# --- check: the vehicle ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "key"), VEHICLES)
def test_verdict_of_the_two_forms(name: str, key: str) -> None:
    """Each vehicle is judged by itself: what differs on purpose is explained, with its cause and size, and nothing of
    it is left; what agrees is not touched. A size that no parameter tells is estimated.
    """
    vehicle, check, facts = judged_vehicle(name, key)
    assert check["verdict"] == facts["euler_quaternion"]
    assert check["reason"]
    assert [check["name"] for check in vehicle["checks"]] == CHECKS
    if facts["euler_quaternion"] == "agree":
        assert check["explained_by"] == []
        return
    estimated = not any(name in facts["parameters"] for name in ("PTCH_TRIM_DEG", "AHRS_TRIM_X", "Q_TRIM_PITCH"))
    sizes = [value for _, value in facts_of(name)["value_history"] or [(None, facts["value"])] if value]
    assert len(check["explained_by"]) == len(sizes)
    for told, size in zip(check["explained_by"], sizes, strict=True):
        assert (told["cause"], told["unit"], told["estimated"]) == (facts["cause"], facts["unit"], estimated)
        assert told["value"] == pytest.approx(size, abs=0.3 if estimated else 0.1)
    assert check["residual"]["median"] < 1e-3
    assert check["residual"]["p95"] < 1e-3  # a twentieth of the time is enough to know
    assert check["raw"]["max"] == pytest.approx(facts["same_instant"]["max"], rel=1e-5)


@cache
def happened(name: str) -> tuple[Json, ...]:
    monitor = gcs_bridge.Monitor()
    return tuple(monitor.feed_recording((SITL / f"{name}.tlog").read_bytes()))


def test_both_gyros_wrong_alike() -> None:
    """k7a: from the bias at 93.69 s on both forms are wrong alike and agree; other checks raise an alarm by 110 s."""
    vehicle, check, _ = judged_vehicle("k7a_gyro_bias_both", "1,1")
    assert check["verdict"] == "agree"
    alarms = [alarm for alarm in vehicle["alarms"] if alarm["severity"] == "alarm"]
    assert 93.69 < min(alarm["raised_boot_s"] for alarm in alarms) <= 110
    assert {alarm["check"] for alarm in vehicle["alarms"]} <= {"gravity", "gyro", "kinematics", "secondary_estimate"}
    assert all(alarm["raised_boot_s"] > 93.69 for alarm in vehicle["alarms"])  # warnings included


def test_two_resets_of_the_yaw() -> None:
    """k12: two events, 21.7° and nearly 4° of heading, at their times; no alarm (see the file's verdict)."""
    first, second = (event for event in happened("k12_yaw_reset") if event["event"] == "estimator_reset")
    for event, at_s, heading in ((first, 70.099, 21.7), (second, 71.299, 4)):
        assert event["boot_s"] == pytest.approx(at_s, abs=0.05)
        assert abs(event["heading"]) == pytest.approx(heading, abs=0.3)
        assert event["tilt"] < 0.5


def test_no_reset_where_nothing_was_reset() -> None:
    """Acro through the poles, steep banks and a flight of PX4 show none."""
    for name in ("b_copter_acro", "p_px4_quad_square", "k1_copter_trim", "k4_quadplane"):
        assert [event for event in happened(name) if event["event"] == "estimator_reset"] == []


def test_resets_are_as_large_as_the_step() -> None:
    """In k7a the yaw is reset twice, at 114.589 s and 128.440 s, by the turn about the world's down that SciPy finds
    between the quaternions before and after.
    """
    sent = [m for _, m in heard("k7a_gyro_bias_both")[(1, 1), "ATTITUDE_QUATERNION"]]
    resets = {
        round(1000 * event["boot_s"]): event
        for event in happened("k7a_gyro_bias_both")
        if event["event"] == "estimator_reset"
    }
    for event in facts_of("k7a_gyro_bias_both")["events"]:
        if not event["what"].startswith("yaw reset"):
            continue
        told = next(reset for ms, reset in resets.items() if abs(ms - event["boot_ms"]) <= 50)
        after = next(i for i, m in enumerate(sent) if m.time_boot_ms == round(1000 * told["boot_s"]))
        before, now = (Rotation.from_quat([m.q2, m.q3, m.q4, m.q1]) for m in sent[after - 1 : after + 1])
        _, _, z, w = (now * before.inv()).as_quat()  # in world axes: of a turn about down and a tilt
        heading = (2 * math.degrees(math.atan2(z, w)) + 180) % 360 - 180
        assert told["heading"] == pytest.approx(heading, abs=1e-3)
        assert abs(heading) > 100


def test_a_stream_that_stops() -> None:
    """k8: an alarm of the stream and NO COMPARE while the quaternion is off, both over when it is back."""
    stops_s, back_s = 83.739, 103.820
    vehicle, _, _ = judged_vehicle("k8_stream_stops", "1,1")
    (alarm,) = vehicle["alarms"]
    assert (alarm["check"], alarm["severity"]) == ("stream", "alarm")
    assert "ATTITUDE_QUATERNION" in alarm["what"].split()
    assert stops_s + 2 <= alarm["raised_boot_s"] <= stops_s + 2.05  # with the next message that has a time
    assert alarm["cleared_boot_s"] == pytest.approx(back_s + 2, abs=0.05)
    events = happened("k8_stream_stops")
    at_s = {event["event"]: event["boot_s"] for event in events if event["event"] in ("no_compare", "compare_resumed")}
    assert at_s == {"no_compare": pytest.approx(stops_s + 2), "compare_resumed": back_s}


@pytest.mark.parametrize(("name", "key"), VEHICLES)
def test_boots(name: str, key: str) -> None:
    """The boots are those of the facts; other messages than the attitudes may come a little before and after them."""
    boots, facts = judged_vehicle(name, key)[0]["boots"], facts_of(name)["vehicles"][key]["boots"]
    assert [boot["index"] for boot in boots] == list(range(len(facts)))
    for boot, fact in zip(boots, facts, strict=True):
        assert 0 <= fact["first_boot_ms"] - round(1000 * boot["first_boot_s"]) < 1000
        assert 0 <= round(1000 * boot["last_boot_s"]) - fact["last_boot_ms"] < 1000


@pytest.mark.parametrize(("name", "key"), [(n, k) for n, k in VEHICLES if n not in DAMAGED])
def test_streams(name: str, key: str) -> None:
    """Messages are counted as pymavlink counts them; rates are their own clock's; nothing is invalid or lost."""
    vehicle, _, facts = judged_vehicle(name, key)
    for message in (*PAIR, "RAW_IMU", "SCALED_IMU", "HIGHRES_IMU", "AHRS2"):
        stream = vehicle["streams"].get(message, {"count": 0})
        assert (message, stream["count"]) == (message, facts["messages"][message])
        if message in PAIR:
            assert stream["invalid"] == facts["invalid"] == 0
            assert stream["lost"] == 0
        if typical_hz := facts["rates_hz"].get(message, {}).get("typical"):  # AHRS2 has no clock
            assert stream["rate_hz"] == pytest.approx(typical_hz, rel=0.03)


def test_longest_gap_is_the_silence() -> None:
    """In k8_stream_stops the quaternion is off for 20.081 s, and its longest gap says so."""
    (silence,) = facts_of("k8_stream_stops")["vehicles"]["1,1"]["boots"][0]["silences"]
    streams = judged_vehicle("k8_stream_stops", "1,1")[0]["streams"]
    assert streams[silence["message"]]["max_gap_s"] == (silence["to_boot_ms"] - silence["from_boot_ms"]) / 1000
    assert streams["ATTITUDE"]["max_gap_s"] < 0.1


@pytest.mark.parametrize(("name", "key"), VEHICLES)
def test_coverage(name: str, key: str) -> None:
    """From 10 Hz on nearly all of the time in which both came is judged.

    h_lossy_dirty: gaps of more than three periods, which count for three, are what its losses leave.
    """
    _, check, facts = judged_vehicle(name, key)
    slower_hz = min(facts["rates_hz"][message]["typical"] for message in PAIR)
    if slower_hz >= 9.9:
        assert check["coverage"] >= (0.95 if name in DAMAGED else 0.98)
    assert check["coverage"] <= 1.0


@pytest.mark.parametrize(("name", "key"), [(n, k) for n, k in VEHICLES if n not in DAMAGED])
def test_same_instant_pairs(name: str, key: str) -> None:
    """Every sample of the one form that has one of the other at its very time is compared with it."""
    _, check, facts = judged_vehicle(name, key)
    assert check["same_instant"] == facts["same_instant"]["count"]
    assert check["pairs"] >= check["same_instant"]


@pytest.mark.parametrize(("name", "key"), one_in(12, [(n, k) for n, k in VEHICLES if n not in DAMAGED]))
def test_raw_difference_is_the_oracle_s(name: str, key: str) -> None:
    """Where all pairs are of one instant, the raw difference's quantiles are SciPy's, within the histogram's 0.1 %."""
    _, check, facts = judged_vehicle(name, key)
    angles = same_instant_deg(name, key)
    assert len(angles) == facts["same_instant"]["count"]
    if check["pairs"] > len(angles):  # interpolated pairs are in it as well
        largest_deg = facts["same_instant"]["max"] or 0.0
        assert check["raw"]["max"] >= largest_deg * (1 - 1e-5)
        return
    assert angles.max() == pytest.approx(facts["same_instant"]["max"], rel=1e-4, abs=1e-9)
    for share, of in ((0.5, "median"), (0.95, "p95"), (0.99, "p99"), (1.0, "max")):
        by_rank = np.quantile(angles, share, method="inverted_cdf")
        assert check["raw"][of] == pytest.approx(by_rank, rel=2e-3 if name == "f_reboot" else 1e-3, abs=1e-9)


@pytest.mark.parametrize(("name", "key"), VEHICLES)
def test_residual_where_both_forms_agree(name: str, key: str) -> None:
    """Forms that agree are one rotation to a ten-thousandth of a degree, where interpolated to a hundredth."""
    _, check, facts = judged_vehicle(name, key)
    if facts["euler_quaternion"] == "agree":
        assert check["residual"]["median"] < (1e-2 if name == "b2_mixed_rates" else 1e-4)
        assert check["residual"]["max"] < 0.5
        assert check["raw"] == check["residual"]


def test_interpolation_is_of_the_faster_stream() -> None:
    """In b2_mixed_rates, never at one instant, the errors are below those of SLERP of the slower stream (2.11°)."""
    _, check, facts = judged_vehicle("b2_mixed_rates", "1,1")
    assert check["same_instant"] == 0
    assert check["pairs"] == facts["slerp"]["count"]
    assert check["residual"]["max"] < 2 * facts["slerp"]["max"] < 2.11


# --- read: the samples -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "key"), one_in(6, [(n, k) for n, k in VEHICLES if n not in DAMAGED]))
def test_attitudes_are_pymavlink_s_numbers(name: str, key: str) -> None:
    """What `read` gives are the very float32 numbers and times that pymavlink decodes, in order of arrival."""
    vehicle = samples(name).vehicles[named(key)]
    for message, got in (("ATTITUDE", vehicle.attitude), ("ATTITUDE_QUATERNION", vehicle.attitude_quaternion)):
        sent = heard(name)[named(key), message]
        assert len(got) == len(sent) == facts_of(name)["vehicles"][key]["messages"][message]
        assert got.valid.all()
        np.testing.assert_array_equal(got.t_rx_us, [t_us for t_us, _ in sent])
        np.testing.assert_array_equal(got.t_boot_us, [1000 * m.time_boot_ms for _, m in sent])
        rates = np.array([[m.rollspeed, m.pitchspeed, m.yawspeed] for _, m in sent])
        np.testing.assert_array_equal(got.w_nb_b_rad_s, rates)
        if message == "ATTITUDE":
            rpy = np.array([[m.roll, m.pitch, m.yaw] for _, m in sent])
            np.testing.assert_array_equal(got.rpy_rad, rpy)
            turned = Rotation.from_euler("ZYX", rpy[:, ::-1]).inv() * Rotation.from_quat(got.q_nb[:, [1, 2, 3, 0]])
            assert turned.magnitude().max() < 1e-12
        else:
            np.testing.assert_array_equal(got.q_nb, np.array([[m.q1, m.q2, m.q3, m.q4] for _, m in sent]))
            assert got.rpy_rad is None


def test_a_damaged_recording_yields_true_samples_only() -> None:
    """Every quaternion of h_lossy_dirty has the norm of one, and no vehicle but the real one comes out of the dirt."""
    recording = samples("h_lossy_dirty")
    assert list(recording.vehicles) == [(1, 1)]
    vehicle = recording.vehicles[1, 1]
    np.testing.assert_allclose(np.linalg.norm(vehicle.attitude_quaternion.q_nb, axis=1), 1, atol=1e-6)
    assert len(vehicle.attitude) >= facts_of("h_lossy_dirty")["vehicles"]["1,1"]["messages"]["ATTITUDE"]
    assert recording.salvage.frames == judged("h_lossy_dirty")["salvage"]["frames"]


@pytest.mark.parametrize("name", ALL)
def test_imu_counts(name: str) -> None:
    """Every inertial message becomes a sample; a message that never came is an empty array."""
    for key, vehicle in samples(name).vehicles.items():
        streams = judged_vehicle(name, f"{key[0]},{key[1]}")[0]["streams"]
        for message in IMU:
            imu = getattr(vehicle, message.lower())
            assert (message, len(imu)) == (message, streams.get(message, {"count": 0})["count"])
            assert imu.f_b_m_s2.shape == imu.w_b_rad_s.shape == (len(imu), 3)


def test_raw_imu_of_ardupilot() -> None:
    """Standing before take-off, ArduPilot's RAW_IMU measures gravity; that its unit is an assumption stands with it."""
    vehicle = samples("a_copter_square").vehicles[1, 1]
    imu = vehicle.raw_imu
    assert "assumed" in imu.scale
    standing = imu.t_boot_us < 40_000_000  # armed at 42 s
    assert standing.sum() > 900
    norm = np.linalg.norm(imu.f_b_m_s2[standing], axis=1)
    assert np.median(norm) == pytest.approx(9.81, abs=0.1)
    assert np.median(imu.f_b_m_s2[standing, 2]) == pytest.approx(-9.81, abs=0.1)  # z down: specific force points up
    assert np.linalg.norm(np.median(imu.w_b_rad_s[standing], axis=0)) < math.radians(1)
    sent = heard("a_copter_square")[(1, 1), "RAW_IMU"]
    np.testing.assert_allclose(imu.f_b_m_s2, [[m.xacc, m.yacc, m.zacc] for _, m in sent] * np.array(9.80665e-3))
    np.testing.assert_allclose(imu.w_b_rad_s, [[m.xgyro, m.ygyro, m.zgyro] for _, m in sent] * np.array(1e-3))
    np.testing.assert_array_equal(imu.t_us, [m.time_usec for _, m in sent])


def test_highres_imu_of_px4() -> None:
    """PX4's HIGHRES_IMU comes in SI units, SCALED_IMU in mG: standing before take-off both measure gravity."""
    vehicle = samples("k13b_px4_tailsitter_fw").vehicles[1, 1]
    sent = heard("k13b_px4_tailsitter_fw")[(1, 1), "HIGHRES_IMU"]
    np.testing.assert_array_equal(vehicle.highres_imu.f_b_m_s2, np.array([[m.xacc, m.yacc, m.zacc] for _, m in sent]))
    np.testing.assert_array_equal(vehicle.highres_imu.w_b_rad_s, [[m.xgyro, m.ygyro, m.zgyro] for _, m in sent])
    for imu in (vehicle.highres_imu, vehicle.scaled_imu):
        assert "defined" in imu.scale
        standing = (imu.t_boot_us >= 0) & (imu.t_boot_us < 5_000_000)
        assert np.median(np.linalg.norm(imu.f_b_m_s2[standing], axis=1)) == pytest.approx(9.81, abs=0.05)
        assert np.median(imu.f_b_m_s2[standing, 2]) == pytest.approx(-9.81, abs=0.05)
    assert len(vehicle.raw_imu) == 0


@pytest.mark.parametrize(
    ("name", "message", "period_ms"),
    [("a_copter_square", "raw_imu", 40), ("b_copter_acro", "raw_imu", 20), ("f_reboot", "raw_imu", 40),
     ("p_px4_quad_square", "highres_imu", 20), ("k13b_px4_tailsitter_fw", "highres_imu", 40)],
)  # fmt: skip
def test_boot_times_of_imu_samples(name: str, message: str, period_ms: int) -> None:
    """On the boot clock an inertial sample lies within a sample period of the attitudes that came around it."""
    vehicle = samples(name).vehicles[1, 1]
    imu = getattr(vehicle, message)
    known = imu.t_boot_us >= 0
    assert known.mean() > 0.99
    assert set(imu.boot[known].tolist()) == set(vehicle.attitude.boot.tolist())
    for boot in set(imu.boot[known].tolist()):
        attitude, mine = vehicle.attitude[vehicle.attitude.boot == boot], imu[known & (imu.boot == boot)]
        after = np.searchsorted(attitude.t_rx_us, mine.t_rx_us).clip(1, len(attitude) - 1)
        nearest = np.minimum(
            abs(mine.t_boot_us - attitude.t_boot_us[after]), abs(mine.t_boot_us - attitude.t_boot_us[after - 1])
        )
        assert np.quantile(nearest, 0.99) <= 1000 * period_ms
        # Sensor and attitude are one clock's: the mapped time runs as fast as the message's own.
        np.testing.assert_allclose(np.diff(mine.t_boot_us), np.diff(mine.t_us), atol=1000 * period_ms)
