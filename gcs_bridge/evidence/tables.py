"""A moment as tables: one row a sample, with frame and unit in each column's name. null is unknown.

`t_boot_s` is the vehicle's boot clock, `t_rx_utc` the receive time, `frame` the number of the frame in its recording
that brought a row about: the same in every table.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pyarrow as pa

from gcs_bridge import attitude
from gcs_bridge.columns import Floats, Int64s
from gcs_bridge.judging.alarm_windows import AlarmWindow, Said
from gcs_bridge.judging.observation import Observation
from gcs_bridge.telemetry.samples import AttitudeSamples
from gcs_bridge.telemetry.statements import LandedSet, ModeSet, ParameterSet, ReadySet, TextSaid

__all__ = ["tables_of", "utc"]

Table = dict[str, pa.Array]

_WXYZ, _XYZ = ("w", "x", "y", "z"), ("x", "y", "z")


def tables_of(moment: AlarmWindow) -> dict[str, pa.Table]:
    """The tables by name; what never came has none."""
    made = {
        name: [pa.table(columns) for one in moment.observations if (columns := make(one))]
        for name, make in _SAMPLED.items()
    }
    tables = {name: pa.concat_tables(parts) for name, parts in made.items() if parts}
    tables |= {"parameters": _parameters(moment), "said": _said(moment)}
    return {name: table for name, table in tables.items() if len(table)}


def utc(t_us: Int64s) -> pa.Array:
    """Receive times, µs since 1970; null where unknown."""
    return pa.array(t_us, pa.timestamp("us", tz="UTC"), mask=t_us <= 0)


def _attitude(one: Observation) -> Table:
    """ATTITUDE as sent, and the attitude that it means once the expected differences are undone."""
    sent = _attitude_columns(one.segment.euler)
    return sent | _spread("q_nb_undone", _WXYZ, one.flight.euler.q_nb, as_sent=True)


def _attitude_quaternion(one: Observation) -> Table:
    """ATTITUDE_QUATERNION as sent, never normalised, and its angles."""
    return _attitude_columns(one.segment.quaternion)


def _ahrs2(one: Observation) -> Table:
    """The second estimate, stamped midway between the messages around it."""
    second = one.flight.secondary
    columns = _attitude_columns(second)
    return {name: columns[name] for name in columns if not name.startswith("w_")} | {
        "t_boot_gap_s": pa.array(second.gap_us / 1e6)
    }


def _attitude_columns(samples: AttitudeSamples) -> Table:
    rpy_rad = samples.rpy_rad
    if rpy_rad is None:
        rpy_rad = attitude.rpy_from_quaternion(samples.q_nb)
    return {
        "t_boot_s": _seconds(samples.t_boot_us),
        "t_rx_utc": utc(samples.t_rx_us),
        "frame": pa.array(samples.frame_index),
        "valid": pa.array(samples.valid),
        **dict(zip(("roll_rad", "pitch_rad", "yaw_rad"), map(pa.array, rpy_rad.T), strict=True)),
        **_spread("q_nb", _WXYZ, samples.q_nb, as_sent=True),
        **_spread("w_nb_b_rad_s", _XYZ, samples.w_nb_b_rad_s, as_sent=True),
    }


def _pairs(one: Observation) -> Table:
    """The two attitudes at one instant each, and how the quaternion differs, seen from the Euler angles."""
    pairs, found = one.pairs, one.disagreement
    raw_rad = attitude.angle_between(pairs.q_euler_sent, pairs.q_quaternion)
    return {
        "t_boot_s": _seconds(pairs.t_boot_us),
        "frame": pa.array(pairs.frame_index),
        "same_instant": pa.array(pairs.same_instant),
        "judged": pa.array(found.judged),
        "counted": pa.array(found.counted),
        "residual_deg": _degrees(found.angle),
        "limit_deg": _degrees(found.limit),
        "bound_deg": _degrees(pairs.bound_rad),
        "tilt_deg": _degrees(found.tilt),
        "heading_deg": _degrees(found.heading),
        "raw_deg": _degrees(raw_rad),
        **_spread("residual_b_deg", _XYZ, np.degrees(found.rotvec_body)),
        **_spread("residual_n_deg", _XYZ, np.degrees(found.rotvec_world)),
        **_spread("q_nb_euler", _WXYZ, pairs.q_euler_sent),
        **_spread("q_nb_euler_undone", _WXYZ, pairs.q_euler),
        **_spread("q_nb_quaternion", _WXYZ, pairs.q_quaternion),
        **_spread("w_nb_b_rad_s", _XYZ, pairs.w_nb_b_rad_s),
        **_spread("w_differs_b_rad_s", _XYZ, pairs.w_differs_b_rad_s),
    }


def _imu(one: Observation) -> Table:
    """The inertial sensor that is judged by."""
    imu = one.flight.imu
    if imu is None:
        return {}
    return {
        "t_boot_s": _seconds(imu.t_boot_us),
        "t_rx_utc": utc(imu.t_rx_us),
        "frame": pa.array(imu.frame_index),
        "message": pa.array([imu.source] * len(imu), pa.string()),
        "t_sensor_s": _seconds(imu.t_us),
        **_spread("f_b_m_s2", _XYZ, imu.f_b_m_s2),
        **_spread("w_nb_b_rad_s", _XYZ, imu.w_b_rad_s),
        **_spread("m_b_gauss", _XYZ, imu.m_b_gauss),
        "may_rest": pa.array(imu.may_rest),
    }


_SAMPLED: dict[str, Callable[[Observation], Table]] = {
    "attitude": _attitude,
    "attitude_quaternion": _attitude_quaternion,
    "pairs": _pairs,
    "imu": _imu,
    "ahrs2": _ahrs2,
}


def _parameters(moment: AlarmWindow) -> pa.Table:
    """Parameters: those in force when the moment began, then those told in it."""
    told = [(said, said.say) for said in moment.said if isinstance(said.say, ParameterSet)]
    in_force = {say.name: say.frame_index for _, say in told if say.frame_index < moment.at}
    return pa.table(
        {
            **_when([said for said, _ in told]),
            "name": pa.array([say.name for _, say in told], pa.string()),
            "value": pa.array([say.value for _, say in told], pa.float64()),
            "in_force": pa.array([in_force.get(say.name) == say.frame_index for _, say in told], pa.bool_()),
        }
    )


def _said(moment: AlarmWindow) -> pa.Table:
    """Texts, modes and the estimator's flags: the last ones before the moment, then those in it."""
    told = [said for said in moment.said if not isinstance(said.say, ParameterSet)]
    words = [_words(said) for said in told]
    return pa.table(
        {
            **_when(told),
            "what": pa.array([what for what, _ in words], pa.string()),
            "text": pa.array([text for _, text in words], pa.string()),
        }
    )


