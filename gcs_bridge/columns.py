"""Arrays that belong together: their types, and records of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import MISSING, FrozenInstanceError, dataclass, fields
from typing import Annotated, Any, ClassVar, Self, TypeVar, dataclass_transform

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Int64s = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]
Records = npt.NDArray[np.void]
# For kernels, which are compiled for so many dimensions; elsewhere the types above stand for any number of them.
FloatRows = Annotated[Floats, 2]
Int64Rows = Annotated[Int64s, 2]
MaskRows = Annotated[Mask, 2]
Rows = slice | Int64s | Mask
"""Some rows of arrays: a slice, their indices or a mask."""


T = TypeVar("T")


@dataclass_transform(frozen_default=True, kw_only_default=True, eq_default=False)
def record(cls: type[T]) -> type[T]:
    """As `dataclass(frozen=True, kw_only=True, eq=False)`, without the code that it writes for each class.

    To write that takes a sixth of the time in which this program starts; and where every field is given, an instance
    is made in a third of the time: a short batch spends more on its records than on all that it computes.
    """
    made: Any = dataclass(init=False, repr=False, eq=False)(cls)
    names = frozenset(one.name for one in fields(made))
    defaults = {one.name: one.default for one in fields(made) if one.default is not MISSING}

    def fill(self: Any, **given: Any) -> None:
        if given.keys() != names:
            given = defaults | given
            if given.keys() != names:
                wrong = ", ".join(sorted(given.keys() ^ names))
                raise TypeError(f"{type(self).__qualname__} takes its fields, each of them: not so {wrong}")
        _put(self, "__dict__", given)  # as it is, and no copy: it is nobody else's

    made.__init__, made.__repr__, made.__setattr__, made.__delattr__ = fill, _shown, _refused, _refused
    return cls


_put = object.__setattr__  # past what refuses it


def _shown(one: Any) -> str:
    return f"{type(one).__qualname__}({', '.join(f'{name}={value!r}' for name, value in vars(one).items())})"


def _refused(one: Any, name: str, *_: object) -> None:
    raise FrozenInstanceError(f"cannot change field {name!r} of {type(one).__qualname__}")


class Columns:
    """A record of arrays, one row a sample: a subclass is a `record` that declares them.

    The first field is an array of n rows. Every field that is an array has as many; all others, None too, hold for the
    whole record, and go with any part of it.
    """

    _first_field: ClassVar[str]

    def __init_subclass__(cls) -> None:
        if not hasattr(cls, "_first_field"):
            cls._first_field = next(iter(cls.__annotations__))

    def __len__(self) -> int:
        return len(self.__dict__[self._first_field])

    def __getitem__(self, rows: Rows) -> Self:
        """Some of the rows."""
        # Past __init__, which would take longer than all the rest for a batch of one row.
        part = object.__new__(type(self))
        fields = {name: of[rows] if isinstance(of, np.ndarray) else of for name, of in self.__dict__.items()}
        _put(part, "__dict__", fields)
        return part

    def first(self, n: int) -> Self:
        """The first `n` rows: the record itself where there are no more."""
        return self if len(self) == n else self[:n]

    def where(self, mask: Mask) -> Self:
        """The rows (n,) that are true: the record itself where all are."""
        return self if all_true(mask) else self[mask]

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """All of `parts`, one or more, one behind the other; what holds for a whole record is the first one's."""
        first = parts[0]
        if len(parts) == 1:
            return first
        whole = object.__new__(type(first))
        whole.__dict__.update(
            {
                name: np.concatenate([part.__dict__[name] for part in parts]) if isinstance(of, np.ndarray) else of
                for name, of in first.__dict__.items()
            }
        )
        return whole

    def then(self, more: Self) -> Self:
        """These rows, and `more` behind them."""
        return self.joined((self, more)) if len(more) else self


@record
class FrameColumns(Columns):
    """Rows that frames of a link brought, in order of arrival: `frame_index` (n,) is of the frame in its link."""

    frame_index: Int64s

    def __len__(self) -> int:
        return len(self.frame_index)

    def frames(self, first: int, end: int) -> Self:
        """The rows of the frames from `first` up to, and without, `end`."""
        start, stop = np.searchsorted(self.frame_index, (first, end)).tolist()
        return self[start:stop]

    @classmethod
    def in_arrival(cls, parts: Sequence[Self]) -> Self:
        """All of `parts`, one or more, in order of arrival; of one frame, in the order of the parts."""
        whole = cls.joined(parts)
        return whole if len(parts) == 1 else whole[np.argsort(whole.frame_index, kind="stable")]


def any_true(mask: Mask) -> bool:
    """As `mask.any()`, which takes ten times as long for some rows."""
    return b"\1" in mask.tobytes()


def all_true(mask: Mask) -> bool:
    """As `mask.all()`, likewise."""
    return b"\0" not in mask.tobytes()


def running_max(numbers: Int64s, before: int) -> Int64s:
    """`before`, then the largest of it and the numbers (n,) up to each (n + 1,)."""
    largest = np.empty(len(numbers) + 1, np.int64)
    largest[0], largest[1:] = before, numbers
    return np.maximum.accumulate(largest, out=largest)


def last_where(mask: Mask) -> Int64s:
    """For each place (n,) the last one up to it where the mask is true; −1 where there is none."""
    return np.asarray(np.maximum.accumulate(np.where(mask, np.arange(len(mask)), -1)))
