"""`gcs-bridge attitude` as people type it: every form and frame against SciPy, mistakes by hand, and bad input."""

import itertools
import json
import math
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gcs_bridge.cli import main
from gcs_bridge.diagnosis.causes import CAUSES
from tests.helpers.everyday import one_in

Array = NDArray[np.float64]
Page = dict[str, Any]

# Lines are the axes of the other frame in NED, or in FRD: east, north, up; forward, left, up; right, forward, up.
ENU = RFU = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
FLU = NWU = np.diag([1.0, -1, -1])
SAME = np.eye(3)
FRAMES = {"ned_frd": (SAME, SAME), "enu_flu": (ENU, FLU), "enu_rfu": (ENU, RFU)}
INTRINSIC = ["".join(s) for s in itertools.product("XYZ", repeat=3) if s[0] != s[1] != s[2]]
SEQUENCES = [*INTRINSIC, *map(str.lower, INTRINSIC)]
G = 9.80665


@pytest.fixture
def typed(capsys: pytest.CaptureFixture[str]) -> Any:
    """Types a command's arguments; the page as JSON, or as text with `text`."""

    def type_(line: str, *, text: bool = False) -> Any:
        assert main(["attitude", *line.split(" "), *([] if text else ["--format", "json"])]) == 0
        shown = capsys.readouterr()
        assert shown.err == ""
        return shown.out if text else json.loads(shown.out)

    return type_


def digits(numbers: Any) -> str:
    return " ".join(f"{number:.17g}" for number in np.ravel(numbers))


def wxyz(rotation: Rotation) -> Array:
    q: Array = rotation.as_quat()[[3, 0, 1, 2]]
    return q


def close(seen: Any, expected: Any, tolerance: float = 1e-9) -> None:
    """Equal within rounding, by default of degrees after some twenty operations."""
    np.testing.assert_allclose(seen, expected, rtol=0, atol=tolerance)


def same_angles(seen_deg: Any, expected_deg: Any, tolerance: float = 1e-9) -> None:
    """Equal, whole turns aside."""
    close((np.subtract(seen_deg, expected_deg) + 180.0) % 360.0 - 180.0, 0.0, tolerance)


def near_miss(page: Page, cause: str, *, reverse: bool = False) -> Page:
    (row,) = [row for row in page["near_misses"] if (row["cause"], row["reverse"]) == (cause, reverse)]
    return dict(row)


# --- forms and frames ------------------------------------------------------------------------------------------------

ANYWHERE = Rotation.from_rotvec([[0.3, -0.4, 1.9], [-2.0, 1.1, 0.7], [0.05, 0.02, -0.4]])


def written(rotation: Rotation, form: str) -> str:
    """A rotation as SciPy says it in that form."""
    kind, _, unit = form.rpartition("-")
    scale = 180.0 / math.pi if unit == "deg" else 1.0
    if kind == "axis-angle":
        v = rotation.as_rotvec()
        return f"--{form} {digits([*(3.0 * v / np.linalg.norm(v)), scale * np.linalg.norm(v)])}"
    if kind == "euler":
        return f"--{form} YZY {digits(scale * rotation.as_euler('YZY'))}"
    numbers = {
        "quaternion": -wxyz(rotation),
        "quaternion-xyzw": rotation.as_quat(),
        "matrix": rotation.as_matrix(),
        "rotvec-deg": scale * rotation.as_rotvec(),
        "rotvec-rad": rotation.as_rotvec(),
        "rotvec": rotation.as_rotvec(),
    }
    return f"--{form} {digits(numbers[form])}"


@pytest.mark.parametrize("frame", one_in(3, FRAMES))
@pytest.mark.parametrize(
    "form",
    one_in(
        4,
        [
            *("quaternion", "quaternion-xyzw", "matrix", "rotvec-deg", "rotvec", "rotvec-rad"),
            *("axis-angle-deg", "axis-angle-rad", "euler-deg", "euler-rad"),
        ],
    ),
)
def test_every_form_in_every_frame_is_scipys(form: str, frame: str, typed: Any) -> None:
    """What SciPy writes of a body in a world is read as that attitude, and shown as SciPy has it in all frames."""
    world, body = FRAMES[frame]
    for R_ned_frd in ANYWHERE:
        given = Rotation.from_matrix(world @ R_ned_frd.as_matrix() @ body.T)
        page = typed(f"{written(given, form)} --frame {frame}")
        for name, (world_to, body_to) in FRAMES.items():
            expected = Rotation.from_matrix(world_to @ R_ned_frd.as_matrix() @ body_to.T)
            shown = page["frames"][name]
            q = wxyz(expected) * np.sign(wxyz(expected)[0])
            close(shown[f"q_{name}_wxyz"], q, 1e-14)
            close(shown[f"q_{name}_xyzw"], q[[1, 2, 3, 0]], 1e-14)
            close(shown[f"q_{name}_wxyz_negated"], -q, 1e-14)
            close(shown[f"R_{name}"], expected.as_matrix(), 1e-14)
            close(shown[f"rotvec_{name}_rad"], expected.as_rotvec(), 1e-13)
            close(shown[f"rotvec_{name}_deg"], np.degrees(expected.as_rotvec()))
            close(np.array(shown[f"axis_{name}"]) * shown[f"angle_{name}_deg"], np.degrees(expected.as_rotvec()))
            angles = {sequence: expected.as_euler(sequence, degrees=True) for sequence in SEQUENCES}
            assert shown[f"euler_{name}_deg"].keys() == angles.keys()
            same_angles([shown[f"euler_{name}_deg"][sequence] for sequence in angles], list(angles.values()))


