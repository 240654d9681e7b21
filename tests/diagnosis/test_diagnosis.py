"""The convention doctor: mistakes put into recordings of real autopilots, and motions that cannot tell them apart."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import gcs_bridge
from gcs_bridge import diagnosis
from gcs_bridge.contract import plain
from gcs_bridge.diagnosis import Diagnosis, Window, diagnose, diagnose_norm
from gcs_bridge.diagnosis.causes import CAUSES
from gcs_bridge.diagnosis.hypotheses import AHRS_TRIM, VTOL_VIEW
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from gcs_bridge.settings import AlignmentSettings
from gcs_bridge.telemetry.samples import ATTITUDE, ATTITUDE_QUATERNION, AttitudeSamples
from tests.helpers import diagnosis_oracle as oracle
from tests.helpers.everyday import in_turns, one_in
from tests.helpers.paths import FIXTURES as SITL
from tests.helpers.wire import Motion, record, records

Array = NDArray[np.float64]


# --- windows ---------------------------------------------------------------------------------------------------------


@cache
def read(path: Path) -> Any:
    return gcs_bridge.read(path)


def window(path: Path, key: tuple[int, int] = (1, 1), *, from_s: float = 0.0, to_s: float = 1e6, **more: Any) -> Window:
    """The samples of a recording's longest boot, by the boot clock."""
    vehicle = read(path).vehicles[key]
    both = vehicle.attitude, vehicle.attitude_quaternion
    boot = np.bincount(vehicle.attitude.boot).argmax()
    chosen = [s[(s.boot == boot) & (s.t_boot_us >= from_s * 1e6) & (s.t_boot_us <= to_s * 1e6)] for s in both]
    return Window(euler=chosen[0], quaternion=chosen[1], **more)


def told(found: Diagnosis | None) -> Diagnosis:
    assert found is not None
    return found


def samples(t_s: Array, attitude: Rotation | Array, rates: Array, source: str) -> AttitudeSamples:
    """Samples of a rotation, or of angles or quaternions as they are to be sent, in float32 as on the wire."""
    n = len(t_s)
    if isinstance(attitude, Rotation):
        sent = attitude.as_euler("ZYX")[:, ::-1] if source == ATTITUDE else attitude.as_quat()[:, [3, 0, 1, 2]]
    else:
        sent = attitude
    sent = sent.astype(np.float32).astype(np.float64)
    t_us = np.rint(t_s * 1000).astype(np.int64) * 1000
    return AttitudeSamples(
        frame_index=np.arange(n),
        boot=np.zeros(n, np.int64),
        t_boot_us=t_us,
        t_rx_us=np.full(n, -1),
        q_nb=np.zeros((n, 4)) if source == ATTITUDE else sent,
        w_nb_b_rad_s=rates,
        valid=np.ones(n, np.bool_),
        source=source,
        rpy_rad=sent if source == ATTITUDE else None,
    )


def made(t_s: Array, true: Rotation, rates: Array, *, rpy: Array | None = None, wxyz: Array | None = None) -> Window:
    """A window of a vehicle that moves so, with other angles or quaternions where some are given."""
    euler = samples(t_s, true if rpy is None else rpy, rates, ATTITUDE)
    quaternion = samples(t_s, true if wxyz is None else wxyz, rates, ATTITUDE_QUATERNION)
    return Window(euler=euler, quaternion=quaternion, clean_before=True)


def turning(yaw_deg: Array, *, roll_deg: float | Array = 0.0, pitch_deg: float | Array = 0.0, hz: float = 25.0) -> Any:
    """Times, attitude and rates of a vehicle that leans constantly and whose yaw goes so."""
    t_s = 10.0 + np.arange(len(yaw_deg)) / hz
    lean = np.broadcast_to(np.stack(np.broadcast_arrays(pitch_deg, roll_deg), axis=-1), (len(yaw_deg), 2))
    true = Rotation.from_euler("ZYX", np.column_stack((yaw_deg, lean)), degrees=True)
    rates = np.gradient(np.unwrap(np.radians(yaw_deg)), 1 / hz)[:, None] * true.inv().apply([0, 0, 1])
    return t_s, true, rates


def wxyz(true: Rotation) -> Array:
    q: Array = true.as_quat()[:, [3, 0, 1, 2]]
    return q


def rpy(true: Rotation) -> Array:
    angles: Array = true.as_euler("ZYX")[:, ::-1]
    return angles


def sent_of(of: Window) -> oracle.Sent:
    """The window's fields for the oracle."""
    assert of.euler.rpy_rad is not None
    return oracle.Sent(of.euler.t_boot_us / 1e6, of.euler.rpy_rad, of.quaternion.t_boot_us / 1e6, of.quaternion.q_nb)


# --- each cause ------------------------------------------------------------------------------------------------------

FAULTS = [cause.name for cause in CAUSES.values() if cause.falsify is not None and cause.name != "euler_rates"]
RATES = {
    "as it is": (),
    "10 and 4 Hz": ("thin:ATTITUDE=10", "thin:ATTITUDE_QUATERNION=4"),
    "4 Hz": ("thin:ATTITUDE=4",),
    "25 and 10 Hz": ("thin:ATTITUDE=25", "thin:ATTITUDE_QUATERNION=10"),
    "both 4 Hz": ("thin:ATTITUDE=4", "thin:ATTITUDE_QUATERNION=4"),
}
# Where the flight has motion in it: name → first attitude's boot time, and seconds after it.
FLIGHTS = {"b_copter_acro": (175.563, 20.0), "a_copter_square": (9.0, 45.0)}


