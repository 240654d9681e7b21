"""Snapshots made by hand, for what draws them: turned by SciPy, never by our own package."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from msgspec.structs import replace
from scipy.spatial.transform import Rotation

from gcs_bridge.alarms.state import Announcement, State
from gcs_bridge.contract import Stream
from gcs_bridge.judging.snapshot import AlarmNow, AttitudeNow, CheckNow, LinkNow, Snapshot, VehicleNow
from gcs_bridge.screen.alerts import AlertKey, alerts_of, id_of
from gcs_bridge.screen.canvas import Canvas
from gcs_bridge.screen.memory import Memory
from gcs_bridge.screen.page import Scene, draw_page
from tests.helpers.wire import wxyz


def quaternion(roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0) -> tuple[float, float, float, float]:
    """w, x, y, z of these angles, deg."""
    w, x, y, z = wxyz(Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True)).tolist()
    return w, x, y, z


def attitude(rpy_deg: Sequence[float], *, euler: bool, **more: Any) -> AttitudeNow:
    roll, pitch, yaw = rpy_deg
    sent = AttitudeNow(
        t_boot_s=20.0,
        age_s=0.1,
        alive=True,
        valid=True,
        q_nb=quaternion(roll, pitch, yaw),
        rpy_rad=(np.radians(roll), np.radians(pitch), np.radians(yaw)) if euler else None,
        w_nb_b_rad_s=(np.radians(1.0), np.radians(-2.0), np.radians(3.0)),
    )
    return replace(sent, **more)


def alarm(value: float = 0.0, limit: float = 0.5, *, check: str = "euler_quaternion", **more: Any) -> AlarmNow:
    """The latest difference and its limit, deg; normal unless said otherwise."""
    made = AlarmNow(
        name="pairs",
        severity="alarm",
        unit="deg",
        t_boot_s=20.0,
        value=value,
        limit=limit,
        state=State.NORMAL,
        announcement=Announcement.TOLD,
        id=f"1.1-{check}-0-1",
        peak=value,
    )
    return replace(made, **more)


def vehicle(sysid: int = 1, rpy_deg: Sequence[float] = (0, 0, 0), *, checks: Any = None, **more: Any) -> VehicleNow:
    if checks is None:
        checks = (CheckNow(name="euler_quaternion", verdict="agree", alarms=(alarm(),)),)
    made = VehicleNow(
        link=None,
        sysid=sysid,
        compid=1,
        autopilot="ardupilot",
        type="quadrotor",
        verdict="agree",
        boot=0,
        t_boot_s=20.0,
        age_s=0.1,
        received=990,
        lost=10,
        attitude=attitude(rpy_deg, euler=True),
        attitude_quaternion=attitude(rpy_deg, euler=False),
        message_age_s={"ATTITUDE": 0.1},
        streams={"ATTITUDE": Stream(count=500, rate_hz=50.0, max_gap_s=0.1, lost=0, invalid=0)},
        checks=checks,
    )
    return replace(made, **more)


def alarmed(sysid: int = 1, *, check: str = "euler_quaternion", **of_alarm: Any) -> VehicleNow:
    """A vehicle with an alarm that stands, 25° of 0.5°, unless said otherwise."""
    standing = {"state": State.RAISED, "value": 25.0, "id": f"{sysid}.1-{check}-0-1", **of_alarm}
    entry = CheckNow(name=check, verdict="alarm", alarms=(alarm(check=check, **standing),))
    return vehicle(sysid, checks=(entry,), verdict="alarm")


def scene(vehicles: Iterable[VehicleNow], *, chosen: int = 0, memory: Memory | None = None, **more: Any) -> Scene:
    """What is drawn of these vehicles, of which one is chosen, and the alert that calls for attention most."""
    memory = memory or Memory()
    snapshot = Snapshot(
        links=(LinkNow(name=0, is_open=True, frames=1, bytes=9, bad_crc=0, skipped_bytes=0, unlisted=0),),
        vehicles=tuple(vehicles),
    )
    alerts = alerts_of(snapshot, memory.lost, memory.shelved_until)
    key: AlertKey | None = alerts[0].key if alerts else None
    given: dict[str, Any] = {
        "title": "udpin:0.0.0.0:14550",
        "clock": "12:00:00Z",
        "snapshot": snapshot,
        "alerts": alerts,
        "chosen": id_of(snapshot.vehicles[chosen]) if snapshot.vehicles else None,
        "chosen_alert": key,
        "memory": memory,
        "histories": {},
    }
    return Scene(**{**given, **more})


def drawn(of: Scene, width: int = 80, height: int = 24) -> Canvas:
    """The page at a size."""
    canvas = Canvas(width, height)
    draw_page(canvas, of)
    return canvas
