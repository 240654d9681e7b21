"""The table of mistakes: what each one sends, seen by hand and by SciPy, and that each can be undone."""

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gcs_bridge.diagnosis.causes import CAUSES
from gcs_bridge.diagnosis.mistake import Cause, Value
from gcs_bridge.errors import UsageError
from tests.helpers.diagnosis_oracle import FRAMES
from tests.helpers.everyday import searched

Array = NDArray[np.float64]

# The contract's table: name → message, default value.
CONTRACT = {
    "quaternion_xyzw": (31, ()),
    "quaternion_conjugate": (31, ()),
    "quaternion_unnormalised": (31, (1.05,)),
    "world_enu": (31, ()),
    "body_flu": (31, ()),
    "enu_flu": (31, ()),
    "yaw_offset": (31, (12,)),
    "mount_offset": (31, (0, 4, 0)),
    "time_skew": (31, (150,)),
    "frozen_quaternion": (31, ()),
    "frozen_euler": (30, ()),
    "euler_xyz_order": (30, ()),
    "euler_degrees": (30, ()),
    "roll_pitch_swapped": (30, ()),
    "roll_sign": (30, ()),
    "pitch_sign": (30, ()),
    "yaw_sign": (30, ()),
    "euler_rates": (None, ()),  # both
    "estimator_reset": (None, ()),
    "unknown": (None, ()),
}
FURTHER = {"enu_rfu", "nwu_flu", "world_nwu", "body_rfu", "world_offset"}

with_undo = pytest.mark.parametrize("cause", [c for c in CAUSES.values() if c.undo], ids=lambda cause: cause.name)


def sent(name: str, samples: object, *value: float) -> Array:
    cause = CAUSES[name]
    assert cause.falsify is not None
    return cause.falsify(np.asarray(samples, np.float64), value or cause.parameter.default or ())


def quaternion(rotation: Rotation) -> Array:
    """[w, x, y, z], the scalar moved to the front slot by slot."""
    x, y, z, w = np.moveaxis(rotation.as_quat(), -1, 0)
    return np.stack([w, x, y, z], axis=-1)


def rotation(q: Array) -> Rotation:
    w, x, y, z = np.moveaxis(np.asarray(q), -1, 0)
    return Rotation.from_quat(np.stack([x, y, z, w], axis=-1))


def attitudes(count: int = 200) -> Rotation:
    return Rotation.random(count, rng=np.random.default_rng(1))


def same_attitude(a: Array, b: Array) -> bool:
    """Equal up to the sign, to 1e-12: some thousand roundings of a double."""
    sign = np.sign((a * b).sum(axis=-1, keepdims=True))
    return bool(np.abs(a - sign * b).max() < 1e-12)


# --- the table -----------------------------------------------------------------------------------------------------


def test_the_table_is_the_contract() -> None:
    """Every cause of the contract is there, falsifies that message, and has that default value."""
    assert set(CAUSES) == set(CONTRACT) | FURTHER
    for name, (message, default) in CONTRACT.items():
        assert (CAUSES[name].message, CAUSES[name].parameter.default) == (message, default), name
    assert all(CAUSES[name].message == 31 for name in FURTHER)
    assert CAUSES["euler_rates"].messages == (30, 31)
    assert [CAUSES[name].unit for name in ("yaw_offset", "mount_offset", "time_skew")] == ["deg", "deg", "ms"]


@pytest.mark.parametrize("cause", CAUSES.values(), ids=CAUSES)
def test_every_cause_says_what_to_do(cause: Cause) -> None:
    """The fix is one sentence, and the origin is told."""
    assert re.fullmatch(r"[A-Z][^.]*\.", cause.fix)
    assert re.fullmatch(r"[A-Z].*\.", cause.origin)


def test_what_is_an_event_is_never_made() -> None:
    """A reset and the unknown have no function; what freezes a stream can't be undone; the rest has both."""
    assert {c.name for c in CAUSES.values() if c.falsify is None} == {"estimator_reset", "unknown"}
    frozen = {"frozen_quaternion", "frozen_euler"}
    assert {c.name for c in CAUSES.values() if c.falsify is not None and c.undo is None} == frozen


# --- anchors by hand -----------------------------------------------------------------------------------------------

SIN_15, COS_15 = 0.25881904510252074, 0.9659258262890683


