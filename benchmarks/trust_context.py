"""What goes on around the attitudes on links that are in use: nothing of it is a fault of the vehicle."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from itertools import count

import numpy as np
from pymavlink.dialects.v20 import all as mavlink

from gcs_bridge.mavlink.dialect import load_dialect
from gcs_bridge.mavlink.scanner import RawFrame, Scanner

SUSPENDED_S = 10.0
TRANSFER_S = 8.0
COPY_S = 0.003
_VERSION_2 = 0xFD


def suspended(t_rx_us: np.ndarray) -> np.ndarray:
    """From the middle on all comes so much later: the receiver slept, and then took what had waited."""
    middle_us = (t_rx_us.min() + t_rx_us.max()) // 2
    return t_rx_us + np.where(t_rx_us > middle_us, round(SUSPENDED_S * 1e6), 0)


def frames_of(data: bytes) -> tuple[np.ndarray, list[RawFrame]]:
    """The frames of a recording, as the scan describes them and byte for byte."""
    scanner = Scanner(load_dialect("all"), timed=True)
    scanner.scan(data, final=True)
    return scanner.all_frames, scanner.raw_frames()


def twice(data: bytes) -> list[RawFrame]:
    """Each frame comes again a moment later, as by two routes."""
    _, frames = frames_of(data)
    copies = [RawFrame(frame.t_rx_us + round(COPY_S * 1e6), frame.data) for frame in frames]
    return sorted([*frames, *copies], key=lambda frame: frame.t_rx_us)


def transfer(data: bytes, instead_of: Collection[str]) -> list[RawFrame]:
    """In the middle parameters are sent for some seconds, each in place of one of these messages."""
    found, frames = frames_of(data)
    dialect = load_dialect("all")
    asked = np.isin(found["msgid"], [dialect[name].msgid for name in instead_of])
    times = found["t_rx_us"]
    middle_us = (times.min() + times.max()) // 2
    inside = asked & (abs(times - middle_us) < round(TRANSFER_S * 5e5))
    return [
        RawFrame(frame.t_rx_us, _parameter(frame.data, one)) if is_inside else frame
        for frame, one, is_inside in zip(frames, found, inside.tolist(), strict=True)
    ]


def _parameter(frame: bytes, of: np.void) -> bytes:
    """A PARAM_VALUE with the sender and the number of a frame."""
    link = mavlink.MAVLink(None, srcSystem=int(of["sysid"]), srcComponent=int(of["compid"]))
    link.seq = int(of["seq"])
    name = f"TELLS_NOTHING{of['seq'] % 100}".encode()
    message = mavlink.MAVLink_param_value_message(name, 1.0, 9, 900, int(of["seq"]))
    packed: bytes = message.pack(link, force_mavlink1=frame[0] != _VERSION_2)
    return packed


def companion(data: bytes) -> list[RawFrame]:
    """An onboard computer and a camera beside each vehicle say each second that they are there."""
    found, frames = frames_of(data)
    dialect = load_dialect("all")
    flying = {int(one["sysid"]) for one in found[found["msgid"] == dialect["ATTITUDE"].msgid]}
    beats = [beat for sysid in flying for beat in _beats(sysid, found["t_rx_us"])]
    return sorted([*frames, *beats], key=lambda frame: frame.t_rx_us)


def _beats(sysid: int, times_us: np.ndarray) -> Iterator[RawFrame]:
    for compid, kind in ((191, mavlink.MAV_TYPE_ONBOARD_CONTROLLER), (100, mavlink.MAV_TYPE_CAMERA)):
        link, number = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=compid), count()
        for t_rx_us in range(int(times_us.min()), int(times_us.max()), 1_000_000):
            link.seq = next(number) % 256
            beat = mavlink.MAVLink_heartbeat_message(kind, mavlink.MAV_AUTOPILOT_GENERIC, 0, 0, 4, 3)
            yield RawFrame(t_rx_us, beat.pack(link))