def injected(folder: Path, name: str, *faults: str, **scope: Any) -> Path:
    path = folder / "falsified.tlog"
    path.write_bytes(inject((SITL / f"{name}.tlog").read_bytes(), [parse_fault(fault) for fault in faults], **scope))
    read.cache_clear()
    return path


@pytest.mark.parametrize("fault", one_in(4, FAULTS))
@pytest.mark.parametrize(
    ("name", "rates"), one_in(2, [*((f, "as it is") for f in FLIGHTS), ("b_copter_acro", "10 and 4 Hz")])
)
def test_each_cause_is_named(tmp_path: Path, name: str, rates: str, fault: str) -> None:
    """In flight each mistake of the table is named, alone and with its value, at full rate and at common ones."""
    first_s, after_s = FLIGHTS[name]
    path = injected(tmp_path, name, *RATES[rates], fault, from_s=after_s)
    found = told(diagnose(window(path, from_s=first_s + after_s + 1.0)))
    assert found.causes == (fault,)
    assert found.confidence == "certain"
    assert found.candidates == (fault,)
    value = CAUSES[fault].parameter.default or ()
    assert len(found.values[0]) == len(value)
    tolerance = 5.0 if fault == "time_skew" else 0.2
    np.testing.assert_allclose(found.values[0], value, atol=tolerance if fault != "quaternion_unnormalised" else 1e-3)
    if CAUSES[fault].undo is not None:
        assert found.residual_deg is not None
        assert found.residual_deg < 0.1


@pytest.mark.parametrize(
    ("fault", "value"),
    one_in(
        3,
        [
            *(("yaw_offset", (v,)) for v in (1.0, -5.0, 30.0, 90.0, 180.0)),
            *(
                ("mount_offset", v)
                for v in ((1.0, 0, 0), (0, 0, -5.0), (0, 90.0, 0), (20.0, -10.0, 5.0), (0.7, 0.7, -0.3))
            ),
            *(("time_skew", (v,)) for v in (20.0, -40.0, 100.0, -250.0, 500.0)),
            *(("quaternion_unnormalised", (v,)) for v in (0.9, 1.01, 2.0)),
            ("world_offset", (3.0, -2.0, 10.0)),
        ],
    ),
)
def test_values(tmp_path: Path, fault: str, value: tuple[float, ...]) -> None:
    """Yaw from 1 to 180°, mounts from 1 to 90° about any axis, lags from 20 to 500 ms: to 0.2° and 2 ms."""
    given = ",".join(f"{number:g}" for number in value)
    path = injected(tmp_path, "b_copter_acro", f"{fault}:{given}", from_s=20.0)
    found = told(diagnose(window(path, from_s=196.6)))
    assert (found.causes, found.confidence) == ((fault,), "certain")
    seen = np.array(found.values[0])
    if fault == "yaw_offset" and abs(value[0]) == 180:  # either way round
        seen = np.abs(seen)
    np.testing.assert_allclose(seen, value, atol=2.0 if fault == "time_skew" else 0.2)


def test_a_turned_quaternion_that_is_interpolated(tmp_path: Path) -> None:
    """Its rates are not turned: 37° of mount offset are found to 0.2° at 10 against 50 Hz and never one instant."""
    path = injected(tmp_path, "b2_mixed_rates", "mount_offset:30,-20,10")
    found = told(diagnose(window(path)))
    assert (found.causes, found.confidence) == (("mount_offset",), "certain")
    np.testing.assert_allclose(found.values[0], (30, -20, 10), atol=0.2)


def test_outliers_have_no_say() -> None:
    """With 6 % of the window healthy, as where an onset is seen too early, 12° of yaw are still 12.0°."""
    motion = Motion(20.0, seed=8)
    t_s = np.arange(0.0, 20.0, 0.04)
    true = motion.rotation(t_s)
    sent = wxyz(Rotation.from_euler("z", 12, degrees=True) * true)
    sent[:30] = wxyz(true)[:30]
    found = told(diagnose(made(t_s, true, motion.rates(t_s), wxyz=sent)))
    assert (found.causes, found.confidence) == (("yaw_offset",), "certain")
    assert found.values[0][0] == pytest.approx(12, abs=0.02)


def test_an_onset_that_was_seen_too_early() -> None:
    """A window whose first 40 % are healthy, turning as the rest, is judged from the first disagreement on."""
    motion = Motion(20.0, seed=9)
    t_s = np.arange(0.0, 20.0, 0.04)
    sent = motion.rpy(t_s)
    sent[200:] *= [-1, 1, 1]
    found = told(diagnose(made(t_s, motion.rotation(t_s), motion.rates(t_s), rpy=sent)))
    assert (found.causes, found.confidence) == (("roll_sign",), "certain")


TWO = [
    ("time_skew:80", "yaw_offset:-7"),
    ("quaternion_conjugate", "time_skew:-120"),
    ("enu_flu", "yaw_offset:15"),
    ("roll_sign", "mount_offset:5,-9,14"),
    ("yaw_sign", "quaternion_xyzw"),
]