@pytest.mark.parametrize(
    ("name", "value", "q", "expected"),
    [
        # Level, yaw 30°: q = [cos 15°, 0, 0, sin 15°].
        ("quaternion_xyzw", (), [COS_15, 0, 0, SIN_15], [0, 0, SIN_15, COS_15]),
        ("quaternion_conjugate", (), [COS_15, 0, 0, SIN_15], [COS_15, 0, 0, -SIN_15]),
        ("quaternion_unnormalised", (1.05,), [0, 0.6, 0, 0.8], [0, 0.63, 0, 0.84]),
        # From north, 30° more about down is yaw 30°; about a nose that is level it is the same turn.
        ("yaw_offset", (30,), [1, 0, 0, 0], [COS_15, 0, 0, SIN_15]),
        ("mount_offset", (0, 0, 30), [1, 0, 0, 0], [COS_15, 0, 0, SIN_15]),
        # Rolled by 180°, the body's z points up: a turn about it goes the other way round down.
        ("yaw_offset", (30,), [0, 1, 0, 0], [0, COS_15, SIN_15, 0]),
        ("mount_offset", (0, 0, 30), [0, 1, 0, 0], [0, COS_15, -SIN_15, 0]),
        ("mount_offset", (0, 30, 0), [1, 0, 0, 0], [COS_15, 0, SIN_15, 0]),
        ("world_enu", (), [1, 0, 0, 0], [0, math.sqrt(0.5), math.sqrt(0.5), 0]),
        ("body_flu", (), [1, 0, 0, 0], [0, 1, 0, 0]),
        # Nose north, level: in ENU and FLU that is 90° anticlockwise from east, here with the other sign.
        ("enu_flu", (), [1, 0, 0, 0], [-math.sqrt(0.5), 0, 0, -math.sqrt(0.5)]),
    ],
)
def test_a_quaternion_by_hand(name: str, value: Value, q: list[float], expected: list[float]) -> None:
    """What each mistake puts into the slots w, x, y, z, sign included, worked out by hand."""
    np.testing.assert_allclose(sent(name, [q], *value), [expected], rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    ("name", "rpy", "expected"),
    [
        ("roll_sign", [0.1, 0.2, 0.3], [-0.1, 0.2, 0.3]),
        ("pitch_sign", [0.1, 0.2, 0.3], [0.1, -0.2, 0.3]),
        ("yaw_sign", [0.1, 0.2, 0.3], [0.1, 0.2, -0.3]),
        ("roll_pitch_swapped", [0.1, 0.2, 0.3], [0.2, 0.1, 0.3]),
        ("euler_degrees", [math.pi / 2, -math.pi / 4, math.pi], [90, -45, 180]),
        # Yaw 90°, then nose up by 30°: with x first that is a roll to the left by 30°, then the yaw.
        ("euler_xyz_order", [0, math.pi / 6, math.pi / 2], [-math.pi / 6, 0, math.pi / 2]),
    ],
)
def test_euler_angles_by_hand(name: str, rpy: list[float], expected: list[float]) -> None:
    """What each mistake puts into roll, pitch and yaw, worked out by hand."""
    np.testing.assert_allclose(sent(name, [rpy]), [expected], rtol=0, atol=1e-13)


def test_rates_of_the_angles_by_hand() -> None:
    """At 60° of roll a nose that turns to the right at 1 rad/s turns as q = sin 60°, r = cos 60°; the angles stay."""
    rpy, body = [math.pi / 3, 0.0, 0.2], [0.0, math.sqrt(0.75), 0.5]
    np.testing.assert_allclose(sent("euler_rates", [[*rpy, *body]]), [[*rpy, 0.0, 0.0, 1.0]], rtol=0, atol=1e-15)


def test_time_goes_forward_with_the_skew() -> None:
    """A positive skew makes the stamp late."""
    assert sent("time_skew", [1000, 1040]).tolist() == [1150, 1190]


def test_a_frozen_stream_repeats_its_first_sample() -> None:
    """Whatever the payload is made of, the first one stays; no sample at all stays none."""
    payload = np.array([(1, 0.5), (2, 0.6), (3, 0.7)], [("count", "u4"), ("roll", "f4")])
    frozen = CAUSES["frozen_euler"].falsify
    assert frozen is not None
    assert frozen(payload, ()).tolist() == [payload[0].item()] * 3
    assert frozen(payload[:0], ()).tolist() == []


# --- SciPy as the witness ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FRAMES)
def test_other_frames_are_other_axes(name: str) -> None:
    """The matrix of what is sent has the lines of the other world and the columns of the other body."""
    world, body = FRAMES[name]
    R_nb = attitudes()
    expected = world @ R_nb.as_matrix() @ body.T
    np.testing.assert_allclose(rotation(sent(name, quaternion(R_nb))).as_matrix(), expected, rtol=0, atol=1e-14)


def test_offsets_are_turns_of_the_world_or_of_the_body() -> None:
    """A yaw offset turns about down from the left, a mount offset about body axes from the right."""
    R_nb = attitudes()
    q, v = quaternion(R_nb), [10.0, -50.0, 100.0]
    turn = Rotation.from_rotvec(v, degrees=True)
    down = Rotation.from_euler("z", 25, degrees=True)
    assert same_attitude(sent("yaw_offset", q, 25), quaternion(down * R_nb))
    assert same_attitude(sent("mount_offset", q, *v), quaternion(R_nb * turn))
    assert same_attitude(sent("world_offset", q, *v), quaternion(turn * R_nb))


def test_a_yaw_offset_moves_yaw_alone() -> None:
    """Positive is clockwise seen from above: 25° more of yaw at the same roll and pitch."""
    yaw, pitch, roll = np.radians([40.0, 20.0, -30.0])
    q = quaternion(Rotation.from_euler("ZYX", [yaw, pitch, roll]))
    np.testing.assert_allclose(
        rotation(sent("yaw_offset", q, 25)).as_euler("ZYX", degrees=True), [65, 20, -30], rtol=0, atol=1e-12
    )


