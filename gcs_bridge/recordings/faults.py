"""What can be asked for: a mistake of the causes' table or a fault of the link, by name, with its value."""

from __future__ import annotations

import difflib
from dataclasses import dataclass

from gcs_bridge.diagnosis.causes import CAUSES
from gcs_bridge.diagnosis.mistake import Parameter, Value
from gcs_bridge.errors import UsageError
from gcs_bridge.recordings.link_faults import LINK_FAULTS

__all__ = ["Fault", "parse_fault"]


@dataclass(frozen=True)
class Fault:
    """A fault to be made: its name, its value in the unit of its row, and for `thin` the message.

    Raises UsageError where there is no such fault; values are looked at by `parse_fault` alone.
    """

    name: str
    value: Value
    message: str | None = None

    def __post_init__(self) -> None:
        _parameter_of(self.name)

    def __str__(self) -> str:
        """As `parse_fault` takes it, with the value that a default stands for.

        >>> print(parse_fault("yaw_offset"), parse_fault("thin:attitude=4"))
        yaw_offset:12 thin:ATTITUDE=4
        """
        numbers = ",".join(f"{number:.12g}" for number in self.value)
        message = f"{self.message}=" if self.message else ""
        return f"{self.name}:{message}{numbers}" if numbers else self.name


def parse_fault(text: str) -> Fault:
    """The fault that `NAME` (with its default value), `NAME:VALUE` or `thin:MESSAGE=HZ` asks for.

    Raises UsageError for an unknown name, with the nearest right one, and for a value that is wrong or out of range.

    >>> parse_fault("mount_offset:0,4,0")
    Fault(name='mount_offset', value=(0.0, 4.0, 0.0), message=None)
    >>> parse_fault("thin:ATTITUDE=10")
    Fault(name='thin', value=(10.0,), message='ATTITUDE')
    """
    name, colon, rest = text.partition(":")
    parameter = _parameter_of(name)
    message = None
    if name == "thin":
        message, equals, rest = rest.partition("=")
        if not (message and equals):
            raise UsageError(f"the fault thin cannot take {text!r}: it must be as thin:ATTITUDE_QUATERNION=10")
        message = message.upper()
    return Fault(name, parameter.parse(name, rest if colon else None), message)


def _parameter_of(name: str) -> Parameter:
    """What the value of the fault `name` may be; UsageError where there is no such fault."""
    known = {name: fault.parameter for name, fault in LINK_FAULTS.items()}
    known |= {cause.name: cause.parameter for cause in CAUSES.values() if cause.falsify is not None}
    if name in known:
        return known[name]
    if name in CAUSES:
        raise UsageError(f"{name} can be diagnosed but not injected")
    near = difflib.get_close_matches(name.lower(), known, n=1)
    hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known)}"
    raise UsageError(f"unknown fault {name!r}; {hint}")