def _words(said: Said) -> tuple[str, str]:
    """Where a statement came from, and what it said."""
    match said.say:
        case TextSaid(text=text):
            return "STATUSTEXT", text
        case ModeSet() as mode:
            armed = "armed" if mode.armed else "disarmed"
            return "HEARTBEAT", f"{mode.autopilot} {mode.type}, custom_mode {mode.custom_mode}, {armed}"
        case LandedSet(landed=landed):
            return "EXTENDED_SYS_STATE", {True: "on the ground", False: "in the air", None: "unknown"}[landed]
        case ParameterSet() as parameter:
            return "PARAM_VALUE", f"{parameter.name} = {parameter.value:g}"
        case ReadySet() as said_of:
            return said_of.source, f"the attitude is {'ready' if said_of.ready else 'not ready'}"
        case flags:
            return flags.what, f"{flags.before} -> {flags.value}"


def _when(told: list[Said]) -> Table:
    """Frame and time of statements, which carry no time: that of the vehicle's last message before."""
    t_boot_s = [None if said.t_boot_us is None else said.t_boot_us / 1e6 for said in told]
    return {
        "t_boot_s": pa.array(t_boot_s, pa.float64()),
        "boot": pa.array([said.boot for said in told], pa.int64()),
        "frame": pa.array([said.say.frame_index for said in told], pa.int64()),
    }


def _spread(name: str, parts: tuple[str, ...], rows: Floats, *, as_sent: bool = False) -> Table:
    """The columns of vectors or quaternions, one a part; NaN is unknown, unless it was sent."""
    columns = zip(parts, rows.T, strict=True)
    return {f"{name}_{part}": pa.array(column, from_pandas=not as_sent) for part, column in columns}


def _seconds(t_us: Int64s) -> pa.Array:
    return pa.array(t_us / 1e6)


def _degrees(rad: Floats) -> pa.Array:
    return pa.array(np.degrees(rad), from_pandas=True)
