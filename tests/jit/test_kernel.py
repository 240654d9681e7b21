"""What Python sees of a kernel: a function that takes what its annotations declare, and nothing else."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import BuiltinFunctionType
from typing import Annotated, Any, NamedTuple, cast

import numpy as np
import pytest

from gcs_bridge import cache
from gcs_bridge.columns import FloatRows, Floats, Int64s, Mask, Records
from gcs_bridge.jit import helper, in_kernels, kernel, share
from gcs_bridge.jit.kernels import KERNELS, Kernel

PAIR = np.dtype([("t", "i4"), ("x", "f8")])


class Sums(NamedTuple):
    rows: FloatRows
    pairs: Annotated[Records, PAIR]


def doubled(x: Any) -> Any:
    return x + x


def one_of(x: Any, other: Any) -> Any:
    return np.where(x > 0, x, other)


@in_kernels(one_of)
def _one_of(x, other):  # type: ignore[no-untyped-def]
    return x if x > 0 else other


@helper
def largest(values):  # type: ignore[no-untyped-def]
    most = values[0]
    for value in values:
        most = max(most, value)
    return most


share(doubled)


@kernel
def add_all(
    values: Floats, mask: Mask, sums: Sums, start: float, times: int, is_whole: bool
) -> tuple[float, int, bool]:
    """Says what it does."""
    total = start
    for i in range(values.size):
        if mask[i]:
            total += values[i] * times
            sums.rows[0, 0] += values[i]
    sums.pairs[0].t, sums.pairs[0].x = values.size, one_of(largest(values), 0.0)
    return doubled(total), values.size, not is_whole


@kernel
def fill(values: Int64s) -> None:
    for i in range(values.size):
        values[i] = i


@kernel
def place_of(values: Int64s, value: int) -> int:
    for i in range(values.size):
        if values[i] == value:
            return i
    return -1


@kernel
def divided(x: float, y: float) -> float:
    return x / y


@kernel
def unpacked(values: Int64s) -> int:
    a, b = values
    return a + b  # type: ignore[no-any-return]  # of an array


@kernel
def spin(state: Annotated[np.ndarray[Any, np.dtype[np.int64]], 1], most: int) -> bool:
    for _ in range(most):
        if state[0] != 0:
            most = -1
            break
    return most < 0


def given() -> tuple[Any, ...]:
    sums = Sums(np.zeros((2, 3)), np.zeros(4, PAIR))
    return (np.array([1.0, 5.0, 2.0]), np.array([True, False, True]), sums, 0.5, 2, False)


def test_it_is_called_like_the_function_that_it_was_and_changes_what_it_is_given() -> None:
    """With the functions that kernels call in place of others; results are Python's own numbers."""
    arguments = given()
    assert add_all(*arguments) == (13.0, 3, True)
    assert [type(part) for part in add_all(*arguments)] == [float, int, bool]
    rows, pairs = arguments[2]
    assert rows[0, 0] == 6.0
    assert pairs[0].tolist() == (3, 5.0)
    assert add_all.__doc__ == "Says what it does."
    values = np.full(3, 7)
    assert cast(Any, fill)(values) is None
    assert values.tolist() == [0, 1, 2]


def test_it_runs_as_machine_code_loaded_without_numbas_dispatcher() -> None:
    """Of this program's kernels each one does: none has fallen back."""
    for one in KERNELS:
        one.load()
        assert isinstance(one._run, BuiltinFunctionType), one.__name__


def test_numbers_are_taken_as_python_takes_them() -> None:
    """An int for a float, numpy's numbers for Python's; no float for an int, and no text."""
    values = np.arange(5)
    assert place_of(values, cast(Any, np.int32(3))) == place_of(values, True + 2) == 3
    assert place_of(values, -(2**63)) == -1
    assert divided(1, cast(Any, np.float32(4.0))) == 0.25
    assert divided(1.0, 0.0) == np.inf
    with pytest.raises(TypeError):
        place_of(values, 3.0)  # type: ignore[arg-type]
    with pytest.raises(TypeError):
        divided("1", 1.0)  # type: ignore[arg-type]
    with pytest.raises(OverflowError):
        place_of(values, 2**63)


class Subclass(np.ndarray[Any, Any]):
    pass


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (0, np.zeros(3, np.float32)),
        (0, np.zeros(3, np.int64)),
        (0, np.zeros(3, ">f8")),
        (0, np.zeros((3, 1))),
        (0, np.zeros(3).view(Subclass)),
        (0, np.frombuffer(bytearray(25), np.uint8)[1:].view("f8")),
        (0, [1.0, 2.0, 3.0]),
        (0, None),
        (1, np.zeros(3, np.uint8)),
        (2, (np.zeros((2, 3)),)),
        (2, [np.zeros((2, 3)), np.zeros(4, PAIR)]),
        (2, (np.zeros((2, 3)), np.zeros(4, "V11"))),
    ],
)
def test_any_other_argument_is_refused_by_its_name(place: int, value: Any) -> None:
    """Before anything is read or written: the code would take it for what it is not."""
    arguments = list(given())
    arguments[place] = value
    name = ("values", "mask", "sums")[place]
    with pytest.raises(TypeError, match=rf"add_all\(\): {name} is not what its annotation says|expected .*tuple|tuple"):
        add_all(*arguments)