@pytest.mark.parametrize(
    ("line", "expected_deg"),
    one_in(
        3,
        [
            # Rolled right by 10°, nose up by 20°, heading 30°: in ROS the nose up is negative and 30° of heading 60°.
            ("--rpy-deg 10 20 30", (10, 20, 30)),
            ("--rpy-rad 0.17453292519943295 0.3490658503988659 0.5235987755982988", (10, 20, 30)),
            ("--rpy-deg 10 -20 60 --frame enu_flu", (10, 20, 30)),
            ("--rpy-deg 10 20 30 --frame enu_rfu", (10, 20, 30)),
            ("--rpy-deg 10 20 -170 --frame enu_flu", (10, -20, -100)),
            ("--euler-deg ZYX 30 20 10", (10, 20, 30)),
            ("--euler-deg xyz 10 20 30", (10, 20, 30)),
        ],
        swept=False,
    ),
)
def test_roll_pitch_yaw_by_hand(line: str, expected_deg: tuple[float, ...], typed: Any) -> None:
    """The angles mean in each frame what its users mean, and one page shows all three readings."""
    roll, pitch, yaw = expected_deg
    frames = typed(line)["frames"]
    same_angles(frames["ned_frd"]["rpy_ned_frd_deg"], (roll, pitch, yaw))
    same_angles(np.degrees(frames["ned_frd"]["rpy_ned_frd_rad"]), (roll, pitch, yaw))
    same_angles(frames["enu_flu"]["rpy_enu_flu_deg"], (roll, -pitch, 90 - yaw))
    same_angles(frames["enu_rfu"]["rpy_enu_rfu_deg"], (roll, pitch, yaw))


def test_the_matrix_is_the_product_of_its_turns(typed: Any) -> None:
    """In each frame the three elementary turns, multiplied as written, are the matrix; level and north by hand."""
    page = typed("--rpy-deg 10 20 30")
    for name in FRAMES:
        first, second, third = map(np.array, page["frames"][name][f"R_{name}_factors"].values())
        close(first @ second @ third, page["frames"][name][f"R_{name}"], 1e-15)
    factors = page["frames"]["ned_frd"]["R_ned_frd_factors"]
    assert list(factors) == ["Rz(yaw)", "Ry(pitch)", "Rx(roll)"]
    c, s = math.cos(math.radians(30)), math.sin(math.radians(30))
    close(factors["Rz(yaw)"], [[c, -s, 0], [s, c, 0], [0, 0, 1]], 1e-15)


# --- what it means ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rpy_deg", "nose", "right_wing", "belly"),
    one_in(
        3,
        [
            ("0 0 0", "north, level", "east, level", "straight down"),
            ("0 0 90", "east, level", "south, level", "straight down"),
            ("0 90 0", "straight up", "east, level", "north, level"),
            ("90 0 0", "north, level", "straight down", "west, level"),
            (
                "0 10 30",
                "30.0° right of north, 10.0° up",
                "30.0° right of east, level",
                "30.0° right of north, 80.0° down",
            ),
            ("180 0 -10", "10.0° left of north, level", "10.0° left of west, level", "straight up"),
        ],
        swept=False,
    ),
)
def test_where_the_body_points(rpy_deg: str, nose: str, right_wing: str, belly: str, typed: Any) -> None:
    """Nose, right wing and belly in words, as one sees them from outside."""
    assert typed(f"--rpy-deg {rpy_deg}")["pointing"] == {"nose": nose, "right_wing": right_wing, "belly": belly}


