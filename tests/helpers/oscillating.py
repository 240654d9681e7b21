"""A vehicle that swings about one body axis as fast as you like, sampled by streams of their own rates and phases."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import all as mavlink
from scipy.spatial.transform import Rotation

from tests.helpers import wire
from tests.helpers.craft import (
    BOOT_S,
    G_M_S2,
    Array,
    Record,
    State,
    attitude,
    attitude_quaternion,
    raw_imu,
)
from tests.helpers.turn import Turn

Rates = Callable[[float, Array], Array]  # time, s, and the true rates, rad/s → what the gyro says


def swing(
    hz: float,
    deg_s: float,
    *,
    sampled_hz: float,
    imu_hz: float | None = None,
    place: float = 0.5,
    seconds: float = 45,
    span_s: tuple[float, float] = (15, 38),
    axis: int = 0,
    yaw_deg_s: float = 0.0,
    gyro: Rates = lambda _, rates: rates,
    quaternion: bool = False,
    imu_message: Callable[[int, State], Any] = raw_imu,
) -> list[Record]:
    """Records of a swing of ±`deg_s` at `hz` within `span_s`.

    ATTITUDE comes `sampled_hz` times a second, the IMU `imu_hz` times, `place` periods later.
    """
    imu_hz = imu_hz or sampled_hz
    ticks = [(1000 * i, "beat") for i in range(int(seconds))]
    ticks += [(round(1000 * i / sampled_hz), "attitude") for i in range(int(seconds * sampled_hz))]
    ticks += [(round(1000 * (i + place) / imu_hz), "imu") for i in range(int(seconds * imu_hz))]
    ticks.sort()
    t_s = np.array([ms for ms, _ in ticks]) / 1000
    w, rate = 2 * np.pi * hz, np.radians(deg_s)
    since_s, swings = t_s - span_s[0], (span_s[0] <= t_s) & (t_s < span_s[1])
    about = np.eye(3)[axis]
    swung = Rotation.from_rotvec(np.outer(swings * rate / w * np.sin(w * since_s), about))
    heading = np.outer(30 + yaw_deg_s * t_s, [1, 0, 0])
    rotation = Rotation.from_euler("ZYX", heading, degrees=True) * swung
    rates = np.outer(swings * rate * np.cos(w * since_s), about) + swung.inv().apply([0, 0, np.radians(yaw_deg_s)])
    rates += [1e-3, 5e-4, 0.0]
    force = rotation.inv().apply([0.0, 0.0, -G_M_S2])
    wxyz = wire.wxyz(rotation).tolist()

    beat = mavlink.MAVLink_heartbeat_message(wire.QUADROTOR, wire.ARDUPILOT, 81, 0, 4, 3)
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    records: list[Record] = []
    for i, (ms, kind) in enumerate(ticks):
        boot_ms = ms + round(1000 * BOOT_S)
        now = State(Turn(*wxyz[i]), rates[i], force[i])
        if kind == "beat":
            messages = [beat]
        elif kind == "attitude":
            messages = [attitude(boot_ms, now), *([attitude_quaternion(boot_ms, now)] if quaternion else [])]
        else:
            messages = [imu_message(boot_ms, now._replace(rates=gyro(ms / 1000, now.rates)))]
        for message in messages:
            sender.seq = len(records) % 256
            records.append((wire.START_US + 1000 * ms, bytes(message.pack(sender))))
    return records