@pytest.mark.parametrize("faults", one_in(5, [(faults,) for faults in TWO]), ids="+".join)
def test_two_causes(tmp_path: Path, faults: tuple[str, str]) -> None:
    """Two mistakes at once are named, in the order of undoing: for any motion the same as what was injected."""
    path = injected(tmp_path, "b_copter_acro", *faults, from_s=20.0)
    found = told(diagnose(window(path, from_s=196.6)))
    assert found.confidence == "certain"
    assert found.cause == "+".join(found.causes)
    truth = [(fault.name, fault.value) for fault in map(parse_fault, reversed(faults))]
    named = list(zip(found.causes, found.values, strict=True))
    assert oracle.apart_deg(truth, named) < 0.3
    skew = [dict(one).get("time_skew", (0.0,))[0] for one in (truth, named)]
    assert skew[1] == pytest.approx(skew[0], abs=3)


@pytest.mark.parametrize(
    ("signs", "cause"),
    [
        ((1, -1, -1), "nwu_flu"),  # pitch and yaw
        ((-1, -1, -1), "euler_xyz_order+quaternion_conjugate"),
    ],
)
def test_what_is_never_apart_has_the_simpler_name(signs: Sequence[int], cause: str) -> None:
    """Signs that are for all motion the same as another mistake are named as that one."""
    motion = Motion(20.0, seed=3)
    t_s = np.arange(0.0, 20.0, 0.04)
    found = told(diagnose(made(t_s, motion.rotation(t_s), motion.rates(t_s), rpy=motion.rpy(t_s) * signs)))
    assert (found.cause, found.confidence) == (cause, "certain")


def test_the_wrong_order_of_axes_is_not_three_mistakes() -> None:
    """X-Y-Z order is the same as all signs and a conjugate: one mistake is named."""
    motion = Motion(20.0, seed=3)
    t_s = np.arange(0.0, 20.0, 0.04)
    q = motion.wxyz(t_s) * [1, -1, -1, -1]
    found = told(diagnose(made(t_s, motion.rotation(t_s), motion.rates(t_s), rpy=-motion.rpy(t_s), wxyz=q)))
    assert found.cause == "euler_xyz_order"


# --- nothing to name -------------------------------------------------------------------------------------------------

HEALTHY = sorted(
    (path.name.removesuffix(".facts.json"), tuple(map(int, vehicle.split(","))))
    for path in SITL.glob("*.facts.json")
    for vehicle, facts in json.loads(path.read_text(encoding="utf-8"))["vehicles"].items()
    if json.loads(path.read_text(encoding="utf-8"))["euler_quaternion"] == "agree"
)


@pytest.mark.parametrize(("name", "key"), HEALTHY)
def test_healthy_recordings_have_no_diagnosis(name: str, key: tuple[int, int]) -> None:
    """Where both forms agree there is no mistake to name."""
    assert diagnose(window(SITL / f"{name}.tlog", key)) is None


def test_a_reset_in_both_is_no_mistake() -> None:
    """Both agree and both stepped: the estimator was reset, and nothing is to be converted."""
    found = told(diagnose(window(SITL / "k12_yaw_reset.tlog", reset=True)))
    assert (found.cause, found.side) == ("estimator_reset", None)


def test_no_sample_of_one_message() -> None:
    """Where nothing can be compared nothing is named."""
    whole = window(SITL / "a_copter_square.tlog")
    for absent in (replace(whole, euler=whole.euler[:0]), replace(whole, quaternion=whole.quaternion[:0])):
        assert diagnose(absent) is None


def drifting(t_s: Array) -> Rotation:
    return Rotation.from_euler("z", (3.0 + 0.5 * (t_s - t_s[0]))[:, None], degrees=True)


def test_a_drift_is_unknown() -> None:
    """A yaw error that grows by half a degree a second is none of the mistakes, and its rate is told: 30° a minute."""
    motion = Motion(40.0, seed=4)
    t_s = np.arange(0.0, 40.0, 0.04)
    true = motion.rotation(t_s)
    found = told(diagnose(made(t_s, true, motion.rates(t_s), wxyz=wxyz(drifting(t_s) * true))))
    assert (found.cause, found.confidence, found.candidates) == ("unknown", "unknown", ())
    assert found.shape == "drifting by 30° a minute"
    assert found.shape in found.fix


def test_three_mistakes_are_unknown() -> None:
    """What no one and no two mistakes explain is not forced into a name."""
    motion = Motion(30.0, seed=5)
    t_s = np.arange(0.0, 30.0, 0.04)
    true = motion.rotation(t_s)
    q = (Rotation.from_euler("z", 10, degrees=True) * true * Rotation.from_euler("x", 6, degrees=True)).inv()
    found = told(diagnose(made(t_s, true, motion.rates(t_s), rpy=motion.rpy(t_s) * [-1, 1, 1], wxyz=wxyz(q))))
    assert found.cause == "unknown"


HARDEST = ("p_px4_quad_square", *RATES["10 and 4 Hz"])  # no two samples at one instant, at the lowest rates


def test_two_offsets_are_not_taken_for_one(tmp_path: Path) -> None:
    """A yaw and a mount offset together are no single one, though at 10 and 4 Hz one would leave only 0.3°."""
    path = injected(tmp_path, *HARDEST, "yaw_offset:12", "mount_offset:0,4,0")
    assert told(diagnose(window(path, from_s=36.0, to_s=41.0))).cause == "unknown"


def test_wide_bounds_hide_no_second_mistake(tmp_path: Path) -> None:
    """World ENU alone leaves 0.2° at 10 and 4 Hz; with the lag that is there too, far less: both are named."""
    path = injected(tmp_path, *HARDEST, "world_enu", "time_skew:40")
    found = told(diagnose(window(path, from_s=31.6)))
    assert (set(found.causes), found.confidence) == ({"world_enu", "time_skew"}, "certain")


