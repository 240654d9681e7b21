"""Laws of every row-wise function: bits that do not depend on the batch, rows that do not disturb each other."""

import inspect
import re
import warnings
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest

from gcs_bridge import attitude
from gcs_bridge.attitude import _rows
from tests.helpers.attitude_cases import CASES, QUATERNION, SHARE, Arguments, array_arguments, outputs, random_arguments
from tests.helpers.everyday import one_in

Function = Callable[..., Any]  # one of the package: what it takes and gives is what these tests look at
NOT_ROW_WISE = {"DeadReckoner", "DeadReckoning", "G_M_S2", "RestWatch", "at_rest", "continuous", "dead_reckon", "mean"}


@pytest.fixture(params=one_in(2, sorted(CASES), swept=False))
def name(request: pytest.FixtureRequest) -> str:
    name: str = request.param
    return name


@pytest.fixture
def function(name: str) -> Function:
    function: Function = getattr(attitude, name)
    return function


@pytest.fixture
def rng(name: str) -> np.random.Generator:
    return np.random.default_rng(sorted(CASES).index(name))


def cut(arguments: Arguments, arrays: Iterable[str], rows: int | slice) -> Arguments:
    return {key: value[rows] if key in arrays else value for key, value in arguments.items()}


def test_every_function_has_its_case() -> None:
    """The laws below hold for all that is exported, the few functions of whole series aside."""
    assert set(CASES) | NOT_ROW_WISE == set(attitude.__all__)
    for name, case in CASES.items():
        assert set(case) <= set(inspect.signature(getattr(attitude, name)).parameters)


def test_a_row_has_the_same_bits_alone_and_in_any_batch(
    name: str, function: Function, rng: np.random.Generator
) -> None:
    """A batch longer than a block equals its pieces of 1, 2, 3, 7, 64 and 1000 rows, byte by byte."""
    arrays = array_arguments(name)
    n = _rows.BLOCK + 77
    arguments = random_arguments(name, rng, n)
    whole = outputs(function(**arguments))
    sizes = [1] * 40 + [2, 3, 7, 64, 1000]
    starts = [*range(20), *range(n - 20, n), 100, 200, 300, _rows.BLOCK - 30, 2000]
    for start, size in zip(starts, sizes, strict=True):
        piece = outputs(function(**cut(arguments, arrays, slice(start, start + size))))
        for part, full in zip(piece, whole, strict=True):
            assert part.flags.c_contiguous
            assert part.tobytes() == full[start : start + size].tobytes()
    single = outputs(function(**cut(arguments, arrays, 5)))
    for part, full in zip(single, whole, strict=True):
        assert part.shape == full.shape[1:]
        assert part.tobytes() == full[5].tobytes()


def test_layout_and_type_do_not_matter(name: str, function: Function, rng: np.random.Generator) -> None:
    """Reversed views and nested lists give what contiguous arrays give."""
    arrays = array_arguments(name)
    arguments = random_arguments(name, rng, 9)
    backwards = {key: value[::-1].copy()[::-1] if key in arrays else value for key, value in arguments.items()}
    lists = {key: value.tolist() if key in arrays else value for key, value in arguments.items()}
    expected = outputs(function(**arguments))
    for variant in (backwards, lists):
        for part, full in zip(outputs(function(**variant)), expected, strict=True):
            assert part.tobytes() == full.tobytes()


def test_arguments_stay_untouched(name: str, function: Function, rng: np.random.Generator) -> None:
    """No function writes into its arguments."""
    arguments = random_arguments(name, rng, 3)
    for key in array_arguments(name):
        arguments[key].setflags(write=False)
    function(**arguments)


