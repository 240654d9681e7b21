"""How rows of numbers enter and leave the math: shapes, meaningless rows, long batches.

Every function of this package works row by row. What that asks for has its one home here:

- `rowwise` turns array-likes into float64, refuses a wrong shape by the argument's name, and cuts a long batch into
  blocks, because a block's temporaries stay in the cache (five times faster than one pass over a million rows).
- `numbers`, `vector`, `matrix` and `ray` open a row into its components. A row that cannot mean anything becomes NaN
  as a whole; NaN then flows through the arithmetic without a warning and never leaves its row.

The components are used in element-wise arithmetic only. A product by BLAS or einsum may round differently with the
length of the batch; here a row gives the same bits alone and among a million.

This module knows shapes and numbers, and nothing of rotations.
"""

import functools
import math
from collections.abc import Callable
from types import EllipsisType
from typing import Any, ParamSpec, TypeVar

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Vector = tuple[Array, Array, Array]
Quaternion = tuple[Array, Array, Array, Array]

P = ParamSpec("P")
R = TypeVar("R")

LARGEST = 1e75
"""Sizes above it, and quaternion norms below its reciprocal, are taken for damage: NaN.

No angle, rate or acceleration is that large, and the fourth power of what is allowed is still a float: nothing here can
overflow, divide by zero or lose its digits to underflow.
"""

BLOCK = 8192
"""Rows in a block: a column of it is 64 KiB, and the ten or so in use at once fit into a core's cache."""


def rowwise(**tails: tuple[int, ...]) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Declare the shape of one row for each array argument of a function that works row by row.

    The function then gets float64 arrays of shape (..., *tail) whose leading dimensions broadcast, never more than
    BLOCK rows at once. It returns an array, or a tuple of arrays, that begins with the broadcast leading dimensions.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        code = function.__code__
        names = code.co_varnames[: code.co_argcount]

        @functools.wraps(function)
        def checked(*args: P.args, **kwargs: P.kwargs) -> R:
            given: dict[str, Any] = dict(zip(names, args, strict=False))
            given.update(kwargs)
            if len(given) < len(args) + len(kwargs) or not tails.keys() <= given.keys():
                return function(*args, **kwargs)  # a wrong call: Python says what is wrong with it
            leads = {}
            for name, tail in tails.items():
                array = given[name] = shaped(name, given[name], ..., *tail)
                leads[name] = array.shape[: array.ndim - len(tail)]
            lead = broadcast(leads)
            if math.prod(lead) <= BLOCK:
                return _in_order(function(**given))  # type: ignore[call-arg]  # P.kwargs, by name
            return _in_blocks(function, given, tails, lead)

        return checked

    return decorate


def shaped(name: str, value: npt.ArrayLike, *pattern: int | str | EllipsisType) -> Array:
    """Return `value` as float64 of a shape such as (..., 4) or ("n", 3), or raise ValueError; "n" is any length."""
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} is not an array of real numbers: {error}") from None
    tail, got = pattern, array.shape
    if pattern[0] is ...:
        tail = pattern[1:]
        got = got[max(array.ndim - len(tail), 0) :]
    if got != tail and (len(got) != len(tail) or any(n not in (m, "n") for n, m in zip(tail, got, strict=True))):
        expected = ", ".join("..." if n is ... else str(n) for n in pattern)
        raise ValueError(f"{name} has shape {array.shape}, expected ({expected})")
    return array


def broadcast(leads: dict[str, tuple[int, ...]]) -> tuple[int, ...]:
    """Return the common leading dimensions, or raise ValueError with every argument's own."""
    distinct = set(leads.values())
    try:
        return distinct.pop() if len(distinct) == 1 else np.broadcast_shapes(*distinct)
    except ValueError:
        listed = ", ".join(f"{name} {lead}" for name, lead in leads.items())
        raise ValueError(f"leading dimensions do not broadcast: {listed}") from None


def _in_order(result: R) -> R:
    if isinstance(result, tuple):
        return tuple(map(_in_order, result))  # type: ignore[return-value]  # R is a tuple here
    return result.copy() if isinstance(result, np.ndarray) and not result.flags.c_contiguous else result


