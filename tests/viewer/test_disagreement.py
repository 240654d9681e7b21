"""How a disagreement is drawn: ghost, axis and arc while it lasts, the triad without the mistake once it is known."""

import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pymavlink.dialects.v20 import all as mavlink
from scipy.spatial.transform import Rotation

from gcs_bridge.contract import Diagnosis
from gcs_bridge.events import DiagnosisMade
from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from gcs_bridge.viewer import open_viewer
from gcs_bridge.viewer.disagreement import undoing
from gcs_bridge.viewer.processes import free_port
from tests.helpers import wire
from tests.helpers.everyday import one_in
from tests.helpers.paths import FIXTURES
from tests.helpers.viewer_tools import HEADLESS_PORT, Drawn, Picture, can_draw, drawn, headless

Array = NDArray[np.float64]

BODY = "/vehicle/1.1/body"
GHOST, AXIS, ARC, CORRECTED = f"{BODY}/apart/ghost", f"{BODY}/apart/axis", f"{BODY}/apart/arc", f"{BODY}/corrected"
TURN, POINTS, CLEAR = "Transform3D:quaternion", "LineStrips3D:strips", "Clear:is_recursive"
MOTION = wire.Motion(24.0)
START_BOOT_US, FAULT_US = 10_000_000, 14_000_000  # of the flight below: its beginning, and four seconds later


def flown(*faults: str, seconds: float = 24.0, until_s: float | None = None) -> bytes:
    """A made-up flight in all axes, false from its fifth second on."""
    return inject(healthy(seconds), [parse_fault(fault) for fault in faults], from_s=4.0, to_s=until_s)


@cache
def healthy(seconds: float) -> bytes:
    return wire.tlog(wire.flight(MOTION, seconds))


def truth(boot_us: NDArray[np.int64]) -> Rotation:
    return MOTION.rotation((boot_us - START_BOOT_US) / 1e6)


def apart_deg(xyzw: Array, other: Rotation) -> Array:
    found: Array = np.degrees((Rotation.from_quat(xyzw).inv() * other).magnitude())
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    "fault", one_in(2, ["yaw_offset:25", "mount_offset:0,20,5", "quaternion_xyzw", "roll_sign", "time_skew:150"])
)
def test_once_diagnosed_the_corrected_triad_falls_onto_the_right_one(fault: str, tmp_path: Path) -> None:
    """It is where the vehicle really was, to 0.1°, at each of the faulty side's samples; the ghost is by ATTITUDE."""
    recording, events = drawn(flown(fault), tmp_path / "a.rrd")
    told = [event for event in events if event["event"] == "diagnosis"]
    name = fault.partition(":")[0]
    assert told[-1]["diagnosis"]["cause"] == name
    boot_us, xyzw = recording.numbers(CORRECTED, TURN)
    known = boot_us >= 1e6 * told[-1]["boot_s"]
    assert known.sum() > 200
    assert apart_deg(xyzw, truth(boot_us))[known].max() < 0.1
    _, labels = recording.numbers(f"{CORRECTED}/name", "Points3D:labels")
    assert labels[-1].startswith(name)
    assert labels[-1].endswith("undone")
    ghost_us, ghost = recording.numbers(GHOST, TURN)
    assert len(ghost) > 100
    if name != "roll_sign":
        assert apart_deg(ghost, truth(ghost_us)).max() < 0.01
    assert ghost_us.min() == pytest.approx(FAULT_US, abs=1_000_000)


@pytest.mark.slow
def test_a_trim_stays_undone_in_the_corrected_triad(tmp_path: Path) -> None:
    """ArduPlane's 3° of pitch trim, and roll of the wrong sign in steep banks: both undone, it is the solid one."""
    turned = inject((FIXTURES / "d_plane_pitchtrim3.tlog").read_bytes(), [parse_fault("roll_sign")], from_s=6.0)
    recording, _ = drawn(turned, tmp_path / "a.rrd")
    boot_us, corrected = recording.numbers(CORRECTED, TURN)
    solid_us, solid = recording.numbers(f"{BODY}/quaternion", TURN)
    both_us = np.intersect1d(boot_us, solid_us)
    assert len(both_us) > 500
    right = Rotation.from_quat(solid[np.isin(solid_us, both_us)])
    assert apart_deg(corrected[np.isin(boot_us, both_us)], right).max() < 0.01
    assert np.abs(right.as_euler("ZYX", degrees=True)[:, 2]).max() > 45


