"""What a kernel's annotations declare: the one type that each of its arguments has, at every call.

A kernel is compiled once, for these types, before any data come; a call with others is a TypeError. So an annotation
says more than mypy needs: `Annotated[Floats, 2]` has two dimensions, and `Annotated[Records, MATCH]` that dtype.
"""

from __future__ import annotations

import sys
from functools import cache
from types import FunctionType
from typing import Annotated, Any, NamedTuple, get_args, get_origin

import numpy as np


class ArrayOf(NamedTuple):
    """A C-contiguous array that can be written."""

    dtype: np.dtype[Any]
    ndim: int


class TupleOf(NamedTuple):
    """A named tuple, or a plain one of so many."""

    of: type[tuple[Any, ...]]
    fields: tuple[Declared, ...]


class Scalar(NamedTuple):
    """An int of 64 bits, a float or a bool."""

    of: type[int | float | bool]


Declared = ArrayOf | TupleOf | Scalar


def declared_types(function: FunctionType) -> tuple[Declared, ...]:
    """The type of each argument; TypeError where an annotation does not say it all."""
    names = function.__code__.co_varnames[: function.__code__.co_argcount]
    return tuple(_declared(function, name) for name in names)


def _declared(whose: Any, name: str) -> Declared:
    """What a function, or a class, says of its argument, or field, `name`."""
    said = whose.__annotations__.get(name, "None")
    said = getattr(said, "__forward_arg__", said)
    # Python's own get_type_hints takes ten times as long.
    found = _meant(said, whose.__module__) if isinstance(said, str) else _type_of(said)
    if found is None:
        raise TypeError(f"{whose.__qualname__}: {name}: its annotation is no type of a kernel's argument: {said}")
    return found


@cache
def _meant(annotation: str, module: str) -> Declared | None:
    """The type that an annotation means, where it stands; None: it is none of an argument."""
    return _type_of(eval(annotation, vars(sys.modules[module])))  # noqa: S307  # our own source


def _type_of(hint: Any) -> Declared | None:
    said: tuple[Any, ...] = ()
    if get_origin(hint) is Annotated:
        hint, said = hint.__origin__, hint.__metadata__
    if hasattr(get_origin(hint), "__value__"):  # an alias of Python 3.12's kind, as numpy's own are since 2.5
        hint = get_origin(hint).__value__[get_args(hint)]
    if hint in (int, float, bool):
        return Scalar(hint)
    if isinstance(hint, type) and issubclass(hint, tuple) and hasattr(hint, "_fields"):
        return TupleOf(hint, tuple(_declared(hint, name) for name in hint._fields))
    if get_origin(hint) is tuple:
        parts = [_type_of(part) for part in get_args(hint)]
        return None if None in parts else TupleOf(tuple, tuple(part for part in parts if part is not None))
    if get_origin(hint) is np.ndarray:
        number = get_args(get_args(hint)[1])[0]
        ndim = next((one for one in said if isinstance(one, int)), 1)
        dtype = next((one for one in said if isinstance(one, np.dtype)), None)
        if dtype is not None or number is not np.void:
            return ArrayOf(dtype or np.dtype(number), ndim)
    return None


@cache
def text_of(declared: Declared) -> str:
    """The type in words: of a record all fields, and where each of them is."""
    if isinstance(declared, ArrayOf):
        return f"{declared.dtype!r}, ndim {declared.ndim}"
    if isinstance(declared, TupleOf):
        return f"{declared.of.__qualname__}({', '.join(map(text_of, declared.fields))})"
    return declared.of.__name__