def test_one_mistake_that_barely_explains_stands_beside_two(tmp_path: Path) -> None:
    """ENU, RFU and a turned yaw are nearly a swap of roll and pitch: within the bounds both are candidates."""
    path = injected(tmp_path, "b_copter_acro", *RATES["10 and 4 Hz"], "yaw_sign", "enu_rfu")
    found = told(diagnose(window(path, from_s=196.0)))
    assert {"yaw_sign", "enu_rfu"} in [set(candidate.split("+")) for candidate in found.candidates]


# --- what the motion cannot tell -------------------------------------------------------------------------------------

BENCH = [  # roll and pitch in degrees, yaw as it goes, what was sent, and which of the candidates is the truth
    ("level, yawing", 0.0, np.linspace(20, 80, 250), "yaw_sign"),
    ("level, yawing", 0.0, np.linspace(20, 80, 250), "quaternion_conjugate"),
    ("steadily banked, yawing", 20.0, np.linspace(20, 80, 250), "roll_sign"),
    ("level, yawing", 0.0, np.linspace(20, 80, 250), "nwu_flu"),
    ("level, still", 0.0, np.full(250, 50.0), "yaw_sign"),
    ("level, still", 0.0, np.full(250, 50.0), "yaw_offset"),
    ("level, yawing", 0.0, np.linspace(20, 80, 250), "yaw_offset"),
    ("level, still", 0.0, np.full(250, 50.0), "quaternion_conjugate"),
]


def mistaken(fault: str, true: Rotation) -> dict[str, Array]:
    """The angles or quaternions that a mistake sends, by SciPy."""
    if fault in oracle.RPY:
        return {"rpy": oracle.RPY[fault](rpy(true))}  # signs are their own inverse
    return {"wxyz": wxyz(oracle._made(true, fault, (12.0,)))}


@pytest.mark.parametrize(
    ("how", "roll_deg", "yaw_deg", "fault"), one_in(2, BENCH), ids=[f"{b[0]}: {b[3]}" for b in BENCH]
)
def test_a_bench_cannot_tell(how: str, roll_deg: float, yaw_deg: Array, fault: str) -> None:
    """Two to four candidates are named, the truth and others; SciPy undoes each, and each fits; the fix is a motion."""
    t_s, true, rates = turning(yaw_deg, roll_deg=roll_deg)
    of = made(t_s, true, rates, **mistaken(fault, true))
    found = told(diagnose(of))
    assert 2 <= len(found.candidates) <= 4
    assert fault in found.candidates
    assert (found.confidence, found.side) == ("probable", None)
    for candidate in found.candidates:
        assert oracle.leaves_deg(sent_of(of), candidate) < 0.1, candidate
    assert "Not told apart yet" in found.fix
    assert "that will tell" in found.fix
    entry = found.entry()
    assert (entry.distinguishable, entry.candidates) == (False, found.candidates)


@pytest.mark.parametrize("fault", ["yaw_sign", "quaternion_conjugate", "nwu_flu", "enu_rfu", "yaw_offset"])
def test_a_yaw_turn_in_hover_tells(fault: str) -> None:
    """A turn by 60° while leaning by 2°, as in any hover, leaves one candidate alone."""
    yaw_deg = 50 + 30 * np.sin(np.linspace(0, 6, 250))
    t_s, true, rates = turning(yaw_deg, roll_deg=2.0, pitch_deg=-1.5)
    found = told(diagnose(made(t_s, true, rates, **mistaken(fault, true))))
    assert (found.causes, found.confidence) == ((fault,), "certain")


def test_the_motion_that_is_advised_tells() -> None:
    """After the very motion that the fix names the candidates are no longer tied."""
    t_s, true, rates = turning(np.linspace(20, 80, 250))
    fix = told(diagnose(made(t_s, true, rates, **mistaken("yaw_sign", true)))).fix
    advised = {
        axis.lower(): float(size) for axis, size in re.findall(r"(roll|pitch|yaw) by (\d+)°", fix, re.IGNORECASE)
    }
    assert 0 < sum(advised.values()) <= 10
    slowly = np.concatenate((np.zeros(250), np.linspace(0, 1, 25), np.ones(50)))
    yaw_deg = np.concatenate((np.linspace(20, 80, 250), np.full(75, 80.0))) + advised.get("yaw", 0.0) * slowly
    roll_deg, pitch_deg = (advised.get(axis, 0.0) * slowly for axis in ("roll", "pitch"))
    t_s, true, rates = turning(yaw_deg, roll_deg=roll_deg, pitch_deg=pitch_deg)
    assert told(diagnose(made(t_s, true, rates, **mistaken("yaw_sign", true)))).candidates == ("yaw_sign",)


def test_a_lag_looks_like_an_offset_in_a_steady_turn() -> None:
    """At 20 °/s, 150 ms are 3° of yaw; once the turn ends the lag alone fits."""
    ramp = np.arange(250) * 20 / 25
    lag = np.rint(0.15 * 1000) / 1000
    t_s, true, rates = turning(ramp)
    steady = made(t_s, true, rates)
    late = replace(
        steady, quaternion=replace(steady.quaternion, t_boot_us=steady.quaternion.t_boot_us + int(lag * 1e6))
    )
    found = told(diagnose(late))
    assert {"time_skew", "yaw_offset"} <= set(found.candidates)
    assert found.confidence == "probable"
    t_s, true, rates = turning(np.concatenate((ramp, np.full(100, ramp[-1]))))
    ended = made(t_s, true, rates)
    late = replace(ended, quaternion=replace(ended.quaternion, t_boot_us=ended.quaternion.t_boot_us + int(lag * 1e6)))
    found = told(diagnose(late))
    assert found.causes == ("time_skew",)
    assert found.values[0][0] == pytest.approx(150, abs=2)