@pytest.mark.slow
def test_two_mistakes_on_both_sides_are_undone_together(tmp_path: Path) -> None:
    """Neither side is right: the corrected triad shows what right angles would make of the quaternion as it is sent."""
    recording, events = drawn(flown("roll_sign", "quaternion_conjugate"), tmp_path / "a.rrd")
    (*_, told) = [event for event in events if event["event"] == "diagnosis"]
    assert set(told["diagnosis"]["causes"]) == {"roll_sign", "quaternion_conjugate"}
    boot_us, xyzw = recording.numbers(CORRECTED, TURN)
    known = boot_us >= 1e6 * told["boot_s"]
    assert known.sum() > 200
    assert apart_deg(xyzw, truth(boot_us).inv())[known].max() < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("fault", one_in(3, ["quaternion_conjugate", "world_offset:4,0,0", "roll_pitch_swapped"]))
def test_beside_an_untold_trim_the_mistake_is_undone(tmp_path: Path, fault: str) -> None:
    """A copter with an AHRS_TRIM that nobody tells: the corrected triad shows the quaternion as it should be."""
    trimmed = (FIXTURES / "j_ahrs_trim5.tlog").read_bytes()
    right, _ = drawn(trimmed, tmp_path / "right.rrd")
    recording, events = drawn(inject(trimmed, [parse_fault(fault)]), tmp_path / "a.rrd")
    (*_, told) = [event for event in events if event["event"] == "diagnosis"]
    assert told["diagnosis"]["causes"] == [fault.partition(":")[0], "ahrs_trim"]
    at_us, corrected = recording.numbers(CORRECTED, TURN)
    solid_us, solid = right.numbers(f"{BODY}/quaternion", TURN)
    both_us = np.intersect1d(at_us[at_us >= 1e6 * told["boot_s"]], solid_us)
    assert len(both_us) > 100
    expected = Rotation.from_quat(solid[np.isin(solid_us, both_us)])
    assert apart_deg(corrected[np.isin(at_us, both_us)], expected).max() < 0.1


@pytest.mark.slow
def test_axis_and_arc_lead_from_one_attitude_to_the_other(tmp_path: Path) -> None:
    """A quaternion turned by 25° about down: the axis is down, and the arc goes from nose to nose, on a cone about it.

    It goes from wing to wing where the nose is within 30° of down or up.
    """
    recording, _ = drawn(flown("yaw_offset:25"), tmp_path / "a.rrd")
    boot_us, ghost = recording.numbers(GHOST, TURN)
    at_us, solid = recording.numbers(f"{BODY}/quaternion", TURN)
    assert boot_us.tolist() == at_us[at_us >= FAULT_US].tolist()
    both = [Rotation.from_quat(xyzw) for xyzw in (ghost, solid[at_us >= FAULT_US])]
    steep = np.abs(both[0].apply([1, 0, 0])[:, 2]) > math.sqrt(0.75)
    assert 0 < steep.sum() < 100
    ends = [turned.apply(np.where(steep[:, None], [0, 0.95, 0], [0.95, 0, 0])) for turned in both]
    arc_us, strips = recording.numbers(ARC, POINTS)
    arcs = np.array([np.vstack(strip) for strip in strips])
    assert arc_us.tolist() == boot_us.tolist()
    assert arcs[:, 0] == pytest.approx(ends[0], abs=1e-5)
    assert arcs[:, -1] == pytest.approx(ends[1], abs=1e-5)
    assert arcs[:, :, 2] == pytest.approx(np.repeat(ends[0][:, 2:], arcs.shape[1], axis=1), abs=1e-5)
    _, labels = recording.numbers(ARC, "LineStrips3D:labels")
    assert set(labels) == {"25.0° heading"}
    _, axes = recording.numbers(AXIS, "Arrows3D:vectors")
    assert axes / np.linalg.norm(axes, axis=1)[:, None] == pytest.approx(np.tile([0, 0, 1], (len(axes), 1)), abs=1e-4)


def test_a_turn_about_the_nose_is_shown_by_the_right_wing(tmp_path: Path) -> None:
    """The nose goes nowhere when a body is rolled by 20°; its right wing goes down by 0.95 m · sin 20° = 0.325 m."""
    rolled = wire.wxyz(Rotation.from_euler("X", 20, degrees=True))
    records = []
    for i in range(100):
        at = (wire.START_US + 40_000 * i, 1000 + 40 * i)
        records += [(at[0], wire.attitude(at[1], (0, 0, 0))), (at[0], wire.attitude_quaternion(at[1], rolled))]
    recording, _ = drawn(wire.tlog(records), tmp_path / "a.rrd")
    _, strips = recording.numbers(ARC, POINTS)
    assert np.array(strips[0][0]) == pytest.approx([0, 0.95, 0], abs=1e-6)
    assert np.array(strips[0][-1]) == pytest.approx([0, 0.8927, 0.3249], abs=1e-4)
    _, labels = recording.numbers(ARC, "LineStrips3D:labels")
    assert labels[0] == "20.0° tilt, about body x (roll)"


