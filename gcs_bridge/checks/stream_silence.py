"""How long a stream has been silent, and how long it may be.

A silence is counted in time in which the vehicle was heard, whatever message it was heard by: on its boot clock where
that is told, else on the link's clock. It counts from the last sample, or from the last message of a transfer, which
slows streams or stops them. The more frames are lost, the longer it must be to mean anything, and by as much as a radio
that runs out of buffer makes intervals longer.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from gcs_bridge.jit import helper

HEARD_US = 1_000_000  # of the time between two of the vehicle's messages, what it counts as heard
LOSS_MESSAGES = 256  # timed messages over which the loss is taken
_NEVER = math.log(1e-7)  # probability with which a silence is by chance
_MOST_PERIODS = 20.0  # that a silence needs, however much was lost
# So many messages of a transfer, each within so long behind the one before, are one. A slow radio brings one item of a
# mission in that time; single parameters that are told now and then are no transfer.
_TRANSFER, _TRANSFER_GAP_US = 2, 1_500_000


@helper
def hear(vehicle: Any, t_us: Any) -> Any:
    """Count the time in which the vehicle is heard: a silence of all of it is none of a stream."""
    if not vehicle.messages:
        vehicle.latest_us = t_us
    vehicle.heard_us += min(max(t_us - vehicle.latest_us, 0), max(vehicle.beside_us, HEARD_US))
    vehicle.latest_us = max(vehicle.latest_us, t_us)
    vehicle.beside_us = 0


@helper
def hear_frame(vehicle: Any, streams: Any, heard: Any, i: Any) -> Any:
    """Count the time in which the vehicle is heard by a frame of it, and begin each silence anew with a transfer."""
    at_us = heard.heard_us[i]
    if vehicle.link_us >= 0:
        vehicle.beside_us += min(max(at_us - vehicle.link_us, 0), HEARD_US)
    vehicle.link_us = at_us
    vehicle.restarting = heard.restarting[i]
    if heard.transfer[i]:
        vehicle.transfers = vehicle.transfers + 1 if at_us - vehicle.transfer_us <= _TRANSFER_GAP_US else 1
        vehicle.transfer_us = at_us
        if vehicle.transfers >= _TRANSFER:
            for stream in streams:
                stream.slowed = 1
                if not is_silent(stream, vehicle):  # what stopped before is no matter of the transfer
                    stream.heard_us = vehicle.heard_us + vehicle.beside_us


@helper
def take_slowdown(streams: Any, vehicle: Any, slowed: Any, longer_us: Any) -> Any:
    """A radio slows the streams, by so much an interval, or does no more."""
    vehicle.slowed, vehicle.longer_us = slowed, longer_us
    if slowed:
        for stream in streams:
            stream.slowed = 1


@helper
def is_slowed(vehicle: Any) -> Any:
    """Whether a transfer goes on, or a radio slows the streams."""
    is_recent = vehicle.link_us - vehicle.transfer_us <= _TRANSFER_GAP_US
    return vehicle.slowed != 0 or (vehicle.transfers >= _TRANSFER and is_recent)


@helper
def follow_loss(vehicle: Any, lost: Any, received: Any) -> Any:
    """How many periods of silence mean something, by the share of the vehicle's frames that was lost of late."""
    n = vehicle.messages
    at = n % LOSS_MESSAGES
    since = at if n >= LOSS_MESSAGES else 0
    missing, came = (lost - vehicle.lost[since], received - vehicle.received[since]) if n else (0, 0)
    vehicle.lost[at], vehicle.received[at] = lost, received
    vehicle.messages += 1
    share = min(max(missing / max(missing + came, 1), 1e-3), 0.9)
    if share != vehicle.lost_share:
        vehicle.lost_share = share
        vehicle.least_periods = max(vehicle.stale_periods, min(_NEVER / np.log(share), _MOST_PERIODS))


@helper
def silent_s(stream: Any, vehicle: Any) -> Any:
    """For how long the stream has been silent, in time in which the vehicle was heard."""
    if stream.frame_index < 0 or stream.period_us < 0:
        return 0.0
    return max(vehicle.heard_us + vehicle.beside_us - stream.heard_us, 0) * 1e-6


@helper
def silent_limit_s(stream: Any, vehicle: Any, period_us: Any) -> Any:
    """How long a silence of a stream of that period may be, at the share of frames that is lost."""
    period_us = max(period_us, stream.asked_period_us)
    return (max(vehicle.stale_after_us, vehicle.least_periods * period_us, 1.0) + vehicle.longer_us) * 1e-6


@helper
def is_silent(stream: Any, vehicle: Any) -> Any:
    """Whether it has been silent for too long, as the vehicle's frames tell that carry no time."""
    limit_s = silent_limit_s(stream, vehicle, max(stream.period_us, stream.rx_period_us))
    return silent_s(stream, vehicle) > limit_s
