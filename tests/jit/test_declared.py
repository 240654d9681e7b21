"""What annotations declare of a kernel's arguments, and what says too little."""

from __future__ import annotations

from types import FunctionType
from typing import Annotated, Any, NamedTuple, TypeVar, cast

import numpy as np
import numpy.typing as npt
import pytest
from typing_extensions import TypeAliasType

from gcs_bridge.columns import FloatRows, Floats, Int64s, Mask, Records
from gcs_bridge.jit.declared import ArrayOf, Scalar, TupleOf, declared_types, text_of

PAIR = np.dtype([("t", "i8"), ("x", "f8", (3,))])


class Sums(NamedTuple):
    of: Annotated[Records, PAIR]
    rows: Annotated[Floats, 3]
    times: int


def types_of(function: Any) -> tuple[Any, ...]:
    return declared_types(cast(FunctionType, function))


def test_arrays_have_one_dimension_unless_more_are_declared() -> None:
    """The aliases of `columns` say it, and what is annotated beside them."""

    def f(a: Floats, b: Int64s, c: Mask, d: FloatRows, e: Annotated[npt.NDArray[np.uint8], 3]) -> None: ...

    assert types_of(f) == (
        ArrayOf(np.dtype(np.float64), 1),
        ArrayOf(np.dtype(np.int64), 1),
        ArrayOf(np.dtype(np.bool_), 1),
        ArrayOf(np.dtype(np.float64), 2),
        ArrayOf(np.dtype(np.uint8), 3),
    )


Number = TypeVar("Number", bound=np.generic)
Aliased = TypeAliasType("Aliased", np.ndarray[tuple[Any, ...], np.dtype[Number]], type_params=(Number,))
Halves = Aliased[np.float32]


def test_aliases_of_python_3_12_are_what_they_stand_for() -> None:
    """Numpy's NDArray is such a one since 2.5."""

    def f(a: Halves, b: Annotated[Halves, 2]) -> None: ...

    assert types_of(f) == (ArrayOf(np.dtype(np.float32), 1), ArrayOf(np.dtype(np.float32), 2))


def test_numbers_and_named_tuples() -> None:
    """A named tuple is declared by its fields, wherever its class is defined."""

    def f(n: int, x: float, is_known: bool, sums: Sums) -> None: ...

    fields = (ArrayOf(PAIR, 1), ArrayOf(np.dtype(np.float64), 3), Scalar(int))
    assert types_of(f) == (Scalar(int), Scalar(float), Scalar(bool), TupleOf(Sums, fields))


def untold(a: int, b) -> None: ...  # type: ignore[no-untyped-def]
def records_of_no_dtype(a: Records) -> None: ...
def plain_tuple(a: tuple[Floats, ...]) -> None: ...
def text(a: str) -> None: ...


@pytest.mark.parametrize("function", [untold, records_of_no_dtype, plain_tuple, text])
def test_what_says_too_little_is_refused(function: Any) -> None:
    """With the name of the function and the argument."""
    with pytest.raises(
        TypeError, match=rf"{function.__name__}: [ab]: its annotation is no type of a kernel's argument"
    ):
        types_of(function)


def test_a_description_tells_types_apart() -> None:
    """By it machine code is found again: the order of a record's fields, their places and its size are in it."""
    dtypes = [
        PAIR,
        np.dtype([("x", "f8", (3,)), ("t", "i8")]),
        np.dtype([("t", "i8"), ("x", "f8", (2,))]),
        np.dtype({"names": ["t", "x"], "formats": ["i8", ("f8", (3,))], "offsets": [0, 16]}),
    ]
    texts = {text_of(TupleOf(Sums, (ArrayOf(dtype, ndim),))) for dtype in dtypes for ndim in (1, 2)}
    assert len(texts) == 8