def test_broadcasting_equals_the_loop(name: str, function: Function, rng: np.random.Generator) -> None:
    """Leading dimensions (5, 1) and (3) of the arguments meet as (5, 3), also when the batch exceeds a block."""
    arrays = array_arguments(name)
    for tall, wide in ((5, 3), (2, _rows.BLOCK)):
        columns, lines = random_arguments(name, rng, tall, 1), random_arguments(name, rng, wide)
        mixed = {key: (columns, lines)[i % 2][key] for i, key in enumerate(CASES[name])}
        lead = np.broadcast_shapes(*(mixed[key].shape[: mixed[key].ndim - len(tail)] for key, tail in arrays.items()))
        result = outputs(function(**mixed))
        for place in {tuple(0 for _ in lead), tuple(min(2, n - 1) for n in lead), tuple(n - 1 for n in lead)}:
            row = {key: np.broadcast_to(mixed[key], (*lead, *tail))[place] for key, tail in arrays.items()}
            for part, full in zip(outputs(function(**(mixed | row))), result, strict=True):
                assert full.shape[: len(lead)] == lead
                assert part.tobytes() == full[place].tobytes()


def test_a_meaningless_row_becomes_nan_and_disturbs_no_other(
    name: str, function: Function, rng: np.random.Generator
) -> None:
    """NaN or infinity anywhere, or a zero quaternion, spoil their whole row and no bit of another, with no warning."""
    arrays = array_arguments(name)
    n, bad = 12, 7
    arguments = random_arguments(name, rng, n)
    healthy = outputs(function(**arguments))
    for key, tail in arrays.items():
        places = list(np.ndindex(*tail))
        spoilt: list[tuple[Any, float]] = [
            (place, value) for place in places for value in (np.nan, np.inf, -np.inf, 1e300)
        ]
        if CASES[name][key] == QUATERNION:
            spoilt += [(..., 0.0), (..., np.inf), (..., 1e-300), (..., 1e-80), (..., 1e80)]
        if CASES[name][key] == SHARE:
            spoilt += [((), -0.1), ((), 1.1)]
        for place, value in spoilt:
            rows = arguments[key].copy()
            rows[bad, ...][place] = value
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                result = outputs(function(**(arguments | {key: rows})))
            for part, before in zip(result, healthy, strict=True):
                spoiled = ~part[bad] if part.dtype == bool else np.isnan(part[bad])
                assert spoiled.all(), (key, place, value)
                assert np.delete(part, bad, axis=0).tobytes() == np.delete(before, bad, axis=0).tobytes()


def test_no_zero_has_a_sign(name: str, function: Function) -> None:
    """Quarter and half turns about the axes, and vectors along them, give zeros, and none of them prints as -0."""
    rows = {
        "quaternion": [[1, 0, 0, 0], [-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0], [1, 0, 0, -1], [1, -0.0, 0, -0.0]],
        "vector": [[0, 0, 0], [-0.0, 0, -0.0], [0, 0, -1], [1, 0, 0], [0, -1, 0], [0, 0, 1]],
        "matrix": attitude.elementary_rotation("z", np.pi / 2).round() @ np.diag([1, -1, -1]) * np.ones((6, 1, 1)),
        "number": [1, -1, 2, -2, 1, -1],
        "share": [0, 1, 0.5, 0, 1, 0.5],
    }
    arguments = {key: np.array(rows[kind], float) if kind in rows else kind for key, kind in CASES[name].items()}
    for part in outputs(function(**arguments)):
        assert not (np.signbit(part.astype(float)) & (part == 0.0)).any()


def test_damage_begins_above_1e75() -> None:
    """A number of 1e75 is taken as it is, the next float is not; nor is a quaternion shorter than 1e-75."""
    for axis in (*np.eye(3), *-np.eye(3)):
        largest, beyond = 1e75 * axis, np.nextafter(1e75, np.inf) * axis
        assert (np.abs(attitude.flu_from_frd(largest)) == np.abs(largest)).all()
        assert np.isnan(attitude.flu_from_frd([axis, largest, beyond])).all(axis=-1).tolist() == [False, False, True]
    sizes = np.array([0.99e-75, 1.01e-75, 0.99e75, 1.01e75])[:, None]
    lost = np.isnan(attitude.normalise(sizes * [0.6, 0.0, 0.0, 0.8])).all(axis=-1)
    assert lost.tolist() == [True, False, False, True]


