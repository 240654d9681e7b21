"""Every wish for a rate that a component sent, of whatever message or stream: who asks whom for what, and how often.

What such wishes mean for the two attitude streams is said in `rate_requests`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge.errors import one_line
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.packer import SET_MESSAGE_INTERVAL
from gcs_bridge.telemetry.rate_requests import Address, rate_of_interval

__all__ = ["ASKS", "Ask", "asks_in"]
# ArduPilot's parameters of its streams' rates, Hz, one a link; since 4.7 by the other name.
_RATE_PARAMETER = re.compile(
    r"(SR\d+|MAV\d+)_(RAW_SENS|EXT_STAT|RC_CHAN|RAW_CTRL|POSITION|EXTRA1|EXTRA2|EXTRA3|PARAMS|ADSB)"
)


class Ask(NamedTuple):
    """`by` asks `of` (0: all) for `what`, by `how`; `rate_hz` 0: none at all, None: the firmware's own."""

    by: Address
    of: Address
    how: str
    what: str
    rate_hz: float | None


def _by_data_stream(fields: Any, dialect: Dialect) -> tuple[str, str, float | None]:
    stream = dialect.enum_name("MAV_DATA_STREAM", int(fields["req_stream_id"])).upper()
    return "REQUEST_DATA_STREAM", stream, float(fields["req_message_rate"]) if fields["start_stop"] else 0.0


def _by_command(fields: Any, dialect: Dialect) -> tuple[str, str, float | None] | None:
    message, interval_us = float(fields["param1"]), float(fields["param2"])
    if int(fields["command"]) != SET_MESSAGE_INTERVAL or not 0 <= message < 2**24:
        return None
    name = dialect.name_of(int(message)) or f"message {int(message)}"
    return "SET_MESSAGE_INTERVAL", name, rate_of_interval(interval_us)


def _by_parameter(fields: Any, _: Dialect) -> tuple[str, str, float | None] | None:
    name = one_line(bytes(fields["param_id"]).split(b"\0")[0].decode("ascii", "replace"))
    return ("PARAM_SET", name, float(fields["param_value"])) if _RATE_PARAMETER.fullmatch(name) else None


ASKS = {
    "REQUEST_DATA_STREAM": _by_data_stream,
    "COMMAND_LONG": _by_command,
    "COMMAND_INT": _by_command,
    "PARAM_SET": _by_parameter,
}
"""The messages by which rates are asked for, and how each is read."""


def asks_in(name: str, by: Address, sent: npt.NDArray[np.void], dialect: Dialect) -> Iterator[Ask]:
    """The wishes in messages `name` (n,), decoded, of the component `by`."""
    for fields in sent:
        asked = ASKS[name](fields, dialect)
        if asked is not None:
            how, what, rate_hz = asked
            yield Ask(by, (int(fields["target_system"]), int(fields["target_component"])), how, what, rate_hz)