def test_axes_of_the_body_in_both_worlds(typed: Any) -> None:
    """Heading north-east, climbing by 60°: the nose, and down in each body, by hand."""
    page = typed("--rpy-deg 0 60 45")
    n, up = 0.5 * math.sqrt(0.5), 0.5 * math.sqrt(3)
    close(page["frames"]["ned_frd"]["nose_ned"], [n, n, -up], 1e-15)
    close(page["frames"]["enu_flu"]["nose_enu"], [n, n, up], 1e-15)
    close(page["frames"]["enu_rfu"]["right_wing_enu"], [math.sqrt(0.5), -math.sqrt(0.5), 0], 1e-15)
    close(page["frames"]["ned_frd"]["down_frd"], [-up, 0, 0.5], 1e-15)
    close(page["frames"]["enu_flu"]["down_flu"], [-up, 0, -0.5], 1e-15)
    close(page["frames"]["enu_rfu"]["down_rfu"], [0, -up, -0.5], 1e-15)
    close(page["heading_deg"], 45)
    close(page["tilt_deg"], 60)
    close(page["hover_thrust_n_per_kg"], 2 * G, 1e-12)  # m g / cos 60°


def test_an_accelerometer_at_rest(typed: Any) -> None:
    """Level it shows the support: -g where z points down, +g where it points up; on the right wing, g to the left."""
    level = typed("--rpy-deg 0 0 77")["frames"]
    close(level["ned_frd"]["accelerometer_at_rest_frd_m_s2"], [0, 0, -G], 1e-14)
    close(level["enu_flu"]["accelerometer_at_rest_flu_m_s2"], [0, 0, G], 1e-14)
    close(level["enu_rfu"]["accelerometer_at_rest_rfu_m_s2"], [0, 0, G], 1e-14)
    rolled = typed("--rpy-deg 90 0 0")["frames"]
    close(rolled["ned_frd"]["accelerometer_at_rest_frd_m_s2"], [0, -G, 0], 1e-14)
    close(rolled["enu_flu"]["accelerometer_at_rest_flu_m_s2"], [0, G, 0], 1e-14)
    close(rolled["enu_rfu"]["accelerometer_at_rest_rfu_m_s2"], [-G, 0, 0], 1e-14)


@pytest.mark.parametrize(
    ("yaw", "heading"),
    one_in(
        2, [("-90", 270.0), ("359.9999999999999999", 0.0), ("-1e-14", 0.0), ("720", 0.0), ("-0.01", 0.0)], swept=False
    ),
)
def test_the_heading_is_below_360(yaw: str, heading: float, typed: Any) -> None:
    """A hair left of north is shown as 0.0, never as 360.0."""
    assert 0 <= typed(f"--rpy-deg 0 0 {yaw}")["heading_deg"] < 360
    assert f" {heading:.1f}° clockwise from north" in typed(f"--rpy-deg 0 0 {yaw}", text=True)


@pytest.mark.parametrize(
    ("rpy_deg", "thrust"),
    [
        ("0 0 0", "9.81 N per kg"),
        ("60 0 0", "19.61 N per kg"),
        ("90 0 0", "impossible: the rotors push sideways"),
        ("180 0 0", "impossible: upside down"),
    ],
)
def test_the_thrust_to_hover(rpy_deg: str, thrust: str, typed: Any) -> None:
    """m g / cos tilt, where there is one."""
    assert f"thrust to hover           {thrust}" in typed(f"--rpy-deg {rpy_deg}", text=True)


def test_gimbal_lock_is_told(typed: Any) -> None:
    """Nose straight up only yaw - roll is left, in ROS yaw + roll; each sequence at its own pole is marked."""
    page = typed("--rpy-deg 20 90 30")
    assert page["frames"]["ned_frd"]["rpy_ned_frd_near_gimbal_lock"]
    close(page["frames"]["ned_frd"]["rpy_ned_frd_deg"], [0, 90, 10])
    assert page["frames"]["ned_frd"]["euler_ned_frd_near_gimbal_lock"] == ["ZYX", "xyz"]
    text = typed("--rpy-deg 20 90 30", text=True)
    assert text.count("only yaw - roll = 10.0000 deg") == 2
    assert text.count("only yaw + roll = 80.0000 deg") == 1
    assert "\n  ZYX* " in text
    assert "xyz* " in text
    down = typed("--rpy-deg 20 -90 30", text=True)
    assert down.count("only yaw + roll = 50.0000 deg") == 2
    assert down.count("only yaw - roll = 40.0000 deg") == 1
    assert "only yaw - roll = 10.0000 deg" in typed("--rpy-deg 20 89.95 30", text=True)
    level = typed("--rpy-deg 0 0 0")["frames"]["ned_frd"]
    assert not level["rpy_ned_frd_near_gimbal_lock"]
    assert sorted(level["euler_ned_frd_near_gimbal_lock"]) == sorted(
        turns for s in INTRINSIC if s[0] == s[2] for turns in (s, s.lower())
    )
    assert "GIMBAL LOCK" not in typed("--rpy-deg 0 89.9 0", text=True)


