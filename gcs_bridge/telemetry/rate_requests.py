"""Who asked for other rates of the two attitude streams, as the link shows it, and who undoes whose wish.

Stations ask by REQUEST_DATA_STREAM, by MAV_CMDSET_MESSAGE_INTERVAL or by setting a parameter of the stream's rate. A
vehicle may refuse; a rate that was asked for is all the same no fault of its own.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from gcs_bridge.mavlink.decode import decode
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.packer import SET_MESSAGE_INTERVAL
from gcs_bridge.telemetry.messages import KIND, REQUESTS
from gcs_bridge.telemetry.samples import STREAMS
from gcs_bridge.telemetry.sorting import Share, SortedFrames
from gcs_bridge.telemetry.statements import ParameterSet

Address = tuple[int, int]

# MAV_DATA_STREAM_ALL, and _EXTRA1: "dependent on the autopilot", and the attitude on all that have it.
_ATTITUDE_STREAMS = (0, 10)
_BOTH = tuple(range(len(STREAMS)))
# ArduPilot's parameter of EXTRA1's rate, Hz, one a link; since 4.7 by the other name.
_RATE_PARAMETER = re.compile(r"(SR\d+|MAV\d+)_EXTRA1")


class RateRequest(NamedTuple):
    """Somebody asked a vehicle for another rate of the streams, by their index.

    `rate_hz` 0: none at all, None: the firmware's own. `by` None: a parameter changed, and who set it was not seen.
    """

    frame_index: int
    t_rx_us: int
    target: Address  # 0: all
    by: Address | None
    how: str
    streams: tuple[int, ...]
    rate_hz: float | None

    def is_for(self, vehicle: Address) -> bool:
        """Whether the vehicle is asked."""
        return all(asked in (0, own) for asked, own in zip(self.target, vehicle, strict=True))


class RateChange(NamedTuple):
    """A request for another rate than was asked for last.

    `instead_of`: who had asked for that, another station; `undo_each_other`: and it did so instead of this one's wish.
    """

    request: RateRequest
    instead_of: Address | None
    undo_each_other: bool


def rate_requests(batch: SortedFrames, share: Share, dialect: Dialect) -> list[RateRequest]:
    """What one component asked for in a batch, in order of arrival."""
    found: list[RateRequest] = []
    for name in REQUESTS:
        if name not in dialect or not share.counts[KIND[name]]:
            continue
        rows = batch.rows(share, KIND[name])
        sent = decode(batch.buffer, np.take(batch.frames, rows), dialect[name])
        times = batch.frames["t_rx_us"][rows].tolist()
        for frame_index, t_rx_us, fields in zip((batch.first + rows).tolist(), times, sent, strict=True):
            asked = _ASKED[name](fields)
            if asked is not None:
                target = int(fields["target_system"]), int(fields["target_component"])
                found.append(RateRequest(frame_index, t_rx_us, target, share.address, *asked))
    return sorted(found, key=lambda one: one.frame_index)


Asked = tuple[str, tuple[int, ...], float | None]


def _by_data_stream(fields: Any) -> Asked | None:
    if int(fields["req_stream_id"]) not in _ATTITUDE_STREAMS:
        return None
    return "REQUEST_DATA_STREAM", _BOTH, float(fields["req_message_rate"]) if fields["start_stop"] else 0.0


def _by_command(fields: Any) -> Asked | None:
    message, interval_us = float(fields["param1"]), float(fields["param2"])
    if int(fields["command"]) != SET_MESSAGE_INTERVAL or message not in _STREAM_OF_ID:
        return None
    return "SET_MESSAGE_INTERVAL", (_STREAM_OF_ID[message],), rate_of_interval(interval_us)


def rate_of_interval(interval_us: float) -> float | None:
    """The rate in Hz that an interval of SET_MESSAGE_INTERVAL asks for; 0: none at all, None: the firmware's own."""
    return None if interval_us == 0 or not np.isfinite(interval_us) else max(1e6 / interval_us, 0.0)  # −1: none


def _by_parameter(fields: Any) -> Asked | None:
    name = bytes(fields["param_id"]).split(b"\0")[0].decode("ascii", "replace")
    return (name, _BOTH, float(fields["param_value"])) if _RATE_PARAMETER.fullmatch(name) else None


_STREAM_OF_ID = {30.0: 0, 31.0: 1}  # by the messages' ids
_ASKED = {
    "REQUEST_DATA_STREAM": _by_data_stream,
    "COMMAND_LONG": _by_command,
    "COMMAND_INT": _by_command,
    "PARAM_SET": _by_parameter,
}


class RateWishes:
    """What was asked of one vehicle."""

    def __init__(self) -> None:
        """Start with nothing asked."""
        self._last: dict[int, RateRequest] = {}  # by stream
        self._before: dict[int, RateRequest] = {}  # whose wish that one undid
        self._said: dict[tuple[Address | None, str], tuple[tuple[int, ...], float | None]] = {}
        self._parameters: dict[str, float] = {}

    def take(self, requests: Iterable[RateRequest], parameters: Iterable[ParameterSet]) -> Iterator[RateChange]:
        """Follow the next requests, and what the vehicle's parameters are; yield those that ask for something else."""
        told: list[RateRequest | ParameterSet] = [*requests, *parameters]
        for one in sorted(told, key=lambda one: one.frame_index):
            request = self._of_parameter(one) if isinstance(one, ParameterSet) else one
            if request is not None and not self._is_known(request):
                yield self._change(request)

    def _of_parameter(self, said: ParameterSet) -> RateRequest | None:
        """A parameter that is not what it was; what is told first is no change."""
        if not _RATE_PARAMETER.fullmatch(said.name):
            return None
        known = self._parameters.get(said.name)
        self._parameters[said.name] = said.value
        if known is None or known == said.value:
            return None
        return RateRequest(said.frame_index, -1, (0, 0), None, said.name, _BOTH, said.value)

    def _is_known(self, request: RateRequest) -> bool:
        """Whether that is what was asked for last, or what the parameter is already."""
        if request.by is not None and _RATE_PARAMETER.fullmatch(request.how) and request.rate_hz is not None:
            known = self._parameters.get(request.how)
            self._parameters[request.how] = request.rate_hz
            if known == request.rate_hz:
                return True
        last = [self._last.get(stream) for stream in request.streams]
        who, what = (request.by, request.how), (request.streams, request.rate_hz)
        said, self._said[who] = self._said.get(who), what
        if said == what and all(one is not None and one.by == request.by for one in last):
            return True  # stations that say it again and again, whatever else they ask for beside it
        return all(one is not None and one.rate_hz == request.rate_hz for one in last)

    def _change(self, request: RateRequest) -> RateChange:
        instead_of, undo_each_other = None, False
        for stream in request.streams:
            last = self._last.get(stream)
            if last is not None and last.rate_hz != request.rate_hz and last.by != request.by:
                before = self._before.get(stream)
                instead_of = instead_of or last.by
                undo_each_other |= before is not None and before.by == request.by
                self._before[stream] = last
            self._last[stream] = request
        return RateChange(request, instead_of, undo_each_other and instead_of is not None)
