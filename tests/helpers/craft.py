"""A vehicle made by hand: what it does is known exactly, and each message can be falsified on its way out.

Turned by `Turn`, which is held against SciPy, and packed by pymavlink, never by our own package.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from math import cos, pi, radians, sin
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import all as mavlink

from gcs_bridge import Monitor
from tests.helpers import wire
from tests.helpers.turn import Turn
from tests.helpers.wire import Packed, packed

Array = NDArray[np.float64]
Json = dict[str, Any]
Record = tuple[int, bytes]

BOOT_S = 10.0  # the boot clock where the record time is wire.START_US
G_M_S2 = 9.80665
DISARMED, ARMED = 81, 81 | 128  # HEARTBEAT.base_mode


class State(NamedTuple):
    """What one message tells: attitude FRD to NED, rates, rad/s, specific force, m/s²; `norm` of the quaternion."""

    rotation: Turn
    rates: Array
    force: Array
    norm: float = 1.0


StreamChange = Callable[[float], tuple[Turn, Array]]
Change = Callable[[float, State], Any]  # time, s, and the true state → what is told: a state, a message, None


def rpy(roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0) -> Turn:
    """The attitude of these angles, deg."""
    return Turn.from_rpy_deg(roll, pitch, yaw)


def rotvec(*deg: float) -> Turn:
    """The turn about this vector, deg."""
    return Turn.from_rotvec(np.radians(deg))


def still(at: Turn | None = None) -> StreamChange:
    """No motion at all."""
    held, none = rpy() if at is None else at, np.zeros(3)
    return lambda t_s: (held, none)


def swaying(axis: Sequence[float] = (0, 1, 0), by_deg: float = 20.0, period_s: float = 4.0) -> StreamChange:
    """To and fro about one body axis: the angle is a sine, so the rate about that axis is its derivative."""
    w, amplitude = 2 * pi / period_s, radians(by_deg) * np.asarray(axis, np.float64)
    x, y, z = amplitude.tolist()
    rates = w * amplitude

    def turn(t_s: float) -> tuple[Turn, Array]:
        share = sin(w * t_s)
        return Turn.from_rotvec((x * share, y * share, z * share)), rates * cos(w * t_s)

    return turn


def spinning(axis: Sequence[float] = (0, 0, 1), deg_s: float = 2.0, at: Turn | None = None) -> StreamChange:
    """At a constant rate about one body axis."""
    rates = radians(deg_s) * np.asarray(axis, np.float64)
    x, y, z = rates.tolist()
    first = rpy() if at is None else at
    return lambda t_s: (first * Turn.from_rotvec((x * t_s, y * t_s, z * t_s)), rates)


# --- changes ---------------------------------------------------------------------------------------------------------


def true(_: float, state: State) -> State:
    """What the vehicle really does."""
    return state


def between(begin_s: float, end_s: float, change: Change, other: Change = true) -> Change:
    """The change from one time to another, and `other` around it."""
    return lambda t_s, state: (change if begin_s <= t_s < end_s else other)(t_s, state)


def nothing(_: float, __: State) -> None:
    """The message is not sent."""


def turned_in_body(*deg: float) -> Change:
    """The attitude turned by a rotation vector in body axes, deg."""
    return lambda _, state: state._replace(rotation=state.rotation * rotvec(*deg))


def turned_in_world(*deg: float) -> Change:
    """The attitude turned by a rotation vector in NED, deg."""
    return lambda _, state: state._replace(rotation=rotvec(*deg) * state.rotation)


def with_rates(change: Callable[[Array], Any]) -> Change:
    """Other rates."""
    return lambda _, state: state._replace(rates=np.asarray(change(state.rates), np.float64))


def rates_off(*deg_s: float) -> Change:
    """Rates that are off by a constant, deg/s."""
    return with_rates(lambda rates: rates + np.radians(deg_s))


def with_norm(norm: float) -> Change:
    """A quaternion of this norm."""
    return lambda _, state: state._replace(norm=norm)


def one_sided(side: str, change: Change) -> dict[str, Any]:
    """Craft's argument for a change of one stream alone: "euler" or "quaternion"."""
    return {side: change}


def two_sided(change: Change) -> dict[str, Any]:
    """Craft's arguments for the same change of both streams."""
    return {"euler": change, "quaternion": change}


# --- messages --------------------------------------------------------------------------------------------------------


def attitude(ms: int, state: State) -> Packed:
    return packed(mavlink.MAVLink_attitude_message, ms, *state.rotation.rpy_rad(), *state.rates.tolist())


def attitude_quaternion(ms: int, state: State) -> Packed:
    w, x, y, z = state.rotation
    q = (state.norm * w, state.norm * x, state.norm * y, state.norm * z)
    return packed(mavlink.MAVLink_attitude_quaternion_message, ms, *q, *state.rates.tolist(), 0, 0, 0, 0)


def ahrs2(_: int, state: State) -> Packed:
    return packed(mavlink.MAVLink_ahrs2_message, *state.rotation.rpy_rad(), 0, 0, 0)


def _counts(state: State, per_g: float) -> list[int]:
    """Force, rates in mrad/s and a field of 0.4 G to the north, as int16 that start anew beyond their range."""
    exact = (
        *(force / G_M_S2 * per_g for force in state.force.tolist()),
        *(1e3 * rate for rate in state.rates.tolist()),
        *state.rotation.inv().applied(400.0, 0.0, 0.0),
    )
    return [(round(count) + 2**15) % 2**16 - 2**15 for count in exact]