# --- in motion -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "rpy_rate", "after"),
    one_in(
        3,
        [
            ("--rpy-deg 0 0 30 --rates-deg 0 0 10", (0, 0, 10), (0, 0, 40)),
            # With the right wing down, a turn about the body's y is a turn to the right.
            ("--rpy-deg 90 0 30 --rates-deg 0 10 0", (0, 0, 10), (90, 0, 40)),
            # The same two in the axes of FLU and of RFU.
            ("--rpy-deg 0 0 60 --frame enu_flu --rates-deg 0 0 -10", (0, 0, 10), (0, 0, 40)),
            ("--rpy-deg 90 0 30 --frame enu_rfu --rates-deg 10 0 0", (0, 0, 10), (90, 0, 40)),
            ("--rpy-deg 0 0 0 --frame enu_rfu --rates-deg -5 0 0", (0, -5, 0), (0, -5, 0)),
        ],
        swept=False,
    ),
)
def test_body_rates_by_hand(line: str, rpy_rate: tuple[float, ...], after: tuple[float, ...], typed: Any) -> None:
    """Rates in the body's own axes become those of the angles, and the attitude a second later."""
    rates = typed(line)["rates"]
    close(rates["rpy_rate_ned_frd_deg_s"], rpy_rate)
    close(rates["rpy_rate_enu_rfu_deg_s"], rpy_rate)
    close(rates["rpy_rate_enu_flu_deg_s"], np.array(rpy_rate) * [1, -1, -1])
    same_angles(rates["rpy_after_1_s_ned_frd_deg"], after)
    same_angles(rates["rpy_after_1_s_enu_flu_deg"], [after[0], -after[1], 90 - after[2]])


@pytest.mark.parametrize("frame", one_in(3, FRAMES, swept=False))
def test_rates_are_what_a_small_step_makes(frame: str, typed: Any) -> None:
    """In every frame, rates of angles and quaternion are those of SciPy's turn by a millionth of a second."""
    w_deg_s = np.array([30.0, -50.0, 20.0])
    now = Rotation.from_euler("ZYX", [30, 20, 10], degrees=True)
    dt_s = 1e-6
    given = typed(f"--quaternion {digits(wxyz(now))} --frame {frame} --rates-deg {digits(w_deg_s)}")
    then = now * Rotation.from_rotvec(w_deg_s * dt_s, degrees=True)
    after = typed(f"--quaternion {digits(wxyz(then))} --frame {frame}")["frames"][frame]
    before, rates = given["frames"][frame], given["rates"]
    for form, rate in (
        (f"q_{frame}_wxyz", f"q_rate_{frame}_wxyz_per_s"),
        (f"rpy_{frame}_deg", f"rpy_rate_{frame}_deg_s"),
    ):
        close((np.array(after[form]) - before[form]) / dt_s, rates[rate], 1e-3)
    world, body = frame.split("_")
    close(rates[f"w_{body}_deg_s"], w_deg_s)
    close(rates[f"w_{world}_deg_s"], now.apply(w_deg_s))
    later = now * Rotation.from_rotvec(w_deg_s, degrees=True)
    close(rates[f"q_after_1_s_{frame}_wxyz"], wxyz(later) * np.sign(wxyz(later)[0]), 1e-14)


def test_rates_of_angles_at_the_pole_are_undefined(typed: Any) -> None:
    """Nose straight up, the angles have no rates; the quaternion has."""
    rates = typed("--rpy-deg 0 90 0 --rates-deg 1 2 3")["rates"]
    assert rates["rpy_rate_ned_frd_deg_s"] is None
    assert rates["q_rate_ned_frd_wxyz_per_s"] is not None
    assert "roll pitch yaw rate, deg/s     undefined" in typed("--rpy-deg 0 90 0 --rates-deg 1 2 3", text=True)


def test_an_accelerometers_reading(typed: Any) -> None:
    """Heading east, level, 2 m/s² ahead: the acceleration is east; at rest such a reading means a tilt of 11.5°."""
    for line in (
        "--rpy-deg 0 0 90 --accelerometer 2 0 -9.80665",
        "--rpy-deg 0 0 0 --frame enu_flu --accelerometer 2 0 9.80665",
    ):
        told = typed(line)["accelerometer"]
        close(told["f_frd_m_s2"], [2, 0, -G], 1e-14)
        close(told["f_rfu_m_s2"], [0, 2, G], 1e-14)
        close(told["a_ned_m_s2"], [0, 2, 0], 1e-14)
        close(told["a_enu_m_s2"], [2, 0, 0], 1e-14)
        close(told["a_level_forward_right_down_m_s2"], [2, 0, 0], 1e-14)
        close(told["tilt_error_if_at_rest_deg"], math.degrees(math.atan2(2, G)))


