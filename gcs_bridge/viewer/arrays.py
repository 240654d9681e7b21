"""Numbers and times as the columns that rerun takes.

Its own classes ask anew each time what they are given, which for the row or two of a live link takes ten times as long
as to copy them. Here that is asked once, of an example. The memory is arrow's, not numpy's: rerun's threads give it
back without waiting for Python.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import rerun as rr

from gcs_bridge.columns import Int64s

__all__ = [
    "ARROW",
    "CHILD_FRAME",
    "GEO_LINE",
    "GEO_POINT",
    "LINE",
    "LINE_LABEL",
    "PARENT_FRAME",
    "PLACE",
    "SCALARS",
    "TURN",
    "TimeColumn",
]

_ROWS = 4096  # the offsets of so many are made once


class _Column(rr.ComponentColumn):
    """A column that is ready."""

    def __init__(self, descriptor: rr.ComponentDescriptor, array: pa.Array) -> None:
        self.descriptor = descriptor
        self._array = array

    def as_arrow_array(self) -> pa.Array:
        return self._array


class ComponentKind:
    """A component of an archetype whose values are so many numbers each, or one line of such points a row."""

    def __init__(self, example: rr.ComponentColumnList, *, order: Sequence[int] | None = None) -> None:
        """As of `example`, of one column. `order`: in which rerun takes the numbers of a value; None: as they are."""
        (column,) = example
        self._descriptor = column.component_descriptor()
        self._order = None if order is None else list(order)
        self._rows: Any = column.as_arrow_array().type
        line = self._rows.value_type
        self._line: Any = line if pa.types.is_list(line) else None
        self._value: Any = line if self._line is None else line.value_type
        fixed = pa.types.is_fixed_size_list(self._value)
        self._size: int = self._value.list_size if fixed else 1
        self._number: Any = self._value.value_type if fixed else self._value
        self._type: type[np.generic] = pa.array([], self._number).to_numpy().dtype.type
        self._fixed = fixed
        self._offsets: dict[int, pa.Buffer] = {}  # by how many values a row has

    def column(self, values: npt.NDArray[np.float64]) -> rr.ComponentColumn:
        """A column of n rows: `values` (n, numbers), or (n, values, numbers) where a row has several, or a line of
        them; without numbers where a value is but one.
        """
        if self._order is not None:
            values = values[..., self._order]
        n, in_all = len(values), values.size // self._size
        array = pa.Array.from_buffers(self._number, values.size, [None, _copied(values, self._type)])
        if self._fixed:
            array = pa.Array.from_buffers(self._value, in_all, [None], children=[array])
        each = in_all // n
        if self._line is not None:
            array = pa.Array.from_buffers(self._line, n, [None, self._offsets_of(n, each)], children=[array])
            each = 1
        offsets = self._offsets_of(n, each)
        return _Column(self._descriptor, pa.Array.from_buffers(self._rows, n, [None, offsets], children=[array]))

    def _offsets_of(self, n: int, each: int) -> pa.Buffer:
        if n > _ROWS:
            return _counted(n, each)
        if each not in self._offsets:
            self._offsets[each] = _counted(_ROWS, each)
        return self._offsets[each]


class TextKind:
    """A component of an archetype whose values are texts."""

    def __init__(self, example: rr.ComponentColumnList) -> None:
        """As of `example`, of one column."""
        (column,) = example
        self._descriptor = column.component_descriptor()

    def column(self, texts: list[str]) -> rr.ComponentColumn:
        """A column of n rows, of one text each."""
        return _Column(self._descriptor, pa.ListArray.from_arrays(list(range(len(texts) + 1)), pa.array(texts)))


class TimeColumn:
    """Times on a timeline (n,), µs, as rerun takes them: since an instant of its own, or since 1970."""

    def __init__(self, timeline: str, t_us: Int64s, *, since_1970: bool = False) -> None:
        """Copies them."""
        self._timeline = timeline
        self._times = pa.Array.from_buffers(
            _SINCE_1970 if since_1970 else _SINCE, len(t_us), [None, _copied(1000 * t_us, np.int64)]
        )

    def timeline_name(self) -> str:
        """Which timeline."""
        return self._timeline

    def as_arrow_array(self) -> pa.Array:
        """The times, ns."""
        return self._times


def _copied(values: npt.NDArray[Any], kind: type[np.generic]) -> pa.Buffer:
    """At least one value, as `kind`."""
    buffer = pa.allocate_buffer(values.size * np.dtype(kind).itemsize)
    np.frombuffer(buffer, kind).reshape(values.shape)[...] = values
    return buffer


def _counted(n: int, each: int) -> pa.Buffer:
    return _copied(np.arange(0, (n + 1) * each, each), np.int32)


_SINCE, _SINCE_1970 = pa.duration("ns"), pa.timestamp("ns")
TURN = ComponentKind(rr.Transform3D.columns(quaternion=np.zeros((1, 4))), order=(1, 2, 3, 0))
"""Of [w, x, y, z], which rerun takes as [x, y, z, w]."""
PLACE = ComponentKind(rr.Transform3D.columns(translation=np.zeros((1, 3))))
SCALARS = ComponentKind(rr.Scalars.columns(scalars=np.zeros(1)))
ARROW = ComponentKind(rr.Arrows3D.columns(vectors=np.zeros((1, 3))))
LINE = ComponentKind(rr.LineStrips3D.columns(strips=[np.zeros((2, 3))]))
LINE_LABEL = TextKind(rr.LineStrips3D.columns(labels=[""]))
GEO_POINT = ComponentKind(rr.GeoPoints.columns(positions=np.zeros((1, 2))))
GEO_LINE = ComponentKind(rr.GeoLineStrings.columns(line_strings=[np.zeros((2, 2))]))
CHILD_FRAME = TextKind(rr.Transform3D.columns(child_frame=[""]))
PARENT_FRAME = TextKind(rr.Transform3D.columns(parent_frame=[""]))
