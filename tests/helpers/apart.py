"""A vehicle by hand whose two attitudes never carry one stamp, with what its firmware does to ATTITUDE on purpose.

Its motion is known exactly, so each message is of the very instant that it is stamped with. Turned by SciPy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import all as mavlink
from scipy.spatial.transform import Rotation

from tests.helpers import wire
from tests.helpers.craft import BOOT_S, G_M_S2, Array, Record, parameter, raw_imu
from tests.helpers.craft import State as Told
from tests.helpers.turn import Turn

PLANE, QUADROTOR = 1, 2  # MAV_TYPE
Motion = Callable[[float], tuple[float, float, float]]  # s → roll, pitch, yaw, deg
Fault = Callable[[Array, Rotation], Rotation]  # s, the true attitudes → what the quaternion says


def weaving(roll: float = 25.0, pitch: float = 4.0, yaw_deg_s: float = 8.0, period_s: float = 6.0) -> Motion:
    """Banks to both sides, the nose up and down, and a slow turn; level in the first five seconds."""

    def at(t_s: float) -> tuple[float, float, float]:
        t = max(t_s - 5.0, 0.0)
        w = 2 * np.pi / period_s
        return roll * np.sin(w * t), 2.0 + pitch * np.sin(0.7 * w * t), yaw_deg_s * t_s

    return at


def level(pitch: float = 2.0, yaw_deg_s: float = 0.0) -> Motion:
    """Straight on, the nose a little up and down."""
    return lambda t_s: (0.2 * np.sin(t_s), pitch + 1.0 * np.sin(0.8 * t_s), yaw_deg_s * t_s)


@dataclass(frozen=True, kw_only=True)
class Apart:
    """What it flies and how it sends: each quaternion `apart_ms` behind its ATTITUDE, both at `hz`.

    `pitch_trim_deg` and `ahrs_trim_deg` are its parameters, told only if `told_s` says when; `view_deg` the pitch of
    the view in VTOL modes. `modes`: (second, custom mode). `fault` falsifies the quaternion.
    """

    motion: Motion
    hz: float = 10.0
    apart_ms: int = 30
    kind: int = QUADROTOR
    modes: Sequence[tuple[float, int]] = ((0.0, 0),)
    hovers: Callable[[float], bool] = lambda _: False
    pitch_trim_deg: float = 0.0
    ahrs_trim_deg: tuple[float, float] = (0.0, 0.0)
    view_deg: float = 0.0
    fault: Fault | None = None
    imu: bool = False
    armed: bool = True

    def true(self, t_s: Array) -> Rotation:
        """The attitudes that the estimator has, of the board."""
        rpy_deg = np.array([self.motion(t) for t in t_s.tolist()])
        return Rotation.from_euler("ZYX", rpy_deg[:, ::-1], degrees=True)

    def rates(self, t_s: Array) -> Array:
        """Body rates, rad/s."""
        step = 1e-4
        turn: Array = (self.true(t_s - step).inv() * self.true(t_s + step)).as_rotvec() / (2 * step)
        return turn

    def euler(self, t_s: Array) -> Array:
        """Roll, pitch and yaw as ArduPilot sends them, rad."""
        x, y = np.radians(self.ahrs_trim_deg)
        true, hovers = self.true(t_s), np.array([self.hovers(t) for t in t_s.tolist()])
        viewed = true * Rotation.from_euler("y", -self.view_deg, degrees=True)
        flown = true.as_euler("ZYX") - [0.0, y + np.radians(self.pitch_trim_deg), x]
        shown: Array = np.where(hovers[:, None], viewed.as_euler("ZYX"), flown)
        return shown[:, ::-1]

    def quaternion(self, t_s: Array) -> Rotation:
        """The attitudes as the quaternion has them."""
        x, y = self.ahrs_trim_deg
        sent = self.true(t_s) * Rotation.from_rotvec([-x, -y, 0.0], degrees=True)
        return sent if self.fault is None else self.fault(t_s, sent)

    def records(self, seconds: float) -> list[Record]:
        """(record time, frame) of so many seconds."""
        sender, found = mavlink.MAVLink(None, srcSystem=1, srcComponent=1), list[Record]()

        def send(ms: int, message: Any) -> None:
            sender.seq = len(found) % 256
            found.append((wire.START_US + 1000 * ms, bytes(message.pack(sender))))

        times_ms = np.rint(1000 * np.arange(int(seconds * self.hz)) / self.hz).astype(int)
        t_s = 1e-3 * times_ms
        late_s = t_s + 1e-3 * self.apart_ms
        euler, rates, board = self.euler(t_s), self.rates(t_s), self.true(t_s)
        quaternion, late_rates = wire.wxyz(self.quaternion(late_s)), self.rates(late_s)
        force, board_wxyz = board.inv().apply([0.0, 0.0, -G_M_S2]), wire.wxyz(board).tolist()
        boot_ms, beat = round(1000 * BOOT_S), 0
        for i, ms in enumerate(times_ms.tolist()):
            if ms >= beat:
                mode = [mode for since_s, mode in self.modes if since_s <= 1e-3 * ms][-1]
                base = 81 | 128 * self.armed
                send(ms, mavlink.MAVLink_heartbeat_message(self.kind, wire.ARDUPILOT, base, mode, 4, 3))
                beat += 1000
            send(ms, mavlink.MAVLink_attitude_message(boot_ms + ms, *euler[i], *rates[i]))
            if self.imu:
                send(ms, raw_imu(boot_ms + ms, Told(Turn(*board_wxyz[i]), rates[i], force[i])))
            late = ms + self.apart_ms
            said = (*quaternion[i], *late_rates[i], [0, 0, 0, 0])
            send(late, mavlink.MAVLink_attitude_quaternion_message(boot_ms + late, *said))
        return found


def told(*, at_s: float, **values: float) -> list[Record]:
    """Parameters, told one after the other."""
    ms = round(1000 * at_s)
    return [
        (wire.START_US + 1000 * (ms + i), wire.pack(parameter(name, value), seq=i))
        for i, (name, value) in enumerate(values.items())
    ]


def yawed(deg: float, from_s: float) -> Fault:
    """A yaw offset from some time on."""
    return lambda t_s, sent: Rotation.from_rotvec(np.outer(t_s >= from_s, [0.0, 0.0, deg]), degrees=True) * sent


def mounted(*deg: float, from_s: float = 0.0) -> Fault:
    """A mount offset from some time on."""
    return lambda t_s, sent: sent * Rotation.from_rotvec(np.outer(t_s >= from_s, deg), degrees=True)