def raw_imu(ms: int, state: State, *, per_g: float = 1000.0, clock_us: int = 0) -> Packed:
    """RAW_IMU as ArduPilot sends it, or with another scale of the force; its clock is off by `clock_us`."""
    return packed(mavlink.MAVLink_raw_imu_message, ms * 1000 + clock_us, *_counts(state, per_g), 0, 0)


def scaled_imu(ms: int, state: State) -> Packed:
    return packed(mavlink.MAVLink_scaled_imu_message, ms, *_counts(state, 1000.0), 0)


def highres_imu(ms: int, state: State) -> Packed:
    force, rates = state.force.tolist(), state.rates.tolist()
    field = state.rotation.inv().applied(0.4, 0.0, 0.0)
    return packed(mavlink.MAVLink_highres_imu_message, ms * 1000, *force, *rates, *field, 0, 0, 0, 20, 63, 0)


def parameter(name: str, value: float) -> Any:
    return mavlink.MAVLink_param_value_message(name.encode(), value, 9, 1, 0)  # MAV_PARAM_TYPE_REAL32


def velocity(ms: int, north_m_s: float) -> Any:
    """LOCAL_POSITION_NED with this speed to the north."""
    return mavlink.MAVLink_local_position_ned_message(ms, 0, 0, 0, north_m_s, 0, 0)


def landed(state: int) -> Any:
    """EXTENDED_SYS_STATE: 1 on the ground, 2 in the air."""
    return mavlink.MAVLink_extended_sys_state_message(0, state)


def text(words: str) -> Any:
    return mavlink.MAVLink_statustext_message(4, words.encode())


# --- the vehicle -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Craft:
    """A vehicle: how it turns and what each of its streams makes of that; None where it has no such stream.

    By itself it turns slowly about down, as one at rest whose numbers are never twice the same.
    Both attitudes come `hz` times a second at one instant, the Euler angles first, and between them, at that instant
    too, what else there is: the IMU as often, AHRS2 `second_hz` times. `also` is sent once each, (second, message).
    `force` maps (second, attitude) to the specific force; without it, that of a vehicle that does not accelerate.
    """

    turn: StreamChange = field(default_factory=spinning)
    euler: Change | None = true
    quaternion: Change | None = true
    imu: Change | None = None
    second: Change | None = None
    hz: float = 20.0
    second_hz: float = 5.0
    imu_message: Callable[[int, State], Any] = raw_imu
    force: Callable[[float, Turn], Sequence[float] | Array] | None = None
    autopilot: int = wire.ARDUPILOT
    kind: int = wire.QUADROTOR
    base_mode: int = DISARMED
    beats: bool = True
    also: Sequence[tuple[float, Any]] = ()
    sysid: int = 1
    boot_s: float = BOOT_S

    def state(self, t_s: float) -> State:
        rotation, rates = self.turn(t_s)
        if self.force is not None:
            return State(rotation, rates, np.asarray(self.force(t_s, rotation), np.float64))
        return State(rotation, rates, np.array(rotation.inv().applied(0.0, 0.0, -G_M_S2)))

    def records(self, seconds: float) -> list[Record]:
        """(record time, frame) of this many seconds of flight."""
        said = [(round(at_s * 1000), message) for at_s, message in sorted(self.also, key=lambda one: one[0])]
        if self.beats:
            beat = mavlink.MAVLink_heartbeat_message(self.kind, self.autopilot, self.base_mode, 0, 4, 3)
            said = sorted([*said, *((1000 * s, beat) for s in range(int(np.ceil(seconds))))], key=lambda one: one[0])
        records: list[Record] = []

        sender = mavlink.MAVLink(None, srcSystem=self.sysid, srcComponent=1)

        def send(ms: int, message: Any) -> None:
            sender.seq = len(records) % 256
            records.append((wire.START_US + 1000 * ms, message.pack(sender)))

        every = round(self.hz / self.second_hz)
        streams = (
            (self.euler, attitude, 1),
            (self.imu, self.imu_message, 1),
            (self.second, ahrs2, every),
            (self.quaternion, attitude_quaternion, 1),
        )
        for tick in range(round(seconds * self.hz)):
            t_s = tick / self.hz
            ms, state = round(1000 * t_s), self.state(t_s)
            while said and said[0][0] <= ms:
                send(*said.pop(0))
            for change, make, nth in streams:
                told = change(t_s, state) if change is not None and tick % nth == 0 else None
                if told is not None:
                    send(ms, make(ms + round(1000 * self.boot_s), told) if isinstance(told, State) else told)
        return records


# --- what is made of it ----------------------------------------------------------------------------------------------


def watched(records: Iterable[Record]) -> tuple[list[Json], Json]:
    """The events, and the only vehicle's entry in the report."""
    monitor = Monitor()
    events = monitor.feed_recording(wire.tlog(records)) + monitor.finish()
    (entry,) = monitor.close().to_dict()["files"]
    (vehicle,) = entry["vehicles"]
    return events, vehicle


def judged(craft: Craft, seconds: float) -> Json:
    return watched(craft.records(seconds))[1]


def check(vehicle: Json, name: str) -> Json:
    (entry,) = [entry for entry in vehicle["checks"] if entry["name"] == name]
    found: Json = entry
    return found


def alarms(vehicle: Json, name: str | None = None) -> list[Json]:
    """The alarms, times in seconds of flight."""
    shown = []
    for alarm in vehicle["alarms"]:
        if name in (None, alarm["check"]):
            times = {key: None if alarm[key] is None else alarm[key] - BOOT_S for key in _TIMES}
            shown.append(alarm | times)
    return shown


_TIMES = ("raised_boot_s", "cleared_boot_s")


def told(events: Iterable[Json], *names: str) -> list[Json]:
    return [event for event in events if event["event"] in names]