@pytest.mark.parametrize("count", [0, 5, 7])
def test_so_is_another_number_of_arguments(count: int) -> None:
    """And arguments by name."""
    with pytest.raises(TypeError, match=r"add_all\(\) takes 6 arguments by their position"):
        add_all(*(*given(), 1)[:count])
    with pytest.raises(TypeError):
        cast(Any, fill)(values=np.zeros(1, np.int64))


def test_a_kernel_that_fails_is_an_error() -> None:
    """Whatever went wrong in it; numba's own way to call it tells what."""
    assert unpacked(np.array([1, 2])) == 3
    with pytest.raises(RuntimeError, match=r"unpacked\(\) has failed: NUMBA_BOUNDSCHECK=1 tells more"):
        unpacked(np.arange(3))


@kernel
def _last_two(values: Int64s) -> int:
    return int(10 * values[-2] + values[-1])


def test_a_number_in_the_code_may_count_from_the_end() -> None:
    """As in Python."""
    assert _last_two(np.arange(5)) == 34


def test_nothing_is_kept_of_what_it_was_given() -> None:
    """Calls leave every object with as many references as it had, also those that are refused."""
    arguments = [*given(), 1000.5, 10**9]
    arguments[3], arguments[4] = arguments.pop(6), arguments.pop(6)
    wrong = list(arguments)
    wrong[5], wrong[2] = 0, (arguments[2].rows, None)
    everything = [*arguments, *arguments[2], None, True, False]
    before = [sys.getrefcount(one) for one in everything]
    for _ in range(1000):
        add_all(*arguments)
        fill(np.zeros(1, np.int64))
        with pytest.raises(TypeError):
            add_all(*wrong)
    after = [sys.getrefcount(one) for one in everything]  # of None and such there are some more or less anyway
    assert [now - then for then, now in zip(before, after, strict=True) if abs(now - then) > 900] == []


def test_other_threads_run_meanwhile() -> None:
    """It holds no GIL: another thread ends it."""
    state, ended = np.zeros(1, np.int64), []
    spin(state, 1)  # it is compiled by now
    thread = threading.Thread(target=lambda: ended.append(spin(state, 10**10)))
    thread.start()
    time.sleep(0.05)
    state[0] = 1
    thread.join(5.0)
    assert ended == [True]


@pytest.mark.slow  # numba itself compiles
def test_where_numba_is_not_as_it_is_known_its_own_dispatcher_does_the_work(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The same results, for any types."""
    from numba.np import arrayobj

    from gcs_bridge.jit import compiler, entry
    from gcs_bridge.jit.by_numba import counted_from_the_front

    with monkeypatch.context() as patch:
        patch.delattr(arrayobj, "fix_integer_index")
        with counted_from_the_front():
            assert not hasattr(arrayobj, "fix_integer_index")
    for place, name, value in (
        (entry, "_ITEM_SIZE", entry._KIND),
        (compiler, "layout_is_known", lambda: False),
        (compiler, "_is_there", lambda name: False),
        (compiler, "compile_extra", None),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(place, name, value)
            patch.setattr(cache, "read", lambda name: None)
            one = Kernel(cast(Kernel, add_all).function)
            one.load()
        assert not isinstance(one._run, BuiltinFunctionType)
        assert one(*given()) == (13.0, 3, True)


@pytest.mark.slow  # numba itself compiles
@pytest.mark.parametrize("variable", ["NUMBA_BOUNDSCHECK", "NUMBA_DISABLE_JIT"])
def test_what_developers_ask_of_numba_is_done(variable: str, tmp_path: Path) -> None:
    """An index out of bounds is an IndexError then, and no line of another array; nothing of it is kept.

    So is one that counts from the end, unless all is Python: kernels have none but numbers that stand in their code.
    """
    source = """
from __future__ import annotations
import numpy as np
from gcs_bridge.columns import Int64s
from gcs_bridge.jit import kernel

@kernel
def item(values: Int64s, at: int) -> int:
    return values[at]

for at in (3, -1):
    try:
        print(item(np.arange(3), at))
    except IndexError as error:
        print(error)
"""
    (tmp_path / "item.py").write_text(source)
    environment = {**os.environ, variable: "1", "GCS_BRIDGE_CACHE_DIR": str(tmp_path / "kept")}
    done = subprocess.run(
        [sys.executable, "item.py"], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    behind, before = done.stdout.splitlines()
    assert "out of bounds" in behind
    assert ("out of bounds" in before) if variable == "NUMBA_BOUNDSCHECK" else before == "2"
    assert not list(tmp_path.glob("kept/*"))


@kernel
def _double_of(given: Floats, doubled: Floats) -> None:
    for i in range(given.size):
        doubled[i] = 2.0 * given[i]


def test_arrays_of_another_layout_are_taken_as_copies_and_what_is_written_comes_back() -> None:
    """Every second number, and numbers that must not be written, go in; every third place gets what comes out."""
    given, doubled = np.arange(6.0)[::2], np.zeros(9)
    given.flags.writeable = False
    _double_of(given, doubled[::3])
    assert doubled.tolist() == [0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 8.0, 0.0, 0.0]