def test_the_few_turns_of_a_long_rest_decide() -> None:
    """A minute at rest agrees with any turned sign; a lag that shows in three seconds of turning is still told."""
    yaw_deg = np.concatenate((np.full(1500, 30.0), 30 + 20 * (1 - np.cos(np.linspace(0, 4 * np.pi, 75)))))
    t_s, true, rates = turning(yaw_deg, roll_deg=0.01)
    of = made(t_s, true, rates)
    late = replace(of, quaternion=replace(of.quaternion, t_boot_us=of.quaternion.t_boot_us + 120_000))
    found = told(diagnose(late))
    assert (found.causes, found.confidence) == (("time_skew",), "certain")
    assert found.values[0][0] == pytest.approx(120, abs=2)


def test_what_explains_no_better_than_nothing_is_no_candidate(tmp_path: Path) -> None:
    """At 10 and 4 Hz in acro the bounds are as wide as 1° of mount offset: yet that is not taken for a lag."""
    path = injected(tmp_path, "b2_mixed_rates", *RATES["10 and 4 Hz"], "mount_offset:1,0,0")
    assert told(diagnose(window(path, from_s=105.2, to_s=108.2))).candidates == ("mount_offset",)


def test_a_constant_heading_cannot_tell_the_world_from_the_body() -> None:
    """With the nose east, a world that is tilted about north is a body tilted about its y, however it pitches."""
    t_s, true, rates = turning(np.full(250, 90.0), pitch_deg=10 * np.sin(np.linspace(0, 9, 250)))
    tilted = Rotation.from_euler("x", 4, degrees=True) * true
    of = made(t_s, true, rates, wxyz=wxyz(tilted))
    found = told(diagnose(of))
    assert set(found.candidates) == {"mount_offset", "world_offset"}
    for candidate in found.candidates:
        assert oracle.leaves_deg(sent_of(of), candidate) < 0.1
    assert "Yaw by" in found.fix


def test_six_samples_are_no_constant(tmp_path: Path) -> None:
    """At 4 Hz an alarm rests on six pairs: too few to name a constant by, and the fix says so."""
    path = injected(tmp_path, "b_copter_acro", "thin:ATTITUDE=4", "thin:ATTITUDE_QUATERNION=4", "yaw_offset:12")
    found = told(diagnose(window(path, from_s=190.0, to_s=191.4)))
    assert (found.cause, found.fix) == ("unknown", "Too little data yet to tell.")


def test_what_barely_explains_too_few_pairs_is_not_named(tmp_path: Path) -> None:
    """150 ms of skew at 4 Hz, in disagreement for two seconds: a mirrored yaw fits those few pairs by chance."""
    path = injected(tmp_path, "k8_stream_stops", *RATES["both 4 Hz"], "time_skew:150", from_s=16.997)
    (vehicle,) = gcs_bridge.check(path).to_dict()["files"][0]["vehicles"]
    (found,) = (alarm["diagnosis"] for alarm in vehicle["alarms"] if alarm["check"] == "euler_quaternion")
    assert found["cause"] == "unknown" or "time_skew" in found["candidates"]


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "sysid", "rates", "fault", "begin"),
    [
        ("e_two_vehicles", 2, "10 and 4 Hz", "yaw_offset:90", 0.2),  # seven pairs: too few for a constant
        ("g_signed", 1, "both 4 Hz", "roll_sign", 0.2),  # half of the mean's window lies before the onset
        ("a_copter_square", 1, "as it is", "time_skew:20", 0.35),  # undone, it leaves nothing; a mount offset 0.25°
        ("b2_mixed_rates", 1, "both 4 Hz", "nwu_flu", 0.35),  # bounds of degrees excuse degrees
        ("b2_mixed_rates", 1, "as it is", "mount_offset:1,0,0", 0.45),  # less than the bounds, but for one pair
        ("b2_mixed_rates", 1, "25 and 10 Hz", "world_offset:4,0,0", 0.5),  # a turned pitch would turn too fast to judge
        ("k13b_px4_tailsitter_fw", 1, "10 and 4 Hz", "time_skew:500", 0.65),  # a steady turn, or nearly
        ("k7a_gyro_bias_both", 1, "both 4 Hz", "time_skew:150", 0.65),  # after a reset, with bounds of 30°
        ("p_px4_quad_square", 1, "10 and 4 Hz", "yaw_sign", 0.55),  # nearly level
    ],
)
def test_no_answer_misleads(tmp_path: Path, name: str, sysid: int, rates: str, fault: str, begin: float) -> None:
    """From the first answer, which comes with the alarm, to the last: what is named fits, and the mistake is named."""
    path = injected(tmp_path, name, *RATES[rates], sysid=sysid) if RATES[rates] else SITL / f"{name}.tlog"
    data = path.read_bytes()
    times_us = [t_us for t_us, _ in records(data)]
    path = tmp_path / "falsified.tlog"
    path.write_bytes(inject(data, [parse_fault(fault)], sysid=sysid, from_s=begin * (times_us[-1] - times_us[0]) / 1e6))
    (sent,) = oracle.boots(path.read_bytes(), sysid)
    asked: list[tuple[Window, Diagnosis | None]] = []

    def noted(of: Window, alignment: AlignmentSettings | None = None) -> Diagnosis | None:
        asked.append((of, diagnose(of, alignment)))
        return asked[-1][1]

    with mock.patch.object(diagnosis, "diagnose", noted):  # what an answer rests on is told by nobody else
        gcs_bridge.check(path)
    named = [(of, found) for of, found in asked if found and found.cause != "unknown"]
    assert named
    for of, found in named:
        assert fault.partition(":")[0] in found.candidates
        if len(found.candidates) > 1:
            boot_s = np.concatenate((of.euler.t_boot_us, of.quaternion.t_boot_us)) / 1e6
            rests_on = sent.between(boot_s.min(), boot_s.max())
            assert max(oracle.leaves_deg(rests_on, candidate) for candidate in found.candidates) < 0.3


