"""What a diagnosis must stand up to: each mistake undone anew by SciPy, on fields unpacked by hand, and what is left.

It shares no code with the package. Test and benchmark ask it whether a named mistake really fits a recording.
"""

from __future__ import annotations

import itertools
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation, RotationSpline, Slerp

from tests.helpers.wire import records

Array = NDArray[np.float64]
Interpolation = type[RotationSpline] | type[Slerp]

# Axes of the other frames seen in NED or FRD, line by line: east, north, up; north, west, up; ….
ENU = RFU = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
NWU = FLU = np.array([[1, 0, 0], [0, -1, 0], [0, 0, -1]])
SAME = np.eye(3)
FRAMES = {
    "world_enu": (ENU, SAME),
    "body_flu": (SAME, FLU),
    "enu_flu": (ENU, FLU),
    "enu_rfu": (ENU, RFU),
    "nwu_flu": (NWU, FLU),
    "world_nwu": (NWU, SAME),
    "body_rfu": (SAME, RFU),
}
RPY: dict[str, Callable[[Array], Array]] = {
    "roll_sign": lambda rpy: rpy * [-1, 1, 1],
    "pitch_sign": lambda rpy: rpy * [1, -1, 1],
    "yaw_sign": lambda rpy: rpy * [1, 1, -1],
    "roll_pitch_swapped": lambda rpy: rpy[:, [1, 0, 2]],
    "euler_degrees": np.radians,
    "euler_xyz_order": lambda rpy: Rotation.from_euler("XYZ", rpy).as_euler("ZYX")[:, ::-1],
}
TRIMS = ("ahrs_trim", "pitch_trim", "vtol_view")
OFFSETS = ("yaw_offset", "mount_offset", "world_offset")
RECORD = struct.Struct("<I7f")


@dataclass(frozen=True)
class Sent:
    """Both messages' fields, in order of arrival: times (n,), s since boot; angles (n, 3); [w, x, y, z] (m, 4)."""

    t_euler_s: Array
    rpy_rad: Array
    t_quaternion_s: Array
    wxyz: Array

    def between(self, begin_s: float, end_s: float) -> Sent:
        """The samples with stamps in [begin_s, end_s]."""
        e = (self.t_euler_s >= begin_s) & (self.t_euler_s <= end_s)
        q = (self.t_quaternion_s >= begin_s) & (self.t_quaternion_s <= end_s)
        return Sent(self.t_euler_s[e], self.rpy_rad[e], self.t_quaternion_s[q], self.wxyz[q])


def boots(data: bytes, sysid: int) -> list[Sent]:
    """The fields of one system in an undamaged recording, a boot each; ValueError where it is damaged."""
    rows = [
        (msgid, *RECORD.unpack(payload.ljust(RECORD.size, b"\0")[: RECORD.size]))
        for msgid, system, payload in _messages(data)
        if msgid in (30, 31) and system == sysid
    ]
    table = np.array(rows, np.float64).reshape(-1, 9)
    restarts = np.flatnonzero(np.diff(table[:, 1]) < -5000) + 1  # ms: less is reordering
    found = []
    for boot in np.split(table, restarts):
        euler, quaternion = (boot[boot[:, 0] == msgid, 1:] for msgid in (30, 31))
        found.append(Sent(euler[:, 0] / 1000, euler[:, 1:4], quaternion[:, 0] / 1000, quaternion[:, 1:5]))
    return found


def _messages(data: bytes) -> Iterator[tuple[int, int, bytes]]:
    """Message id, system and payload of each record."""
    for _, frame in records(data):
        if frame[:1] == b"\xfe":
            yield frame[5], frame[3], frame[6 : 6 + frame[1]]
        elif frame[:1] == b"\xfd":
            yield int.from_bytes(frame[7:10], "little"), frame[5], frame[10 : 10 + frame[1]]
        else:
            raise ValueError("no record begins where the one before ends: damaged")


def euler_rotation(rpy_rad: Array) -> Rotation:
    """Roll, pitch, yaw as MAVLink means them."""
    return Rotation.from_euler("ZYX", rpy_rad[:, ::-1])


def quaternion_rotation(wxyz: Array) -> Rotation:
    """[w, x, y, z] of any norm."""
    return Rotation.from_quat(wxyz[:, [1, 2, 3, 0]])