@pytest.mark.parametrize("name", one_in(4, ["b_copter_acro", "c_copter_4hz", "j_ahrs_trim5", "a_copter_square"]))
def test_a_healthy_flight_has_no_ghost(name: str, tmp_path: Path) -> None:
    """Neither in acro, nor at 4 Hz, nor with a trim of 5° that the firmware takes off ATTITUDE."""
    recording, _ = drawn((FIXTURES / f"{name}.tlog").read_bytes(), tmp_path / "a.rrd")
    for entity, component in ((GHOST, TURN), (AXIS, "Arrows3D:vectors"), (ARC, POINTS), (CORRECTED, TURN)):
        assert recording.rows(entity, component)[1] == []


@pytest.mark.slow
def test_a_trim_is_no_ghost_once_it_is_explained(tmp_path: Path) -> None:
    """A pitch trim of 3° that was never told is known from the third pair on: what it showed until then is cleared."""
    recording, _ = drawn((FIXTURES / "d_plane_pitchtrim3.tlog").read_bytes(), tmp_path / "a.rrd")
    ghost_us, solid_us = recording.rows(GHOST, TURN)[0], recording.rows(f"{BODY}/quaternion", TURN)[0]
    assert len(ghost_us) <= 3
    assert (recording.rows(f"{BODY}/apart", CLEAR)[0] < solid_us[5]).tolist() == [True]


@pytest.mark.slow
def test_a_mistake_that_cannot_be_undone_has_no_corrected_triad(tmp_path: Path) -> None:
    """What was lost does not come back: of a frozen quaternion there is a ghost, and nothing falls onto it."""
    recording, events = drawn(flown("frozen_quaternion"), tmp_path / "a.rrd")
    assert [event for event in events if event["event"] == "diagnosis"]
    assert len(recording.rows(GHOST, TURN)[1]) > 100
    assert recording.rows(CORRECTED, TURN)[1] == []


def named(*causes: str, candidates: tuple[str, ...] = (), value: float) -> Diagnosis:
    return Diagnosis(
        cause="+".join(causes),
        causes=causes,
        confidence="probable",
        distinguishable=len(candidates) == 1,
        candidates=candidates,
        side=None,
        value=value,
        unit="deg",
        residual=0.0,
        next_best=None,
        fix="",
    )


def test_what_a_diagnosis_leaves_open_is_named_and_what_it_does_not_tell_is_not_undone() -> None:
    """Ties are named; the norm turns nothing; of two values a diagnosis tells but one."""
    found = undoing(named("yaw_offset", candidates=("yaw_offset", "yaw_sign"), value=-12.04))
    assert found is not None
    assert found.name == "yaw_offset -12.0° or yaw_sign"
    found = undoing(named("quaternion_conjugate", "quaternion_unnormalised", candidates=("one",), value=1.05))
    assert found is not None
    assert found.mistake.causes == ("quaternion_conjugate",)
    for causes in (["quaternion_unnormalised"], ["unknown"], ["time_skew", "yaw_offset"], ["frozen_euler"]):
        assert undoing(named(*causes, value=1.0)) is None


@pytest.mark.slow
def test_what_is_over_goes(tmp_path: Path) -> None:
    """Behind the fault's last pair the ghost is cleared, and the corrected triad with its alarm."""
    recording, events = drawn(flown("yaw_offset:25", until_s=14.0), tmp_path / "a.rrd")
    (over,) = [event for event in events if event["event"] == "alarm_cleared"]
    last_us = recording.rows(GHOST, TURN)[0][-1]
    assert last_us == pytest.approx(24_000_000, abs=40_001)
    assert recording.rows(f"{BODY}/apart", CLEAR)[0].tolist() == [last_us + 40_000]
    assert recording.rows(CORRECTED, CLEAR)[0].tolist() == [round(1e6 * over["boot_s"])]
    assert recording.rows(CORRECTED, TURN)[0][-1] < 1e6 * over["boot_s"]