def test_wide_bounds_excuse_no_half_degree(tmp_path: Path) -> None:
    """1° of yaw in acro, never at one instant: a mount offset would leave 0.5°, and is no candidate."""
    path = injected(tmp_path, "b2_mixed_rates", "yaw_offset:1")
    assert told(diagnose(window(path, from_s=105.0))).candidates == ("yaw_offset",)


def test_too_short_to_be_certain(tmp_path: Path) -> None:
    """Within a second, or without a change of rate, a constant is at most probable."""
    path = injected(tmp_path, "b_copter_acro", "yaw_offset:12", from_s=20.0)
    short = diagnose(window(path, from_s=196.6, to_s=197.4))
    assert short is None or short.confidence != "certain"
    t_s, true, rates = turning(np.full(250, 50.0), roll_deg=15.0)
    still = told(diagnose(made(t_s, true, rates, **mistaken("yaw_offset", true))))
    assert still.confidence == "probable"


# --- trims that nobody told -------------------------------------------------------------------------------------------


def test_a_pitch_trim_may_be_a_mount_offset() -> None:
    """On a plane that did not bank both are named, what is no mistake first; where it was told it is no candidate."""
    t_s, true, rates = turning(np.linspace(0, 90, 250), pitch_deg=4.0)
    of = made(t_s, true, rates, rpy=rpy(true) - np.radians([0, 3.0, 0]))
    assert told(diagnose(replace(of, trims=("pitch_trim",)))).candidates[:2] == ("pitch_trim", "mount_offset")
    assert "pitch_trim" not in told(diagnose(of)).candidates


def test_a_bank_tells_a_pitch_trim() -> None:
    """A real plane in banked flight with PTCH_TRIM_DEG 3: the trim alone fits."""
    found = told(diagnose(window(SITL / "d_plane_pitchtrim3.tlog", trims=("pitch_trim", "ahrs_trim"))))
    assert found.causes == ("pitch_trim",)
    assert found.values[0][0] == pytest.approx(3, abs=0.1)
    assert "PTCH_TRIM_DEG must be 3.0°" in found.fix


def test_expected_differences_are_undone_under_each_hypothesis(tmp_path: Path) -> None:
    """With the trim known, 5° of yaw on top of it are found, and so is a pitch sign, made behind the trim."""

    def trimmed(angles: Array, _: Any) -> Array:
        return wxyz(oracle.euler_rotation(angles + np.radians([0, 3.0, 0])))

    for fault in ("yaw_offset:5", "pitch_sign"):
        path = injected(tmp_path, "d_plane_pitchtrim3", fault)
        found = told(diagnose(window(path, attitude_of=trimmed)))
        assert (found.causes, found.confidence) == ((fault.split(":")[0],), "certain")


def test_a_plane_with_a_mistake_and_an_untold_trim(tmp_path: Path) -> None:
    """A real plane whose PTCH_TRIM_DEG of 3 nobody told, and a conjugate from the first sample on: both are named."""
    found = told(
        diagnose(window(injected(tmp_path, "d_plane_pitchtrim3", "quaternion_conjugate"), trims=("pitch_trim",)))
    )
    assert found.causes == ("quaternion_conjugate", "pitch_trim")
    assert found.values[1][0] == pytest.approx(3, abs=0.01)


def test_ahrs_trim_by_scipy() -> None:
    """What is undone and made is ArduPilot's formula: q turned by −trim in the body, the trim taken off the angles."""
    trim_deg = (5.0, -3.0)
    angles = np.random.default_rng(3).uniform((-3, -1.5, -3), (3, 1.5, 3), (50, 3))
    sent = oracle.Sent(np.arange(50.0), angles, np.zeros(0), np.zeros((0, 4)))
    assert AHRS_TRIM.undo is not None
    assert AHRS_TRIM.falsify is not None
    expected = oracle.euler_rotation(oracle.undone(sent, "ahrs_trim", trim_deg).rpy_rad)
    undone = oracle.euler_rotation(AHRS_TRIM.undo(angles, trim_deg))
    np.testing.assert_allclose((expected.inv() * undone).magnitude(), 0, atol=1e-12)
    again = oracle.euler_rotation(AHRS_TRIM.falsify(rpy(undone), trim_deg))
    np.testing.assert_allclose((oracle.euler_rotation(angles).inv() * again).magnitude(), 0, atol=1e-12)


# AHRS_TRIM of real copters: TRIM_X and TRIM_Y, deg, as their parameters or notes say.
TRIMMED = {"j_ahrs_trim5": (5.0, -3.0), "k1_copter_trim": (-2.0, 3.0)}