# --- near-misses -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("cause", "rpy_deg", "angle_deg", "heading_deg"),
    one_in(
        3,
        [
            # Level, heading 30°: q = [cos 15°, 0, 0, sin 15°].
            ("quaternion_conjugate", (0, 0, -30), 60, -60),
            ("enu_flu", (0, 0, 60), 30, 30),
            ("yaw_sign", (0, 0, -30), 60, -60),
            ("enu_rfu", (0, 0, -30), 60, -60),
            ("nwu_flu", (0, 0, -30), 60, -60),
            # [0, 0, sin 15°, cos 15°]: half a turn about an axis in the plane of pitch and yaw, 15° from straight down.
            ("quaternion_xyzw", (30, 0, 180), None, None),
            ("body_flu", (180, 0, 30), 180, None),
            (
                "euler_degrees",
                (0, 0, 30 * 180 / math.pi),
                (30 * 180 / math.pi - 30) % 360,
                (30 * 180 / math.pi - 30) % 360,
            ),
        ],
        swept=False,
    ),
)
def test_a_near_miss_by_hand(
    cause: str, rpy_deg: tuple[float, ...], angle_deg: float | None, heading_deg: float | None, typed: Any
) -> None:
    """What a level vehicle with heading 30° would seem to be, and how far off that is."""
    row = near_miss(typed("--rpy-deg 0 0 30"), cause)
    same_angles(row["rpy_ned_frd_deg"], rpy_deg)
    assert row["distinguishable"]
    if angle_deg is not None:
        close(row["angle_deg"], min(angle_deg, 360 - angle_deg))
    if heading_deg is not None:
        close(row["heading_deg"], (heading_deg + 180) % 360 - 180)
        close(row["tilt_deg"], 0)


def test_degrees_are_shown_as_they_would_be_read(typed: Any) -> None:
    """30° sent as the number 30 and read as radians is shown as 1718.873°, not brought into one turn."""
    close(near_miss(typed("--rpy-deg 0 0 30"), "euler_degrees")["rpy_ned_frd_deg"], [0, 0, 30 * 180 / math.pi])


def rotation_of(rpy_deg: Any) -> Rotation:
    return Rotation.from_euler("ZYX", np.asarray(rpy_deg)[::-1], degrees=True)


@pytest.mark.parametrize("R", list(ANYWHERE))
def test_every_near_miss_is_scipys(R: Rotation, typed: Any) -> None:
    """Each mistake made by SciPy's means, and its distance from the truth; every cause without a value is there."""
    page = typed(f"--matrix {digits(R.as_matrix())}")
    x, y, z, w = R.as_quat()
    yaw, pitch, roll = R.as_euler("ZYX")

    def turned(world: Array, body: Array) -> Rotation:
        return Rotation.from_matrix(world @ R.as_matrix() @ body.T)

    def angles(*rpy: float) -> Rotation:
        return Rotation.from_euler("ZYX", rpy[::-1])

    degrees = np.degrees([roll, pitch, yaw])
    expected = {
        ("quaternion_xyzw", False): Rotation.from_quat([y, z, w, x]),  # slots w, x, y, z hold x, y, z, w
        ("quaternion_xyzw", True): Rotation.from_quat([w, x, y, z]),  # SciPy itself is given w, x, y, z
        ("quaternion_conjugate", False): R.inv(),
        ("world_enu", False): turned(ENU, SAME),
        ("body_flu", False): turned(SAME, FLU),
        ("enu_flu", False): turned(ENU, FLU),
        ("enu_rfu", False): turned(ENU, RFU),
        ("nwu_flu", False): turned(NWU, FLU),
        ("world_nwu", False): turned(NWU, SAME),
        ("body_rfu", False): turned(SAME, RFU),
        ("euler_xyz_order", False): angles(*R.as_euler("XYZ")),
        ("euler_xyz_order", True): Rotation.from_euler("XYZ", [roll, pitch, yaw]),
        ("euler_degrees", False): angles(*degrees),
        ("euler_degrees", True): angles(*np.radians([roll, pitch, yaw])),
        ("roll_pitch_swapped", False): angles(pitch, roll, yaw),
        ("roll_sign", False): angles(-roll, pitch, yaw),
        ("pitch_sign", False): angles(roll, -pitch, yaw),
        ("yaw_sign", False): angles(roll, pitch, -yaw),
    }
    rows = {(row["cause"], row["reverse"]): row for row in page["near_misses"]}
    assert rows.keys() == expected.keys()
    assert {name for name, _ in rows} == {
        cause.name for cause in CAUSES.values() if not cause.parameter.count and cause.acts_on in ("quaternion", "rpy")
    }
    down = np.array([0.0, 0.0, 1.0])
    for key, row in rows.items():
        seen = rotation_of(row["rpy_ned_frd_deg"])
        close((seen.inv() * expected[key]).magnitude(), 0, 1e-11)
        close(row["angle_deg"], np.degrees((R.inv() * seen).magnitude()), 1e-9)
        cosine = R.inv().apply(down) @ seen.inv().apply(down)
        close(row["tilt_deg"], np.degrees(np.arccos(np.clip(cosine, -1, 1))), 1e-5)  # acos: half of the digits
        assert row["fix"] == CAUSES[key[0]].fix