def test_no_rows_are_fine(name: str, function: Function, rng: np.random.Generator) -> None:
    """A batch of no rows gives no rows."""
    for part in outputs(function(**random_arguments(name, rng, 0))):
        assert part.shape[0] == 0


def test_a_wrong_shape_is_named(name: str, function: Function, rng: np.random.Generator) -> None:
    """ValueError says which argument, which shape it has and which was expected."""
    for key, tail in array_arguments(name).items():
        arguments = random_arguments(name, rng, 2)
        if tail == ():
            arguments[key] = np.zeros(5)
            if len(array_arguments(name)) > 1:
                with pytest.raises(ValueError, match=rf"do not broadcast: .*{key} \(5,\)"):
                    function(**arguments)
            continue
        for shape in ((2, 5), (2,), (), (2, *tail[:-1], tail[-1] + 1)):
            arguments[key] = np.zeros(shape)
            message = re.escape(f"{key} has shape {shape}, expected (..., {', '.join(map(str, tail))})")
            with pytest.raises(ValueError, match=f"^{message}$"):
                function(**arguments)


def test_text_is_no_number(name: str, function: Function, rng: np.random.Generator) -> None:
    """ValueError says which argument is not numbers at all."""
    for key in array_arguments(name):
        with pytest.raises(ValueError, match=f"^{key} is not an array of real numbers"):
            function(**(random_arguments(name, rng, 2) | {key: "north"}))


def test_leading_dimensions_that_do_not_meet_are_named() -> None:
    """ValueError lists every argument's leading dimensions."""
    with pytest.raises(ValueError, match=r"leading dimensions do not broadcast: a \(3,\), b \(5,\)"):
        attitude.multiply(np.ones((3, 4)), np.ones((5, 4)))


@pytest.mark.parametrize(
    "sequence", ["", "ZY", "ZYXZ", "ZZX", "XYY", "ZyX", "ABC", "123", "Z Y", 5, None, ["Z", "Y", "X"]]
)
def test_unknown_sequences_are_refused(sequence: Any) -> None:
    """Anything but three axes of one case with no two neighbours alike is named and refused."""
    q, angles, R = np.ones(4), np.ones(3), np.eye(3)
    for call in (
        lambda: attitude.euler_from_quaternion(q, sequence),
        lambda: attitude.quaternion_from_euler(angles, sequence),
        lambda: attitude.matrix_from_euler(angles, sequence),
        lambda: attitude.euler_from_matrix(R, sequence),
        lambda: attitude.near_gimbal_lock(q, sequence=sequence),
    ):
        with pytest.raises(ValueError, match=r"sequence is .*, expected"):
            call()


@pytest.mark.parametrize("axis", ["w", "", "xy", 0, None])
def test_unknown_axes_are_refused(axis: Any) -> None:
    """An elementary rotation is about x, y or z."""
    with pytest.raises(ValueError, match=r"axis is .*, expected 'x', 'y' or 'z'"):
        attitude.elementary_rotation(axis, 1.0)


@pytest.mark.parametrize("function", [attitude.mean, attitude.continuous])
def test_series_of_a_wrong_shape_are_named(function: Function) -> None:
    """A single quaternion is no series."""
    for shape in ((4,), (3, 3), ()):
        with pytest.raises(ValueError, match=r"^q has shape .*, expected \(\.\.\., n, 4\)$"):
            function(np.ones(shape))


def test_a_wrong_call_is_a_type_error() -> None:
    """Too many, too few, doubled or unknown arguments are Python's own errors."""
    q = np.ones(4)
    multiply: Function = attitude.multiply
    from_rpy: Function = attitude.quaternion_from_rpy
    calls: list[Callable[[], Any]] = [
        lambda: multiply(q),
        lambda: multiply(q, q, q),
        lambda: multiply(q, q, a=q),
        lambda: multiply(q, c=q),
        lambda: from_rpy(0, 0, 0),
    ]
    for call in calls:
        with pytest.raises(TypeError):
            call()


def test_arguments_may_be_named() -> None:
    """Positional and named arguments mean the same."""
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 3, 4))
    np.testing.assert_array_equal(attitude.multiply(b=b, a=a), attitude.multiply(a, b))
