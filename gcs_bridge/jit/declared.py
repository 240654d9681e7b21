"""What a kernel's annotations declare: the one type that each of its arguments has, at every call.

A kernel is compiled once, for these types, before any data come; a call with others is a TypeError. So an annotation
says more than mypy needs: `Annotated[Floats, 2]` has two dimensions, and `Annotated[Records, MATCH]` that dtype.
"""

from __future__ import annotations

from types import FunctionType
from typing import Annotated, Any, NamedTuple, get_args, get_origin, get_type_hints

import numpy as np


class ArrayOf(NamedTuple):
    """A C-contiguous array that can be written."""

    dtype: np.dtype[Any]
    ndim: int

    def __str__(self) -> str:
        return f"{self.dtype!r}, ndim {self.ndim}"  # a record's fields and their places are in it


class TupleOf(NamedTuple):
    """A named tuple, or a plain one of so many."""

    of: type[tuple[Any, ...]]
    fields: tuple[Declared, ...]

    def __str__(self) -> str:
        return f"{self.of.__qualname__}({', '.join(map(str, self.fields))})"


class Scalar(NamedTuple):
    """An int of 64 bits, a float or a bool."""

    of: type[int | float | bool]

    def __str__(self) -> str:
        return self.of.__name__


Declared = ArrayOf | TupleOf | Scalar


def declared_types(function: FunctionType) -> tuple[Declared, ...]:
    """The type of each argument; TypeError where an annotation does not say it all."""
    hints = get_type_hints(function, include_extras=True)
    names = function.__code__.co_varnames[: function.__code__.co_argcount]
    return tuple(_declared(hints.get(name), f"{function.__qualname__}: {name}") for name in names)


def _declared(hint: Any, whose: str) -> Declared:
    said: tuple[Any, ...] = ()
    if get_origin(hint) is Annotated:
        hint, said = hint.__origin__, hint.__metadata__
    if hint in (int, float, bool):
        return Scalar(hint)
    if get_origin(hint) is tuple and ... not in get_args(hint):
        return TupleOf(tuple, tuple(_declared(part, whose) for part in get_args(hint)))
    if isinstance(hint, type) and issubclass(hint, tuple) and hasattr(hint, "_fields"):
        hints = get_type_hints(hint, include_extras=True)
        return TupleOf(hint, tuple(_declared(hints[name], f"{whose}.{name}") for name in hint._fields))
    if get_origin(hint) is np.ndarray:
        number = get_args(get_args(hint)[1])[0]
        ndim = next((one for one in said if isinstance(one, int)), 1)
        dtype = next((one for one in said if isinstance(one, np.dtype)), None)
        if dtype is not None or number is not np.void:
            return ArrayOf(dtype or np.dtype(number), ndim)
    raise TypeError(f"{whose}: its annotation is no type of a kernel's argument: {hint}")
