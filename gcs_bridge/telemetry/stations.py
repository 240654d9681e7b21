"""What a (system, component) is: by what most of its heartbeats say, by its number, and by the attitude that it sends.

A claimed autopilot alone makes no vehicle: onboard computers, cameras, gimbals and sensors claim some, or "generic".
The kinds and the numbers are MAVLink's (common.xml, minimal.xml: MAV_TYPE, MAV_COMPONENT).
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from gcs_bridge.columns import Int64Rows, Int64s, Records
from gcs_bridge.jit import kernel
from gcs_bridge.mavlink.decode import place_of, unsigned_in
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.scan import Bytes, Frames
from gcs_bridge.telemetry.messages import KIND
from gcs_bridge.telemetry.sorting import Share, SortedFrames

AUTOPILOT_INVALID = 8  # MAV_AUTOPILOT_INVALID: not a flight controller
_AUTOPILOTS = frozenset({3, 12})  # ArduPilot, PX4: who names one of these is no sensor with a made-up heartbeat
# MAV_TYPE: what moves, and has an attitude of its own. An antenna tracker turns by an autopilot of its own.
_AIRFRAMES = frozenset({*range(1, 6), *range(7, 18), *range(19, 26), 28, 29, 35, 43, 45, 46, 47})
# MAV_TYPE: ground station, onboard controller, gimbal, ADS-B, camera, charging station, FLARM, servo, ODID, battery,
# parachute, log, OSD, IMU, GPS, winch, illuminator, gripper.
_NO_VEHICLES = frozenset({6, 18, 26, 27, 30, 31, 32, 33, 34, 36, 37, 38, 39, 40, 41, 42, 44, 48})
# MAV_COMPONENT: radio; cameras; servos; gimbals, logs, OSDs, peripherals, winches; batteries; ground stations, onboard
# computers, planners; IMUs; GPS; ODID; bridges, tunnels, lights.
_PERIPHERALS = frozenset(
    {68, *range(100, 106), *range(140, 162), 169, *range(171, 176), 180, 181, *range(189, 199), *range(200, 203)}
    | {220, 221, *range(236, 239), *range(240, 244)}
)
_AUTOPILOT_ID = 1  # MAV_COMP_ID_AUTOPILOT1

_ROOM = 16  # kinds of heartbeats that are counted; one component that sends more is none of them
_VOTES = np.dtype(
    [
        ("kinds", "i8"),  # so far
        ("kind", "i8", (_ROOM,)),  # autopilot · 256 + type
        ("count", "i8", (_ROOM,)),
        ("leads", "i8"),  # which of them most heartbeats have, −1: none came
    ]
)


class Majority(NamedTuple):
    """From the frame `frame_index` on most heartbeats of a component say this, by MAVLink's numbers."""

    frame_index: int
    t_rx_us: int
    autopilot: int
    type: int


@kernel
def _count(
    votes: Annotated[Records, _VOTES],
    frames: Frames,
    buffer: Bytes,
    by_message: Int64s,
    start: int,
    end: int,
    type_at: int,
    autopilot_at: int,
    changes: Int64Rows,
) -> int:
    """Count the heartbeats from `start` to `end` of `by_message`; return how often another kind came to lead."""
    of, n = votes[0], 0
    for i in range(start, end):
        row = by_message[i]
        payload = (buffer, np.int64(frames[row].payload), np.int64(frames[row].length))
        kind = unsigned_in(payload, autopilot_at, 1) * 256 + unsigned_in(payload, type_at, 1)
        mine = 0
        while mine < of.kinds and of.kind[mine] != kind:
            mine += 1
        if mine == _ROOM:
            continue
        if mine == of.kinds:
            of.kind[mine] = kind
            of.kinds += 1
        of.count[mine] += 1
        if of.leads < 0 or (mine != of.leads and of.count[mine] > of.count[of.leads]):
            of.leads = mine
            changes[n, 0], changes[n, 1] = row, kind
            n += 1
    return n


class Heartbeats:
    """What most heartbeats of one component say; of two that are as many, what was said first."""

    def __init__(self, dialect: Dialect) -> None:
        """Start with none heard."""
        self._type_at, self._autopilot_at = (place_of(dialect["HEARTBEAT"], name)[0] for name in ("type", "autopilot"))
        self._votes = np.zeros(1, _VOTES)
        self._votes["leads"] = -1

    def read(self, batch: SortedFrames, share: Share) -> list[Majority]:
        """Take a component's next heartbeats; what most of them say, wherever that became something else."""
        count = share.counts[KIND["HEARTBEAT"]]
        if not count:
            return []
        changes = np.empty((count, 2), np.int64)
        start, end = share.starts[KIND["HEARTBEAT"] : KIND["HEARTBEAT"] + 2]
        n = _count(
            self._votes,
            batch.frames,
            batch.buffer,
            batch.by_message,
            start,
            end,
            self._type_at,
            self._autopilot_at,
            changes,
        )
        return [
            Majority(batch.first + row, int(batch.frames["t_rx_us"][row]), kind >> 8, kind & 0xFF)
            for row, kind in changes[:n].tolist()
        ]


def is_vehicle(compid: int, said: Majority | None, *, sends_attitude: bool) -> bool | None:
    """Whether a component is a vehicle, by what most of its heartbeats say; None: that is not known yet.

    `sends_attitude`: it sent a plausible run of attitudes. That decides of what the heartbeats leave open: without any,
    with a type that says nothing, without an autopilot, or under a number that is kept for other things.
    """
    peripheral = compid in _PERIPHERALS
    if said is None:
        return not peripheral if sends_attitude else None
    if said.type in _NO_VEHICLES:
        return False
    if said.type in _AIRFRAMES:
        if said.autopilot != AUTOPILOT_INVALID and not peripheral:
            return True
    elif said.autopilot in _AUTOPILOTS and compid == _AUTOPILOT_ID:
        return True
    elif peripheral:
        return False
    return (said.autopilot != AUTOPILOT_INVALID or not peripheral) if sends_attitude else None