def _in_blocks(
    function: Callable[..., R], given: dict[str, Any], tails: dict[str, tuple[int, ...]], lead: tuple[int, ...]
) -> R:
    count = math.prod(lead)
    flat = {}
    for name, tail in tails.items():
        if given[name].ndim > len(tail):  # a single row serves every block as it is
            flat[name] = np.broadcast_to(given[name], (*lead, *tail)).reshape(count, *tail)
    whole: list[npt.NDArray[Any]] = []
    piece: Any = ()
    for start in range(0, count, BLOCK):
        block = slice(start, start + BLOCK)
        piece = function(**{**given, **{name: rows[block] for name, rows in flat.items()}})
        columns = piece if isinstance(piece, tuple) else (piece,)
        if not whole:
            whole = [np.empty((count, *column.shape[1:]), column.dtype) for column in columns]
        for target, column in zip(whole, columns, strict=True):
            target[block] = column
    result = tuple(column.reshape(*lead, *column.shape[1:]) for column in whole)
    return result if isinstance(piece, tuple) else result[0]  # type: ignore[return-value]  # R is as one piece


def numbers(value: npt.ArrayLike) -> Array:
    """Open rows of one number each."""
    return _meaningful(np.asarray(value, dtype=np.float64), 0)


def vector(value: npt.ArrayLike) -> Vector:
    """Open rows of three numbers into x, y, z."""
    v = _meaningful(np.asarray(value, dtype=np.float64), 1)
    return v[..., 0], v[..., 1], v[..., 2]


def matrix(value: npt.ArrayLike) -> tuple[Vector, Vector, Vector]:
    """Open 3x3 matrices into their three lines of three elements."""
    m = _meaningful(np.asarray(value, dtype=np.float64), 2)
    first, second, third = ((m[..., i, 0], m[..., i, 1], m[..., i, 2]) for i in range(3))
    return first, second, third


def ray(value: npt.ArrayLike) -> tuple[Quaternion, Array]:
    """Open quaternions into w, x, y, z and the squared norm; one without a direction is NaN.

    Its norm is left as it is: most formulas are homogeneous and need no square root for a quaternion off unit norm.
    """
    q = np.asarray(value, dtype=np.float64)
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    with np.errstate(over="ignore"):
        norm2 = w * w + x * x + y * y + z * z
    least, most = LARGEST**-2, LARGEST**2
    if not _within(norm2, least, most):
        good = (norm2 >= least) & (norm2 <= most)
        w, x, y, z, norm2 = (np.where(good, part, np.nan) for part in (w, x, y, z, norm2))
    return (w, x, y, z), norm2


def unit(value: npt.ArrayLike) -> Quaternion:
    """Open quaternions into w, x, y, z of unit norm."""
    (w, x, y, z), norm2 = ray(value)
    scale = 1.0 / np.sqrt(norm2)
    return w * scale, x * scale, y * scale, z * scale


def where(mask: Mask, there: npt.ArrayLike, elsewhere: npt.ArrayLike) -> Array:
    """Choose row by row; by this name in all formulas, as a compiled kernel chooses between two numbers otherwise."""
    return np.where(mask, there, elsewhere)


def _meaningful(array: Array, axes: int) -> Array:
    if _within(array, -LARGEST, LARGEST):
        return array
    good = (np.abs(array) <= LARGEST).all(axis=tuple(range(-axes, 0)), keepdims=True)
    return np.where(good, array, np.nan)


def _within(array: Array, least: float, most: float) -> bool:
    # Two reductions need no temporary, and a NaN makes the comparison false.
    low = np.minimum.reduce(array, axis=None, initial=most)
    return bool(low >= least and np.maximum.reduce(array, axis=None, initial=least) <= most)


def join(*parts: Array) -> Array:
    """Put components of one shape (...) side by side: (..., n)."""
    rows = np.empty((*parts[0].shape, len(parts)))
    for i, part in enumerate(parts):
        np.add(part, 0.0, out=rows[..., i])  # no negative zeros: they would confuse a reader
    return rows


def grid(*lines: tuple[Array, ...]) -> Array:
    """Put lines of components of one shape (...) together as matrices: (..., n, m)."""
    stacked = np.array(lines)  # and one transposed view: faster than nine columns written far apart
    stacked += 0.0  # as in `join`
    return stacked.transpose(*range(2, stacked.ndim), 0, 1)