def test_the_wrong_order_is_scipys_xyz() -> None:
    """The angles sent are those of intrinsic X-Y-Z for the same rotation."""
    R_nb = attitudes()
    rpy = R_nb.as_euler("ZYX")[:, ::-1]
    np.testing.assert_allclose(sent("euler_xyz_order", rpy), R_nb.as_euler("XYZ"), rtol=0, atol=1e-11)


# --- undo ----------------------------------------------------------------------------------------------------------

unit = st.floats(-1.0, 1.0)
angle = st.floats(-2 * math.pi, 2 * math.pi)
quaternions = st.lists(
    st.tuples(unit, unit, unit, unit).filter(lambda q: np.linalg.norm(q) > 0.1), min_size=1, max_size=5
)
angles = st.lists(st.tuples(angle, angle, angle), min_size=1, max_size=5)


@st.composite
def values(draw: st.DrawFn, cause: Cause) -> Value:
    """Any value in the cause's range."""
    parameter = cause.parameter
    most = parameter.most / math.sqrt(parameter.count or 1)
    return tuple(draw(st.floats(max(parameter.least, -most), most)) for _ in range(parameter.count))


@pytest.mark.slow
@with_undo
@searched(30)
@given(data=st.data())
def test_undone_is_never_made(cause: Cause, data: st.DataObject) -> None:
    """Undo takes back exactly what falsify did, a quaternion's sign too, and neither touches what it was given."""
    assert cause.falsify is not None
    assert cause.undo is not None
    value = data.draw(values(cause))
    if cause.acts_on == "quaternion":
        samples = np.array(data.draw(quaternions))
        samples /= np.linalg.norm(samples, axis=-1, keepdims=True)
    elif cause.acts_on == "rpy":
        samples = np.array(data.draw(angles))
    elif cause.acts_on == "rates":  # where angles have rates: beside the poles
        rpy = np.array(data.draw(angles)) * [1.0, 0.2, 1.0]
        samples = np.concatenate(
            [rpy, np.array(data.draw(st.lists(st.tuples(unit, unit, unit), min_size=len(rpy), max_size=len(rpy))))],
            axis=1,
        )
    else:
        samples = np.array(data.draw(st.lists(st.integers(0, 2**32 - 1), max_size=5)), np.float64)
    before = samples.copy()
    made = cause.falsify(samples, value)
    assert made.shape == samples.shape
    kept = made.copy()
    undone = cause.undo(made, value)
    np.testing.assert_array_equal(samples, before)
    np.testing.assert_array_equal(made, kept)
    if cause.acts_on == "quaternion":
        np.testing.assert_allclose(undone, samples, rtol=0, atol=1e-12)
    elif cause.acts_on == "rpy":  # the same rotation: beyond ±90° of pitch, other angles tell it
        seen, expected = (quaternion(Rotation.from_euler("ZYX", rpy[:, ::-1])) for rpy in (undone, samples))
        assert same_attitude(seen, expected)
    else:
        np.testing.assert_allclose(undone, samples, rtol=0, atol=1e-6)


# --- values --------------------------------------------------------------------------------------------------------


def test_a_value_is_numbers_with_commas() -> None:
    """The text after the colon becomes the numbers, and nothing at all the default."""
    assert CAUSES["mount_offset"].parameter.parse("mount_offset", "0,-4,1.5") == (0.0, -4.0, 1.5)
    assert CAUSES["yaw_offset"].parameter.parse("yaw_offset", None) == (12.0,)
    assert CAUSES["quaternion_xyzw"].parameter.parse("quaternion_xyzw", None) == ()


@pytest.mark.parametrize(
    ("name", "text", "right"),
    [
        ("yaw_offset", "181", "a number from -180 to 180 deg"),
        ("yaw_offset", "", "a number from -180 to 180 deg"),
        ("yaw_offset", "nan", "a number from -180 to 180 deg"),
        ("yaw_offset", "1,2", "a number from -180 to 180 deg"),
        ("yaw_offset", "fast", "a number from -180 to 180 deg"),
        ("mount_offset", "4", "3 numbers, a vector of at most 180 deg, as mount_offset:0,4,0"),
        ("mount_offset", "170,170,0", "3 numbers, a vector of at most 180 deg"),
        ("quaternion_unnormalised", "0", "a number from 0.001 to 1000"),
        ("time_skew", "0.5", "a whole number from -60000 to 60000 ms"),
        ("quaternion_xyzw", "1", "it takes none"),
    ],
)
def test_a_wrong_value_says_what_is_right(name: str, text: str, right: str) -> None:
    """One line names the fault, what was given and what would be allowed."""
    with pytest.raises(UsageError, match=re.escape(right)) as refused:
        CAUSES[name].parameter.parse(name, text)
    said = str(refused.value)
    assert name in said
    assert repr(text) in said
    assert "\n" not in said