def turn(name: str, value: Sequence[float]) -> Rotation:
    """The constant turn of an offset, deg."""
    return Rotation.from_rotvec([0, 0, *value] if name == "yaw_offset" else list(value), degrees=True)


def undone(sent: Sent, name: str, value: Sequence[float] = ()) -> Sent:
    """What should have been sent, if `name` were the mistake."""
    if name in RPY:
        return replace(sent, rpy_rad=RPY[name](sent.rpy_rad))
    if name == "pitch_trim":
        return replace(sent, rpy_rad=sent.rpy_rad + np.radians([0, value[0], 0]))
    if name == "ahrs_trim":
        trim = np.radians([*value, 0])
        turned = euler_rotation(sent.rpy_rad + trim) * Rotation.from_rotvec(-trim)
        return replace(sent, rpy_rad=turned.as_euler("ZYX")[:, ::-1])
    if name == "vtol_view":
        turned = euler_rotation(sent.rpy_rad) * Rotation.from_euler("y", value[0], degrees=True)
        return replace(sent, rpy_rad=turned.as_euler("ZYX")[:, ::-1])
    if name == "time_skew":
        return replace(sent, t_quaternion_s=sent.t_quaternion_s - value[0] / 1000)
    if name == "quaternion_xyzw":  # x, y, z, w stand in the slots w, x, y, z
        return replace(sent, wxyz=sent.wxyz[:, [3, 0, 1, 2]])
    if name == "quaternion_unnormalised":
        return replace(sent, wxyz=sent.wxyz / value[0])
    q = quaternion_rotation(sent.wxyz)
    if name == "quaternion_conjugate":
        q = q.inv()
    elif name in FRAMES:
        world, body = FRAMES[name]
        q = Rotation.from_matrix(world.T @ q.as_matrix() @ body)
    elif name == "mount_offset":
        q = q * turn(name, value).inv()
    else:
        q = turn(name, value).inv() * q
    return replace(sent, wxyz=q.as_quat()[:, [3, 0, 1, 2]])


def paired(sent: Sent, interpolation: Interpolation = RotationSpline) -> tuple[Array, Rotation, Rotation]:
    """Times, s, and both forms: at equal instants where there are enough, else with the denser one interpolated."""
    _, i, j = np.intersect1d(sent.t_euler_s.round(4), sent.t_quaternion_s.round(4), return_indices=True)
    euler, quaternion = euler_rotation(sent.rpy_rad), quaternion_rotation(sent.wxyz)
    if len(i) >= 5 and len(i) >= 0.5 * min(len(sent.t_euler_s), len(sent.t_quaternion_s)):
        return sent.t_euler_s[i], euler[i], quaternion[j]
    if len(sent.t_euler_s) >= len(sent.t_quaternion_s):
        inside, there = _between(sent.t_quaternion_s, interpolation, sent.t_euler_s, euler)
        return sent.t_quaternion_s[inside], there, quaternion[inside]
    inside, there = _between(sent.t_euler_s, interpolation, sent.t_quaternion_s, quaternion)
    return sent.t_euler_s[inside], euler[inside], there


def _between(
    at_s: Array, interpolation: Interpolation, t_s: Array, rotation: Rotation
) -> tuple[NDArray[np.int64], Rotation]:
    """Which times are inside, in no gap of a second, and the rotations there."""
    t_s, first = np.unique(t_s, return_index=True)
    after = np.clip(np.searchsorted(t_s, at_s), 1, len(t_s) - 1)
    inside = np.flatnonzero((at_s > t_s[0]) & (at_s < t_s[-1]) & (t_s[after] - t_s[after - 1] <= 1.0))
    return inside, interpolation(t_s, rotation[first])(at_s[inside])


def disagreement(sent: Sent, interpolation: Interpolation = RotationSpline) -> tuple[Array, Array]:
    """Times, s, and the angle between the two forms, deg."""
    t_s, euler, quaternion = paired(sent, interpolation)
    return t_s, np.degrees((euler.inv() * quaternion).magnitude())