def untold(folder: Path, name: str, *faults: str) -> Path:
    """A recording that does not tell AHRS_TRIM, with mistakes from its first sample on."""
    kept = [(t_us, frame) for t_us, frame in records((SITL / f"{name}.tlog").read_bytes()) if b"AHRS_TRIM" not in frame]
    path = folder / "untold.tlog"
    path.write_bytes(inject(b"".join(record(*one) for one in kept), [parse_fault(fault) for fault in faults]))
    return path


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "name", "rates"),
    in_turns(
        2,
        ["quaternion_conjugate", "roll_pitch_swapped", "yaw_offset:12", "time_skew:-250"],
        list(TRIMMED),
        ["as it is", "10 and 4 Hz", "10 and 4 Hz"],
    ),
)
def test_a_mistake_beside_an_untold_trim(tmp_path: Path, name: str, rates: str, fault: str) -> None:
    """A mistake from the first sample on, and a trim that nobody told: in flight both are named, with their values."""
    (vehicle,) = gcs_bridge.check(untold(tmp_path, name, *RATES[rates], fault)).to_dict()["files"][0]["vehicles"]
    found = next(alarm["diagnosis"] for alarm in vehicle["alarms"] if alarm["check"] == "euler_quaternion")
    cause, _, value = fault.partition(":")
    assert found["causes"] == [cause, "ahrs_trim"]
    if not value:
        np.testing.assert_allclose(found["value"], TRIMMED[name], atol=0.05)
    else:
        assert found["value"] == pytest.approx(float(value), abs=5.0 if cause == "time_skew" else 0.2)


@pytest.mark.parametrize("view_deg", [4.0, 90.0])
def test_a_view_by_scipy(view_deg: float) -> None:
    """ATTITUDE of a hovering plane is that of a body pitched down by the view; undone, it is the quaternion's again."""
    q_nb = Rotation.from_euler("ZYX", np.random.default_rng(5).uniform(-1.2, 1.2, (50, 3)))
    sent = rpy(q_nb * Rotation.from_euler("y", -view_deg, degrees=True))
    assert VTOL_VIEW.undo is not None
    assert VTOL_VIEW.falsify is not None
    undone = oracle.euler_rotation(VTOL_VIEW.undo(sent, (view_deg,)))
    t_s = np.arange(50.0)
    both = oracle.Sent(t_s, sent, t_s, wxyz(q_nb))
    assert oracle.fitted(both, "vtol_view") == pytest.approx((view_deg,), abs=1e-6)
    assert oracle.leaves_deg(both, "vtol_view") < 1e-6
    made_again = oracle.euler_rotation(VTOL_VIEW.falsify(rpy(q_nb), (view_deg,)))
    np.testing.assert_allclose((undone.inv() * q_nb).magnitude(), 0, atol=1e-9)
    np.testing.assert_allclose((made_again.inv() * oracle.euler_rotation(sent)).magnitude(), 0, atol=1e-9)


def staggered(folder: Path, name: str) -> Path:
    """A recording without each second ATTITUDE and the ATTITUDE_QUATERNION between: never of one instant."""
    seen, kept = {30: 0, 31: 1}, []
    for t_us, frame in records((SITL / f"{name}.tlog").read_bytes()):
        msgid = int.from_bytes(frame[7:10], "little")
        seen[msgid] = seen.get(msgid, 0) + 1
        if msgid not in (30, 31) or seen[msgid] % 2:
            kept.append(record(t_us, frame))
    path = folder / "staggered.tlog"
    path.write_bytes(b"".join(kept))
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "cause", "value"),
    [
        ("j_ahrs_trim5", "ahrs_trim", [5.0, -3.0]),
        ("d_plane_pitchtrim3", "pitch_trim", 3.0),
        ("d_tailsitter", "vtol_view", 90.0),
    ],
)
def test_no_mistake_is_made_of_what_a_firmware_does(tmp_path: Path, name: str, cause: str, value: Any) -> None:
    """Where the two never share an instant, untold trims and views are fitted too: the doctor need not be asked."""
    (vehicle,) = gcs_bridge.check(staggered(tmp_path, name)).to_dict()["files"][0]["vehicles"]
    assert [alarm for alarm in vehicle["alarms"] if alarm["check"] == "euler_quaternion"] == []
    (entry,) = (check for check in vehicle["checks"] if check["name"] == "euler_quaternion")
    (one,) = (one for one in entry["explained_by"] if one["cause"] == cause)
    np.testing.assert_allclose(one["value"], value, atol=0.3)
    assert one["estimated"]


def test_rates_that_are_no_numbers_hide_no_trim(tmp_path: Path) -> None:
    """Never at one instant, and every tenth rate of ATTITUDE is NaN: the others tell both all the same."""
    of = window(untold(tmp_path, "k1_copter_trim", "quaternion_conjugate"), from_s=65.0, trims=("ahrs_trim",))
    apart = replace(of, euler=of.euler[::2], quaternion=of.quaternion[1::2])
    apart.euler.w_nb_b_rad_s[::10] = math.nan
    found = told(diagnose(apart))
    assert found.causes == ("quaternion_conjugate", "ahrs_trim")
    np.testing.assert_allclose(found.values[1], TRIMMED["k1_copter_trim"], atol=0.2)


# --- the rest of the answer ------------------------------------------------------------------------------------------