def test_what_cannot_be_told_is_said(typed: Any) -> None:
    """Level and north, no sign, swap or order of angles shows; nose up by 20°, roll's sign alone does not."""
    level = typed("--rpy-deg 0 0 0")
    hidden = {row["cause"] for row in level["near_misses"] if not row["distinguishable"]}
    assert hidden == {
        "quaternion_conjugate",
        "euler_xyz_order",
        "euler_degrees",
        "roll_pitch_swapped",
        "roll_sign",
        "pitch_sign",
        "yaw_sign",
        "enu_rfu",
        "nwu_flu",
    }
    text = typed("--rpy-deg 0 0 0", text=True)
    assert text.count("cannot be told at this attitude") == sum(not r["distinguishable"] for r in level["near_misses"])
    climbing = typed("--rpy-deg 0 20 30")
    assert not near_miss(climbing, "roll_sign")["distinguishable"]
    assert near_miss(climbing, "pitch_sign")["distinguishable"]


def test_a_hundredth_of_a_degree_is_the_least_that_is_told(typed: Any) -> None:
    """A sign turned at 0.004° of roll is off by 0.008°, at 0.006° by 0.012°."""
    assert not near_miss(typed("--rpy-deg 0.004 20 30"), "roll_sign")["distinguishable"]
    assert near_miss(typed("--rpy-deg 0.006 20 30"), "roll_sign")["distinguishable"]


def test_heading_is_undefined_upside_down(typed: Any) -> None:
    """Half a turn of tilt leaves no heading: null in JSON, and a word in the text."""
    assert near_miss(typed("--rpy-deg 0 0 30"), "world_nwu")["heading_deg"] is None
    (line,) = [s for s in typed("--rpy-deg 0 0 30", text=True).splitlines() if s.startswith("  world_nwu ")]
    assert line.endswith("180.00 undefined")


def test_fixes_are_told_when_asked(typed: Any) -> None:
    """-v puts under each mistake what to do about it."""
    fix = "    Convert from ENU and FLU to NED and FRD before sending."
    assert fix not in typed("--rpy-deg 0 0 30", text=True).splitlines()
    verbose = typed("--rpy-deg 0 0 30 -v", text=True).splitlines()
    assert verbose[verbose.index(fix) - 1].startswith("  enu_flu ")


