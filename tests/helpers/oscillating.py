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
    rpy,
)

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
    w, rate = 2 * np.pi * hz, np.radians(deg_s)

    def state(t_s: float) -> State:
        angle, rates = np.zeros(3), np.zeros(3)
        if span_s[0] <= t_s < span_s[1]:
            angle[axis] = rate / w * np.sin(w * (t_s - span_s[0]))
            rates[axis] = rate * np.cos(w * (t_s - span_s[0]))
        swung = Rotation.from_rotvec(angle)
        rotation = rpy(yaw=30 + yaw_deg_s * t_s) * swung
        turning = swung.inv().apply([0, 0, np.radians(yaw_deg_s)])
        force = rotation.inv().apply([0.0, 0.0, -G_M_S2])
        return State(rotation, rates + turning + np.array([1e-3, 5e-4, 0.0]), force)

    beat = mavlink.MAVLink_heartbeat_message(wire.QUADROTOR, wire.ARDUPILOT, 81, 0, 4, 3)
    ticks = [(1000 * i, "beat") for i in range(int(seconds))]
    ticks += [(round(1000 * i / sampled_hz), "attitude") for i in range(int(seconds * sampled_hz))]
    ticks += [(round(1000 * (i + place) / imu_hz), "imu") for i in range(int(seconds * imu_hz))]
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    records: list[Record] = []
    for ms, kind in sorted(ticks):
        now, boot_ms = state(ms / 1000), ms + round(1000 * BOOT_S)
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