@pytest.mark.slow
def test_of_a_shelved_alarm_nothing_is_undone(tmp_path: Path) -> None:
    """Nobody is told when it goes; so the corrected triad goes at once, and the ghost stays for what it is."""
    path = tmp_path / "a.rrd"
    with open_viewer(f"save:{path}", say=pytest.fail) as viewer:
        sink = viewer.recording("by hand")
        monitor = Monitor(observer=sink.observe)
        shelved_us = None
        sent = list(wire.records(flown("yaw_offset:25", seconds=12.0)))
        for at in range(0, len(sent), 5):
            now_us = sent[min(at + 4, len(sent) - 1)][0]
            for event in monitor.feed(b"".join(frame for _, frame in sent[at : at + 5]), now_us):
                sink.events([event])
                if isinstance(event, DiagnosisMade) and shelved_us is None:
                    shelved_us = now_us
                    sink.events(monitor.shelve(event.id, now_us, 3600.0))
        sink.finish()
    recording = Drawn(path)
    assert shelved_us is not None
    assert recording.rows(CORRECTED, CLEAR, "utc")[0].tolist() == [shelved_us]
    assert recording.rows(CORRECTED, TURN, "utc")[0].max() <= shelved_us
    assert recording.rows(GHOST, TURN, "utc")[0].max() > shelved_us + 5_000_000


@pytest.mark.slow
def test_nothing_stays_while_nothing_is_compared(tmp_path: Path) -> None:
    """Where the quaternion stops for 20 s the ghost goes, with NO COMPARE, and is there again with the first pair."""
    stopping = inject((FIXTURES / "k8_stream_stops.tlog").read_bytes(), [parse_fault("yaw_offset:25")])
    recording, events = drawn(stopping, tmp_path / "a.rrd")
    silent_us = [round(1e6 * event["boot_s"]) for event in events if event["event"] == "no_compare"]
    assert silent_us
    assert set(silent_us) <= set(recording.rows(f"{BODY}/apart", CLEAR)[0].tolist())
    ghost_us = recording.rows(GHOST, TURN)[0]
    begins = ghost_us[np.flatnonzero(np.diff(ghost_us, prepend=0) > 10_000_000)]
    assert len(begins) == 2
    assert set(begins.tolist()) <= set(recording.rows(f"{GHOST}/axes", POINTS)[0].tolist())


@pytest.mark.slow
def test_a_new_boot_begins_with_nothing_shown(tmp_path: Path) -> None:
    """What the boot before left open is cleared with the new boot's first message."""
    turned = inject((FIXTURES / "f_reboot.tlog").read_bytes(), [parse_fault("yaw_offset:25")], to_s=80.0)
    recording, _ = drawn(turned, tmp_path / "a.rrd")
    first_us = min(recording.rows(f"{BODY}/{name}", TURN, "boot_1")[0][0] for name in ("euler", "quaternion"))
    for entity in (f"{BODY}/apart", CORRECTED):
        assert recording.rows(entity, CLEAR, "boot_1")[0][0] <= first_us


@pytest.mark.slow
@pytest.mark.sweep
def test_however_the_bytes_are_cut_the_same_is_drawn(tmp_path: Path) -> None:
    """Ghost, arc, corrected triad and what is cleared: of a fault that comes and goes, whole and in 100 pieces."""
    data = flown("yaw_offset:25", until_s=14.0)
    (once, _), (often, _) = drawn(data, tmp_path / "once.rrd"), drawn(data, tmp_path / "often.rrd", pieces=100)
    for entity, component in (
        (GHOST, TURN),
        (f"{GHOST}/axes", POINTS),
        (AXIS, "Arrows3D:vectors"),
        (ARC, POINTS),
        (ARC, "LineStrips3D:labels"),
        (f"{BODY}/apart", CLEAR),
        (CORRECTED, TURN),
        (CORRECTED, CLEAR),
        (f"{CORRECTED}/name", "Points3D:labels"),
    ):
        for timeline in ("boot", "utc"):
            times, values = once.rows(entity, component, timeline)
            times_often, values_often = often.rows(entity, component, timeline)
            assert len(values) > 0
            assert times.tolist() == times_often.tolist()
            assert str(values) == str(values_often)


def tailsitter(offset: Any) -> bytes:
    """A vehicle that stands on its tail, of which displays are to turn the nose down by 90° after two seconds."""
    records = []
    upright = (math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0)
    for i in range(100):
        now_us, ms = wire.START_US + 40_000 * i, 1000 + 40 * i
        turn = offset if i >= 50 else (0, 0, 0, 0)
        records += [
            (now_us, wire.attitude(ms, (0.0, math.pi / 2, 0.0))),
            (now_us, wire.attitude_quaternion(ms, upright, repr_offset_q=turn)),
        ]
    return wire.tlog(records)


