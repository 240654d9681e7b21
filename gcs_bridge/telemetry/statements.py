"""What a vehicle says of itself beside its motion: modes, parameters, texts, in order of arrival.

Each statement carries the index of its frame: it holds for what comes behind it. Nothing is judged here. Anybody may
have sent them: their words are made one line of signs that can be shown, and nothing else, before they go anywhere.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge.columns import Floats, Int64s
from gcs_bridge.errors import one_line
from gcs_bridge.jit import helper


class ParameterSet(NamedTuple):
    """A PARAM_VALUE: the parameter has this value."""

    frame_index: int
    name: str
    value: float


class ModeSet(NamedTuple):
    """A HEARTBEAT that says something else than the one before.

    `autopilot` and `type` as in the report ("ardupilot", "fixed_wing"); `custom_mode` is the firmware's own number.
    """

    frame_index: int
    autopilot: str
    type: str
    custom_mode: int
    armed: bool


class LandedSet(NamedTuple):
    """An EXTENDED_SYS_STATE: whether the vehicle is on the ground, None where it does not know."""

    frame_index: int
    landed: bool | None


class TextSaid(NamedTuple):
    """A STATUSTEXT."""

    frame_index: int
    text: str


class FlagsSet(NamedTuple):
    """The estimator's flags or reset counter changed; `what` names the message and its field."""

    frame_index: int
    what: str
    before: int
    value: int


class ReadySet(NamedTuple):
    """The message `source` says now that the attitude is ready, or that it is not."""

    frame_index: int
    source: str
    ready: bool


Statement = ParameterSet | ModeSet | LandedSet | TextSaid | FlagsSet | ReadySet


class StepSignal:
    """A value that holds from one frame on until another comes, looked up by frame."""

    def __init__(self, value: float = np.nan) -> None:
        """Hold `value` before anything was told; NaN: unknown."""
        self._hold(np.array([-1]), np.array([value]))

    def put(self, frame_indices: Int64s, values: Floats) -> None:
        """Take values (n,) that hold from frames (n,) on; of one frame the last one put. Kept until `forget`."""
        if not len(frame_indices):
            return
        frame_indices = np.concatenate((self._frame_indices, frame_indices))
        values = np.concatenate((self._values, values))
        # Rarely out of order: what was told in a later boot may be put before what shows in the one that ends.
        order = np.argsort(frame_indices, kind="stable")
        self._hold(frame_indices[order], values[order])

    def _hold(self, frame_indices: Int64s, values: Floats) -> None:
        self._frame_indices, self._values = frame_indices, values
        self.has_steps = len(values) > 1  # whether it has more than one value at the frames that may be asked about

    def at(self, frame_indices: Int64s) -> Floats:
        """The values (n,) that held when the frames `frame_indices` (n,) came; one for all, where there is no other."""
        if not self.has_steps:
            return np.full(len(frame_indices), self._values[0])
        return np.asarray(self._values[np.searchsorted(self._frame_indices, frame_indices, side="right") - 1])

    @property
    def latest(self) -> float:
        """The value that holds from the last frame on."""
        return float(self._values[-1])

    def is_always(self, value: float) -> bool:
        """Whether it is this value at all frames that may be asked about."""
        return not self.has_steps and bool(self._values[0] == value)

    @property
    def steps(self) -> tuple[Int64s, Floats]:
        """From which frames on (k,) which values (k,) hold: for `held_at`."""
        return self._frame_indices, self._values

    def forget(self, frame_index: int) -> None:
        """Nothing will be asked about frames before this one."""
        if not self.has_steps:
            return
        passed = int(np.searchsorted(self._frame_indices, frame_index, side="right")) - 1
        self._hold(self._frame_indices[passed:], self._values[passed:])


@helper
def held_at(steps: Any, frame_index: Any) -> Any:
    """As `StepSignal.at`, in a kernel that is given its `steps`: the value that held when one frame came."""
    frame_indices, values = steps
    row = frame_indices.size - 1
    while row > 0 and frame_indices[row] > frame_index:
        row -= 1
    return values[row]


def parameters(records: npt.NDArray[np.void], frame_indices: Int64s, autopilot: str) -> Iterator[ParameterSet]:
    """PARAM_VALUE messages. PX4 sends an integer's bits in the float's place, ArduPilot its value (MAVLink docs)."""
    for record, frame_index in zip(records, frame_indices.tolist(), strict=True):
        name = _words(record["param_id"])
        value = float(record["param_value"])
        bits = _INTEGER_BITS.get(int(record["param_type"])) if autopilot == "px4" else None
        if bits is not None:
            value = float(struct.unpack(bits, record["param_value"].tobytes())[0])
        yield ParameterSet(frame_index, name, value)


_INTEGER_BITS = {1: "<Bxxx", 2: "<bxxx", 3: "<Hxx", 4: "<hxx", 5: "<I", 6: "<i"}  # MAV_PARAM_TYPE


def text_of(record: Any) -> str:
    """The text of a STATUSTEXT, as far as this one frame carries it."""
    return _words(record["text"])


def _words(field: Any) -> str:
    """What a field of characters says, up to its end or the first zero."""
    return one_line(bytes(field).split(b"\0")[0].decode("utf-8", "replace"))