def fitted(sent: Sent, name: str, interpolation: Interpolation = RotationSpline) -> tuple[float, ...]:
    """The value of a mistake that explains best, found anew: means of rotations, and a search for a lag."""
    if name == "time_skew":
        lags = np.arange(-600, 601, 10)
        for around in (np.arange(-10, 11), np.zeros(1)):
            cost = [np.median(disagreement(undone(sent, name, (float(lag),)), interpolation)[1]) for lag in lags]
            lags = lags[int(np.argmin(cost))] + around
        return (float(lags[0]),)
    _, euler, quaternion = paired(sent, interpolation)
    if name == "ahrs_trim":
        return _fitted_trim(sent, interpolation)
    if name == "pitch_trim":
        pitch = [rotation.as_euler("ZYX", degrees=True)[:, 1] for rotation in (euler, quaternion)]
        return (float(np.median(pitch[1] - pitch[0])),)
    turns = euler.inv() * quaternion if name in ("mount_offset", "vtol_view") else quaternion * euler.inv()
    mean = turns.mean()
    off = (mean.inv() * turns).magnitude()
    mean = turns[off <= 3 * np.median(off) + 1e-3].mean()  # without what a reset or a gap left
    if name == "vtol_view":
        return (float(mean.as_rotvec(degrees=True)[1]),)
    if name == "yaw_offset":
        return (float(mean.as_euler("ZYX", degrees=True)[0]),)
    return tuple(mean.as_rotvec(degrees=True))


def _fitted_trim(sent: Sent, interpolation: Interpolation) -> tuple[float, ...]:
    """AHRS_TRIM, by search from four sides: the median is blind to what a reset or a gap left."""

    def cost(trim: Array) -> float:
        return float(np.mean(np.minimum(disagreement(undone(sent, "ahrs_trim", tuple(trim)), interpolation)[1], 3.0)))

    starts = [np.array(start) for start in itertools.product((2.0, -2.0), repeat=2)]
    best = min((minimize(cost, start, method="Nelder-Mead") for start in starts), key=lambda found: float(found.fun))
    return tuple(best.x.tolist())


def leaves_deg(sent: Sent, candidate: str) -> float:
    """The median of what a candidate, one mistake or two joined by +, leaves once it is undone with its best value.

    By the better of two interpolations, where one is needed: a spline errs around an estimator's reset, the other in
    fast turns.
    """
    return min(_leaves_deg(sent, candidate, interpolation) for interpolation in (RotationSpline, Slerp))


def _leaves_deg(sent: Sent, candidate: str, interpolation: Interpolation) -> float:
    names = candidate.split("+")
    if set(names) & set(OFFSETS) and "ahrs_trim" in names:
        names = 3 * names  # each is found better with the other undone
    for name in names:
        needs_value = name in (*OFFSETS, *TRIMS, "time_skew")
        sent = undone(sent, name, fitted(sent, name, interpolation) if needs_value else ())
    return float(np.median(disagreement(sent, interpolation)[1]))


def apart_deg(truth: Sequence[tuple[str, Sequence[float]]], named: Sequence[tuple[str, Sequence[float]]]) -> float:
    """How far two explanations are from meaning the same for every motion: the largest angle on attitudes at random.

    Both in the order of undoing; lags are compared by the caller.
    """
    rng = np.random.default_rng(7)
    rpy = rng.uniform(-1.2, 1.2, (50, 3))
    found = []
    for mistakes in (truth, named):
        angles = rpy
        for name, value in mistakes:
            if name in RPY or name in TRIMS:
                angles = undone(Sent(np.zeros(len(rpy)), angles, np.zeros(0), np.zeros((0, 4))), name, value).rpy_rad
        q = euler_rotation(angles)
        for name, value in reversed(list(mistakes)):
            q = _made(q, name, value)
        found.append(q)
    return float(np.degrees((found[0].inv() * found[1]).magnitude()).max())


def _made(q: Rotation, name: str, value: Sequence[float]) -> Rotation:
    """What the quaternion's message says with a mistake, the way back of `undone`."""
    if name in FRAMES:
        world, body = FRAMES[name]
        return Rotation.from_matrix(world @ q.as_matrix() @ body.T)
    if name == "quaternion_conjugate":
        return q.inv()
    if name == "quaternion_xyzw":
        x, y, z, w = q.as_quat().T
        return Rotation.from_quat(np.stack([y, z, w, x], axis=1))
    if name == "mount_offset":
        return q * turn(name, value)
    return turn(name, value) * q if name in OFFSETS else q