def test_which_message_is_at_fault() -> None:
    """A body that is turned on ATTITUDE's side is told by that message's own rates, a turned world never."""
    motion = Motion(20.0, seed=6)
    t_s = np.arange(0.0, 20.0, 0.04)
    true, rates = motion.rotation(t_s), motion.rates(t_s)
    turned = true * Rotation.from_euler("y", 20, degrees=True)
    assert told(diagnose(made(t_s, true, rates, wxyz=wxyz(turned)))).side == 31
    assert told(diagnose(made(t_s, true, rates, rpy=rpy(turned)))).side == 30
    assert told(diagnose(made(t_s, true, 0.5 * rates, wxyz=wxyz(turned)))).side is None  # rates that deny both
    north = Rotation.from_euler("z", 12, degrees=True) * true
    assert told(diagnose(made(t_s, true, rates, wxyz=wxyz(north)))).side is None


def test_frozen_needs_motion_to_be_certain() -> None:
    """A quaternion that stands still bit by bit while the angles' last digits move is probably frozen, no offset."""
    t_s, true, rates = turning(50 + 1e-4 * np.sin(np.arange(250)))
    held = np.repeat(wxyz(Rotation.from_euler("z", [[30]], degrees=True)), 250, axis=0)
    of = made(t_s, true, rates, wxyz=held)
    still = replace(of, quaternion=replace(of.quaternion, w_nb_b_rad_s=np.zeros((250, 3))))
    found = told(diagnose(still))
    assert (found.causes, found.confidence, found.side) == (("frozen_quaternion",), "probable", 31)


def test_a_norm_beside_another_mistake(tmp_path: Path) -> None:
    """A conjugate of norm 1.05 is two mistakes, and the value is the norm."""
    path = injected(tmp_path, "b_copter_acro", "quaternion_conjugate", "quaternion_unnormalised:1.05", from_s=20.0)
    found = told(diagnose(window(path, from_s=196.6)))
    assert found.causes == ("quaternion_conjugate", "quaternion_unnormalised")
    assert found.entry().value == pytest.approx(1.05, abs=1e-4)


def test_a_norm_has_a_doctor_of_its_own(tmp_path: Path) -> None:
    """Of a norm the angles say nothing: a factor is named whatever else is wrong, and norms that differ are unknown."""
    path = injected(tmp_path, "b_copter_acro", "quaternion_conjugate", "quaternion_unnormalised:1.05", from_s=20.0)
    quaternion = window(path).quaternion
    found = told(diagnose_norm(quaternion))
    assert (found.causes, found.confidence, found.side) == (("quaternion_unnormalised",), "certain", 31)
    assert found.values[0][0] == pytest.approx(1.05, abs=1e-4)
    factor = np.random.default_rng(4).uniform(0.9, 1.1, (len(quaternion), 1))
    found = told(diagnose_norm(replace(quaternion, q_nb=quaternion.q_nb * factor)))
    assert (found.causes, found.confidence, found.candidates) == (("unknown",), "unknown", ())
    assert diagnose_norm(window(SITL / "b_copter_acro.tlog").quaternion) is None


def test_an_untold_trim_is_no_part_of_a_norm(tmp_path: Path) -> None:
    """A copter with 5° of AHRS_TRIM that nobody told, and quaternions of norm 0.95: only the norm is named."""
    path = untold(tmp_path, "j_ahrs_trim5", "quaternion_unnormalised:0.95")
    (vehicle,) = gcs_bridge.check(path).to_dict()["files"][0]["vehicles"]
    (alarm,) = (one for one in vehicle["alarms"] if one["severity"] == "alarm")
    assert alarm["diagnosis"]["causes"] == ["quaternion_unnormalised"]


def test_order_of_arrival_repetitions_and_gaps_change_nothing(tmp_path: Path) -> None:
    """Samples in any order, some twice and some that are no numbers: the same diagnosis, bit for bit."""
    of = window(injected(tmp_path, "b_copter_acro", "yaw_offset:12", from_s=20.0), from_s=196.6, to_s=210.0)
    mixed = np.random.default_rng(1).permutation(len(of.euler))
    euler = AttitudeSamples.joined([of.euler[mixed], of.euler[::7], of.euler[:50]])
    assert euler.rpy_rad is not None
    euler.rpy_rad[-50:] = math.nan  # rows of their own: the first of equal times that is a number counts
    assert diagnose(replace(of, euler=euler)) == diagnose(of)


def test_the_entry_is_the_contract(tmp_path: Path) -> None:
    """The keys of the report, their types, and the fix as a sentence with the value in it."""
    of = window(injected(tmp_path, "b_copter_acro", "yaw_offset:12.5", from_s=20.0), from_s=196.6)
    entry = plain(told(diagnose(of)).entry())
    assert entry["value"] == pytest.approx(12.5, abs=0.01)
    assert entry["residual"] < 0.01 < 1 < entry["next_best"]
    del entry["value"], entry["residual"], entry["next_best"]
    assert entry == {
        "cause": "yaw_offset",
        "causes": ["yaw_offset"],
        "confidence": "certain",
        "distinguishable": True,
        "candidates": ["yaw_offset"],
        "side": None,
        "unit": "deg",
        "fix": "Take 12.5° about down off the quaternion: both messages must use the same north.",
    }


def test_a_mount_offset_has_three_numbers(tmp_path: Path) -> None:
    """Its value is a list, and the fix names it."""
    of = window(injected(tmp_path, "b_copter_acro", "mount_offset:0,4,0", from_s=20.0), from_s=196.6)
    entry = told(diagnose(of)).entry()
    assert isinstance(entry.value, tuple)
    np.testing.assert_allclose(entry.value, (0, 4, 0), atol=0.05)
    assert "(0, 4.0, 0)°" in entry.fix
