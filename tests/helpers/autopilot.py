"""An autopilot made by hand that takes commands: packed and read by pymavlink, in any time that it is told."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

ATTITUDE, QUATERNION, RAW_IMU, HIGHRES_IMU = 30, 31, 27, 105
ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED = 0, 1, 2, 3
_SET_INTERVAL, _GET_INTERVAL = 511, 510


@dataclass
class Autopilot:
    """Sends its messages at `rates_hz`; `results` says how it answers a wish for one of them."""

    system: int = 1
    component: int = 1
    autopilot: int = 3  # MAV_AUTOPILOT_ARDUPILOTMEGA
    rates_hz: dict[int, float] = field(default_factory=lambda: {ATTITUDE: 4.0, QUATERNION: 4.0, RAW_IMU: 4.0})
    results: dict[int, int] = field(default_factory=dict)
    answers: bool = True
    tells_intervals: bool = True
    knows_none: bool = False  # and says so
    limit_hz: float = 1000.0  # what its link takes
    off_deg: float = 0.0  # of the quaternion's heading: a fault
    received: list[Any] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._mav = mavlink.MAVLink(None, srcSystem=self.system, srcComponent=self.component)
        self._next_s: dict[int, float] = {}
        self._waiting: list[bytes] = []

    def take(self, data: bytes) -> None:
        """Bytes of a ground station."""
        for message in self._parser.parse_buffer(data) or ():
            self.received.append(message)
            if message.get_type() == "COMMAND_LONG" and message.target_system in (0, self.system):
                self._command(message)

    def commands(self, command: int = _SET_INTERVAL) -> list[tuple[int, float]]:
        """What it was asked so far: message and interval, µs."""
        return [
            (int(one.param1), one.param2)
            for one in self.received
            if one.get_type() == "COMMAND_LONG" and one.command == command
        ]

    def due(self, now_s: float) -> list[bytes]:
        """The frames that it sends by now."""
        frames, self._waiting = self._waiting, []
        for msgid, rate_hz in {0: 1.0, **self.rates_hz}.items():
            rate_hz = min(rate_hz, self.limit_hz)
            at_s = self._next_s.setdefault(msgid, now_s)
            while rate_hz and at_s <= now_s:
                frames.append(self._pack(self._message(msgid, at_s)))
                at_s += 1 / rate_hz
                self._next_s[msgid] = at_s
            if not rate_hz:
                self._next_s[msgid] = now_s
        return frames

    def say(self, message: Any) -> None:
        """Send a message of one's own beside."""
        self._waiting.append(self._pack(message))

    def _command(self, message: Any) -> None:
        if not self.answers:
            return
        msgid = int(message.param1)
        result = ACCEPTED
        if message.command == _SET_INTERVAL:
            result = self.results.get(msgid, ACCEPTED if msgid in self.rates_hz else UNSUPPORTED)
            if result == ACCEPTED:
                self.rates_hz[msgid] = 1e6 / message.param2
        elif message.command != _GET_INTERVAL or not self.tells_intervals:
            result = UNSUPPORTED
        self.say(
            mavlink.MAVLink_command_ack_message(
                message.command, result, 0, 0, message.get_srcSystem(), message.get_srcComponent()
            )
        )
        if message.command == _GET_INTERVAL and result == ACCEPTED:
            rate_hz = self.rates_hz[msgid]
            interval_us = 0 if self.knows_none else round(1e6 / rate_hz) if rate_hz else -1
            self.say(mavlink.MAVLink_message_interval_message(msgid, interval_us))

    def _message(self, msgid: int, at_s: float) -> Any:
        boot_ms, half_rad = round(10_000 + at_s * 1000), math.radians(self.off_deg) / 2
        messages: dict[int, Callable[[], Any]] = {
            0: lambda: mavlink.MAVLink_heartbeat_message(2, self.autopilot, 81, 0, 4, 3),
            ATTITUDE: lambda: mavlink.MAVLink_attitude_message(boot_ms, 0, 0, 0, 0, 0, 0),
            QUATERNION: lambda: mavlink.MAVLink_attitude_quaternion_message(
                boot_ms, math.cos(half_rad), 0, 0, math.sin(half_rad), 0, 0, 0
            ),
            RAW_IMU: lambda: mavlink.MAVLink_raw_imu_message(boot_ms * 1000, 0, 0, -1000, 0, 0, 0, 200, 0, 400),
            HIGHRES_IMU: lambda: mavlink.MAVLink_highres_imu_message(
                boot_ms * 1000, 0, 0, -9.8, 0, 0, 0, 0.2, 0, 0.4, 0, 0, 0, 0, 63
            ),
        }
        return messages[msgid]()

    def _pack(self, message: Any) -> bytes:
        frame = bytes(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256
        return frame


def setup_signing(system: int = 255, target: int = 1) -> bytes:
    """A SETUP_SIGNING frame, with a secret that is easily found."""
    message = mavlink.MAVLink_setup_signing_message(target, 1, list(b"SECRET" * 5 + b"!!"), 1)
    return bytes(message.pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=190)))


def station_message(message: Any, system: int = 255, component: int = 190, seq: int = 0) -> bytes:
    """A message of a ground station, packed."""
    mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    mav.seq = seq
    return bytes(message.pack(mav))