# --- what is typed ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "arguments",
    one_in(
        3,
        [
            ["--quaternion", "0.5", "-0.5", "0.5", "-0.5"],
            ["0.5", "-0.5", "0.5", "-0.5", "--quaternion"],
            ["--quaternion", "-.5", "+.5", "-5e-1", "500e-3"],
            ["--quaternion", "[0.5, -0.5, 0.5, -0.5]"],
            ["--quaternion", "(0.5,", "-0.5,", "0.5,", "-0.5)"],
            ["--quaternion", "0.5,-0.5,0.5,-0.5"],
            ["--quaternion", "np.array([ 0.5, -0.5,  0.5, -0.5])"],
            ["--quaternion", "{0.5,−0.5,0.5,−0.5};"],
            ["--quaternion", "--", "-0.5", "0.5", "-0.5", "0.5"],
            ["--matrix", "[[0, 0, 1],\n [-1, 0, 0],\n [0, -1, 0]]"],
            ["0", "0", "1", "-1", "0", "0", "0", "-1", "0"],
        ],
        swept=False,
    ),
)
def test_numbers_as_they_are_pasted(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Negative numbers need no care, and brackets, commas and code around numbers may stay."""
    assert main(["attitude", "--format", "json", *arguments]) == 0
    page = json.loads(capsys.readouterr().out)
    close(page["frames"]["ned_frd"]["q_ned_frd_wxyz"], [0.5, -0.5, 0.5, -0.5], 1e-15)


@pytest.mark.parametrize(
    ("line", "note", "off"),
    one_in(
        3,
        [
            ("--quaternion 1 0 0 0", None, 0.0),
            ("--quaternion 1.3 0 0 0", "the quaternion's norm is 1.3: it is divided out", 0.3),
            ("--quaternion-xyzw 0 0 0 0.7", "the quaternion's norm is 0.7: it is divided out", 0.3),
            ("--quaternion 0.70710678 0 0 0.70710678", None, 0.0),
            ("--matrix 1 0 0 0 1 0 0 0 1", None, 0.0),
            (
                "--matrix 1.02 0 0 0 1 0 0 0 1",
                "a unit vector up to 0.02 off a rotation: the nearest one is shown",
                0.02,
            ),
            ("--rpy-rad 0 0 30", "more than a whole turn: are these degrees?", None),
            ("--rpy-rad 0 0 6.2", None, None),
            ("--rpy-deg 0 0 30", None, None),
            ("--rotvec -30 0 0", "are these degrees?", None),
            ("--axis-angle-rad 30 0 0 1", None, None),
            ("--axis-angle-rad 1 0 0 30", "are these degrees?", None),
            ("--euler-rad ZYX 30 0 0", "are these degrees?", None),
        ],
        swept=False,
    ),
)
def test_what_was_mended_or_looks_wrong_is_noted(line: str, note: str | None, off: float | None, typed: Any) -> None:
    """A norm or matrix that is off is told with its size, as are radians beyond a turn; nothing else is."""
    given = typed(line)["input"]
    assert len(given["notes"]) == (note is not None)
    assert note is None or note in given["notes"][0]
    assert given["off"] == (None if off is None else pytest.approx(off, abs=2e-8))
    assert note is None or f"note                      {given['notes'][0]}\n" in typed(line, text=True)


def test_a_drifted_matrix_is_brought_to_the_nearest_rotation(typed: Any) -> None:
    """Polar decomposition by SciPy's hand: the rotation of a matrix stretched along its own axes is itself."""
    R = ANYWHERE[0].as_matrix()
    page = typed(f"--matrix {digits(R @ np.diag([1.05, 0.97, 1.0]))}")
    close(page["frames"]["ned_frd"]["R_ned_frd"], R, 1e-14)
    assert page["input"]["off"] == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("", "no attitude is given"),
        ("--rpy-deg", "--rpy-deg ROLL PITCH YAW takes 3 numbers: 0 given"),
        ("--rpy-deg 1 2", "takes 3 numbers: 2 given"),
        ("--rpy-deg 1 2 3 4", "takes 3 numbers: 4 given"),
        ("--matrix 1 0 0 0", "takes 9 numbers: 4 given"),
        ("--euler-deg 1 2 3", "--euler-deg SEQUENCE A B C takes 3 numbers: 2 given"),
        ("1 2", "2 numbers are no attitude"),
        ("1 2 3", "3 numbers may mean several things; say which: --rpy-deg ROLL PITCH YAW, --rpy-rad"),
        ("1 0 0 0", "say which: --quaternion W X Y Z, --quaternion-xyzw X Y Z W, --axis-angle-deg"),
        ("--quaternion --rpy-deg 1 2 3", "--rpy-deg and --quaternion cannot both be meant"),
        ("--euler-deg ZYX --euler-rad ZYX 1 2 3", "--euler-deg and --euler-rad cannot both be meant"),
        ("--rpy-deg 1 2 three", "'three' is no number"),
        ("--rpy-deg 1 2 nan", "nan is no part of an attitude"),
        ("--rpy-deg 1 2 -inf", "-inf is no part of an attitude"),
        ("--rpy-deg 1 2 1e400", "1e400 is no part of an attitude"),
        ("--rpy-deg 1 2 1e9", "must be finite, and below 1e+09"),
        ("--quaternion 0 0 0 0", "norm is 0, and 1 is right"),
        ("--quaternion 1 1 1 0", "norm is 1.73205, and 1 is right"),
        ("--quaternion 0.4 0 0 0", "norm is 0.4, and 1 is right"),
        ("--quaternion-xyzw 10 20 30 40", "norm is 54.7723, and 1 is right"),
        ("--matrix 1 0 0 0 1 0 0 0 -1", "a reflection (determinant -1)"),
        ("--matrix 0 1 0 1 0 0 0 0 1", "a reflection (determinant -1)"),
        ("--matrix 0 0 0 0 0 0 0 0 0", "no rotation, nor near one (determinant 0"),
        ("--matrix 1 2 3 4 5 6 7 8 10", "no rotation, nor near one (determinant -3"),
        ("--matrix 1 0 0 0 1 0 0 0 1.6", "no rotation, nor near one (determinant 1.6"),
        ("--axis-angle-deg 0 0 0 90", "the axis is zero"),
        ("--euler-deg ZYQ 1 2 3", "unknown Euler sequence 'ZYQ'; did you mean 'ZYZ' (intrinsic) or 'zyz' (extrinsic)?"),
        ("--euler-deg zYx 1 2 3", "did you mean 'ZYX' (intrinsic) or 'zyx' (extrinsic)?"),
        ("--euler-deg 321 1 2 3", "did you mean 'ZYX' (intrinsic)"),
        ("--euler-deg 313 1 2 3", "did you mean 'ZXZ' (intrinsic)"),
        ("--euler-deg ZZX 1 2 3", "unknown Euler sequence 'ZZX'"),
        ("--euler-deg roll 1 2 3", "unknown Euler sequence 'roll'"),
        ("--quaterion 1 0 0 0", "no such option: --quaterion; did you mean --quaternion?"),
        ("--rpy-deg 1 2 3 -x", "no such option: -x"),
        ("--rpy-deg 1 2 3 --frame ros", "'ros' is not one of 'ned_frd'"),
        ("--rpy-deg 1 2 3 --format yaml", "--format"),
        ("--rpy-deg 1 2 3 --rates-deg 1 2", "--rates-deg"),
        ("--rpy-deg 1 2 3 --rates-deg 1 2 x", "'x' is no number"),
        ("--rpy-deg 1 2 3 --rates-deg 1 2 nan", "nan is no part"),
        ("--rpy-deg 1 2 3 --accelerometer 1 2 -1e300", "-1e300 is no part"),
        ("--rpy-deg 1 2 3 --accelerometer 1,2 3 4", "--accelerometer takes 3 numbers: 4 given"),
    ],
)
def test_what_is_no_attitude_is_one_line_and_2(line: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Each mistake is one line on stderr that says what would be right, nothing on stdout, and exit code 2."""
    assert main(["attitude", *line.split()]) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith("gcs-bridge: error: ")
    assert said in shown.err
    assert shown.err.count("\n") == 1


# --- the page --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("frame", FRAMES)
def test_the_text_is_plain_columns(frame: str, typed: Any) -> None:
    """At most 100 columns, no colours, no negative zero; the given frame comes first, the others after it."""
    text = typed(f"--rpy-deg 0 -179 1e-12 -v --frame {frame} --rates-deg 0 0 -1e-12 --accelerometer 0 0 -9", text=True)
    assert max(map(len, text.splitlines())) <= 100
    assert "\x1b" not in text
    assert " -0.000000000" not in text
    assert " -0.00 " not in text
    blocks = [line.split(":")[0] for line in text.splitlines() if ": body " in line]
    assert blocks == [frame, *(name for name in FRAMES if name != frame)]


def test_the_text_shows_what_the_numbers_are(typed: Any) -> None:
    """Yaw 90° level: rows that a reader finds, worked out by hand."""
    rows = [line.split() for line in typed("--rpy-deg 0 0 90", text=True).splitlines()]
    half = "0.707106781"
    zero, one = "0.000000000", "1.000000000"
    assert rows[0] == ["given", "--rpy-deg", "0", "0", "90", "--frame", "ned_frd"]
    assert ["quaternion", "w", "x", "y", "z", half, zero, zero, half] in rows
    assert ["quaternion", "x", "y", "z", "w", zero, zero, half, half] in rows
    assert ["the", "same,", "negated", f"-{half}", zero, zero, f"-{half}"] in rows
    assert ["roll,", "pitch,", "yaw,", "deg", "0.000000", "0.000000", "90.000000"] in rows
    assert ["rotation", "vector,", "deg", "0.000000", "0.000000", "90.000000"] in rows
    assert ["axis", zero, zero, one] in rows
    assert ["east", one, zero, zero] in rows  # the nose
    assert ["accelerometer,", "rest,", "m/s²", "0.000000", "0.000000", "-9.806650"] in rows
    assert ["enu_flu", "0.000", "0.000", "0.000", "90.00", "0.00", "-90.00"] in rows


def test_the_command_that_is_told_back_gives_the_same_page(typed: Any) -> None:
    """The first line is the command itself: typed again, it shows the same page."""
    page = typed("--euler-deg yxz 10.5 -20 1e-3 --frame enu_flu", text=True)
    assert typed(page.splitlines()[0].removeprefix("given").strip(), text=True) == page


def test_json_names_frames_and_units(typed: Any) -> None:
    """The schema is named, every form's key names its frame or axes, and no zero is negative."""
    page = typed("--rpy-deg 1 2 3 --rates-deg 1 2 3 --accelerometer 0 0 -9.8")
    assert page["schema"] == "gcs-bridge/attitude/1"
    for name, forms in page["frames"].items():
        world, body = name.split("_")
        assert all(name in key or key.endswith(f"_{world}") or f"_{body}" in key for key in forms), name
    assert not re.search(r"-0\.0\b", json.dumps(typed("--rpy-deg 0 0 0")))


@pytest.mark.slow
def test_the_installed_command() -> None:
    """As people run it: the page on stdout, nothing on stderr, in less than a second."""
    command = [
        str(Path(sys.executable).with_name("gcs-bridge")),
        "attitude",
        "--quaternion",
        "-0.7071",
        "0",
        "0",
        "-0.7071",
    ]
    done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", timeout=10, check=True)
    assert done.stderr == ""
    assert "nose                      east, level" in done.stdout