@pytest.mark.slow
def test_a_display_offset_turns_what_is_drawn_and_nothing_that_is_compared(tmp_path: Path) -> None:
    """Nose up, and displays turn it down by 90°: the airframe is level, the attitude nose up, and both forms agree."""
    turned = (math.sqrt(0.5), 0.0, -math.sqrt(0.5), 0.0)
    recording, _ = drawn(tailsitter(np.array(turned) * 0.98), tmp_path / "a.rrd")
    for source in ("quaternion", "euler"):
        boot_us, xyzw = recording.numbers(f"{BODY}/{source}/airframe", TURN)
        assert boot_us.tolist() == [3_000_000]
        _, attitudes = recording.numbers(f"{BODY}/{source}", TURN)
        assert attitudes == pytest.approx(np.tile([0, math.sqrt(0.5), 0, math.sqrt(0.5)], (100, 1)), abs=1e-6)
        assert np.linalg.norm(xyzw[0]) == pytest.approx(1, abs=1e-6)
        level = Rotation.from_quat(attitudes[-1]) * Rotation.from_quat(xyzw[0])
        assert level.magnitude() == pytest.approx(0, abs=1e-6)
    assert f"{BODY}/quaternion/unturned" in recording.static()  # to be switched on
    _, disagreements = recording.rows("/vehicle/1.1/disagreement", "Scalars:scalars")
    assert np.array(disagreements)[:, 0].max() < 0.01
    _, small = drawn(tailsitter(np.array(turned) * 0.4), tmp_path / "b.rrd")
    assert Drawn(tmp_path / "b.rrd").rows(f"{BODY}/quaternion/airframe", TURN)[1] == []  # of norm 0.4 it is none
    assert small


@pytest.mark.slow
def test_a_real_tailsitter_in_forward_flight_is_drawn_lying(tmp_path: Path) -> None:
    """PX4's, by pymavlink's own reading: its nose is straight down by q, and near the horizon as it is drawn."""
    path = FIXTURES / "k13b_px4_tailsitter_fw.tlog"
    messages = [mavlink.MAVLink(None).parse_char(frame) for _, frame in wire.records(path.read_bytes())]
    sent = [message for message in messages if message.get_type() == "ATTITUDE_QUATERNION"]
    holds = [
        (1000 * message.time_boot_ms, message.repr_offset_q)
        for message in sent
        if np.linalg.norm(message.repr_offset_q) >= 0.5
    ]
    recording, _ = drawn(path.read_bytes(), tmp_path / "a.rrd")
    boot_us, (turned, straight) = recording.numbers(f"{BODY}/quaternion/airframe", TURN)
    behind_us = next(1000 * m.time_boot_ms for m in sent if 1000 * m.time_boot_ms > holds[-1][0])
    assert boot_us.tolist() == [holds[0][0], behind_us]
    assert straight == pytest.approx([0, 0, 0, 1])
    cruising = [m for m in sent if holds[0][0] + 3_000_000 < 1000 * m.time_boot_ms < behind_us]
    by_q = Rotation.from_quat([[m.q2, m.q3, m.q4, m.q1] for m in cruising])
    assert by_q.apply([1, 0, 0])[:, 2].min() > 0.9  # down is positive
    assert np.abs((by_q * Rotation.from_quat(turned)).apply([1, 0, 0])[:, 2]).max() < 0.3


@pytest.mark.slow
@can_draw
def test_the_viewer_shows_it_and_hides_it_again(tmp_path: Path) -> None:
    """In rerun's own picture: the axis and the corrected triad while the fault lasts; neither behind it."""
    path = tmp_path / "a.rrd"
    drawn(flown("yaw_offset:60", until_s=14.0), path)

    def both(picture: Picture) -> list[int]:
        """Pixels of the axis, and of the corrected triad."""
        return [int((np.abs(picture - colour).max(axis=2) < 30).sum()) for colour in ((255, 240, 120), (150, 255, 110))]

    def are_seen(picture: Picture) -> None:
        assert min(both(picture)) > 30

    def are_gone(picture: Picture) -> None:
        assert max(both(picture)) < 10

    with headless(path, free_port(HEADLESS_PORT), size="2100x1350") as viewer:
        viewer.wait_for("boot", 33_000_000)
        for boot_us, what in ((22_000_000, are_seen), (33_000_000, are_gone)):
            viewer.go_to(boot_us)
            viewer.shows(what, only="3D")
        assert viewer.errors() == []
