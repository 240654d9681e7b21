"""What a mistake is: how it is made and undone, by which value, in which message, and what to tell its owner."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy.typing as npt

from gcs_bridge.errors import UsageError

Value = tuple[float, ...]
"""The numbers of a fault, in the unit of its row; none for a mistake that is made or not."""
Array = npt.NDArray[Any]  # float64, but for payloads
Change = Callable[[Array, Value], Array]
"""(samples, value) → samples of the same shape; the arguments stay as they are."""


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """What a fault's value may be: so many numbers, each in [least, most], in `unit`; `default` None: must be given.

    Several numbers are a vector, and its length is at most `most` as well.
    """

    unit: str = ""
    default: Value | None = None
    count: int = 1
    least: float = -math.inf
    most: float = math.inf
    whole: bool = False

    def parse(self, fault: str, text: str | None) -> Value:
        """The value that `text` gives to `fault` (numbers with commas between them; None: nothing was given).

        Raises UsageError, whose one line says what would be right.
        """
        if text is None and self.default is not None:
            return self.default
        try:
            value = tuple(float(number) for number in (text or "").split(","))
        except ValueError:
            value = ()
        if len(value) == self.count > 0 and self._allows(value):
            return value
        given = "needs a value" if text is None else f"cannot take the value {text!r}"
        raise UsageError(f"the fault {fault} {given}: it {'must be' if self.count else 'takes'} {self.allowed(fault)}")

    def _allows(self, value: Value) -> bool:
        """Whether the numbers are in range; NaN never is."""
        in_range = all(self.least <= number <= self.most for number in value)
        short = self.count == 1 or math.hypot(*value) <= self.most
        return in_range and short and not (self.whole and any(number % 1 for number in value))

    def allowed(self, fault: str) -> str:
        """In words, what the value of `fault` may be."""
        if self.count == 0:
            return "none"
        kind = "whole number" if self.whole else "number"
        unit = f" {self.unit}" if self.unit else ""
        if self.count > 1:
            example = ",".join(f"{number:g}" for number in self.default or ())
            return f"{self.count} {kind}s, a vector of at most {self.most:g}{unit}, as {fault}:{example}"
        if math.isinf(self.most):
            return f"a {kind}, {self.least:g}{unit} or more"
        return f"a {kind} from {self.least:g} to {self.most:g}{unit}"


NO_VALUE = Parameter(default=(), count=0)


@dataclass(frozen=True, kw_only=True)
class Cause:
    """One mistake: what it does to the samples of the message at fault, and what to tell its owner.

    `acts_on` says which samples `falsify` takes, as they should be, and returns, as they are sent; `undo` is its exact
    inverse, and None where what was lost cannot come back. In `fix`, `{value}` stands for the value with its unit.
    Samples:

    - "quaternion": (N, 4), q_nb `[w, x, y, z]`
    - "rpy": (N, 3), roll, pitch, yaw, rad
    - "time": (N,), time since boot, ms, neither wrapped nor rounded
    - "rates": (N, 6), roll, pitch, yaw, rad, and the body rates, rad/s, of which the latter alone are falsified; both
      messages carry the same rates, so both are at fault
    - "payload": (N, …), whatever the message carries beside its time, in the order of time
    - None: nothing that one message carries; such a cause is only named, never made
    """

    name: str
    message: Literal[30, 31] | None
    acts_on: Literal["quaternion", "rpy", "rates", "time", "payload"] | None
    falsify: Change | None = None
    undo: Change | None = None
    parameter: Parameter = NO_VALUE
    fix: str
    origin: str

    @property
    def messages(self) -> tuple[int, ...]:
        """The messages that it falsifies."""
        return (30, 31) if self.acts_on == "rates" else () if self.message is None else (self.message,)

    @property
    def unit(self) -> str:
        """The unit of the value, empty for a bare number and for none."""
        return self.parameter.unit
