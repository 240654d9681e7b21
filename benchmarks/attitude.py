"""The attitude math beside SciPy's Rotation, plain numpy and a copy of the memory, in one process and in alternation.

    python -m benchmarks.attitude               # a million rows, best of seven; one minute

Each pair must agree to 1e-9 before it is timed. SciPy's side starts from Rotation objects that are ready made and ends
with them where it can, as a program that stays in SciPy would. Plain numpy is the formula as it stands in the books,
one whole array after the other. The copy moves as many bytes as the function must: half of its inputs and its output
together, from one array to a new one.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from importlib.metadata import version
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from benchmarks.processes import describe_machine
from gcs_bridge import attitude

Array = npt.NDArray[np.float64]
Call = Callable[[], object]


class Case(NamedTuple):
    """A function with its arguments, and others that do the same."""

    name: str
    arguments: tuple[Array, ...]
    scipy: Call
    plain: Call | None = None


def product(a: Array, b: Array) -> Array:
    aw, ax, ay, az = a.T
    bw, bx, by, bz = b.T
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def turned(q: Array, v: Array) -> Array:
    t = 2.0 * np.cross(q[:, 1:], v)
    return v + q[:, :1] * t + np.cross(q[:, 1:], t)


def matrices(q: Array) -> Array:
    w, x, y, z = q.T
    lines = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(line, axis=-1) for line in lines], axis=-2)


def yaw_pitch_roll(q: Array) -> Array:
    w, x, y, z = q.T
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    return np.stack([yaw, np.arcsin(2 * (w * y - x * z)), roll], axis=-1)


def exponentials(v: Array) -> Array:
    angle = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.concatenate([np.cos(angle / 2), np.sin(angle / 2) / angle * v], axis=-1)


def logarithms(q: Array) -> Array:
    size = np.linalg.norm(q[:, 1:], axis=-1, keepdims=True)
    return np.asarray(np.copysign(2.0 * np.arctan2(size, np.abs(q[:, :1])) / size, q[:, :1]) * q[:, 1:])


def cases(rows: int) -> list[Case]:
    """Everything that SciPy has as well, on random rotations."""
    rng = np.random.default_rng(0)
    q, p = (attitude.normalise(rng.normal(size=(rows, 4))) for _ in range(2))
    v, share, step_s = rng.normal(size=(rows, 3)), rng.uniform(size=rows), np.full(rows, 0.02)
    a, b = (Rotation.from_quat(attitude.xyzw_from_wxyz(x)) for x in (q, p))
    matrix, rotvec, angles, xyzw = a.as_matrix(), a.as_rotvec(), a.as_euler("ZYX"), a.as_quat()
    noisy = matrix + 0.01 * rng.normal(size=matrix.shape)
    conjugates = np.array([1.0, -1.0, -1.0, -1.0])
    made = Rotation.from_rotvec

    def from_a_to_b() -> Rotation:
        return a.inv() * b

    return [
        Case("multiply", (q, p), lambda: a * b, lambda: product(q, p)),
        Case("conjugate", (q,), a.inv, lambda: q * conjugates),
        Case("normalise", (q,), lambda: Rotation.from_quat(xyzw)),
        Case("rotate", (q, v), lambda: a.apply(v), lambda: turned(q, v)),
        Case("angle_between", (q, p), lambda: from_a_to_b().magnitude()),
        Case("slerp", (q, p, share), lambda: a * made(share[:, None] * from_a_to_b().as_rotvec())),
        Case("mean", (q,), a.mean),
        Case("quaternion_from_rotvec", (rotvec,), lambda: made(rotvec), lambda: exponentials(rotvec)),
        Case("rotvec_from_quaternion", (q,), a.as_rotvec, lambda: logarithms(q)),
        Case("matrix_from_quaternion", (q,), a.as_matrix, lambda: matrices(q)),
        Case("quaternion_from_matrix", (matrix,), lambda: Rotation.from_matrix(matrix)),
        Case("nearest_rotation", (noisy,), lambda: Rotation.from_matrix(noisy).as_matrix()),
        Case("quaternion_from_euler", (angles,), lambda: Rotation.from_euler("ZYX", angles)),
        Case("euler_from_quaternion", (q,), lambda: a.as_euler("ZYX"), lambda: yaw_pitch_roll(q)),
        Case("matrix_from_euler", (angles,), lambda: Rotation.from_euler("ZYX", angles).as_matrix()),
        Case("euler_from_matrix", (matrix,), lambda: Rotation.from_matrix(matrix).as_euler("ZYX")),
        Case("integrate", (q, v, step_s), lambda: a * made(v * step_s[:, None])),
        Case("body_rates_between", (q, p, step_s), lambda: from_a_to_b().as_rotvec() / step_s[:, None]),
    ]


def numbers(result: object) -> Array:
    """A result as an array; a quaternion with the sign that makes its largest component positive."""
    array = attitude.wxyz_from_xyzw(result.as_quat()) if isinstance(result, Rotation) else np.asarray(result)
    if array.shape[-1:] != (4,):
        return array
    largest = np.take_along_axis(array, np.abs(array).argmax(axis=-1)[..., None], axis=-1)
    return np.asarray(array * np.sign(largest))


def best_s(calls: list[Call], times: int) -> list[float]:
    """The least time of each, taken in turn."""
    least = [np.inf] * len(calls)
    for _ in range(times):
        for i, call in enumerate(calls):
            begun_s = time.perf_counter()
            call()
            least[i] = min(least[i], time.perf_counter() - begun_s)
    return least


def measured(case: Case, times: int) -> list[float]:
    """Seconds of ours, SciPy, the copy and, where there is one, plain numpy."""
    function = getattr(attitude, case.name)
    output = function(*case.arguments)
    expected = numbers(output)
    for other in filter(None, (case.scipy, case.plain)):
        if not np.allclose(numbers(other()), expected, rtol=1e-9, atol=1e-9):
            raise SystemExit(f"{case.name} and its counterpart do not agree")
    source = np.ones((sum(array.nbytes for array in case.arguments) + output.nbytes) // 16)
    calls = [lambda: function(*case.arguments), case.scipy, source.copy, *filter(None, [case.plain])]
    return best_s(calls, times)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.attitude", description="Time the attitude math.")
    parser.add_argument("--rows", type=int, default=1_000_000, help="[1000000]")
    parser.add_argument("--times", type=int, default=7, help="runs of each, of which the best counts  [7]")
    arguments = parser.parse_args(argv)
    print(f"{describe_machine()}, SciPy {version('scipy')}\n{arguments.rows:,} rows, best of {arguments.times}\n")
    print("| function | gcs-bridge, ms | SciPy, ms | times as fast | plain numpy, ms | times as fast | copies' time |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for case in cases(arguments.rows):
        ours, scipy, copy, *plain = measured(case, arguments.times)
        by_plain = f"{plain[0] * 1e3:.1f} | {plain[0] / ours:.1f}" if plain else "|"
        shown = f"{ours * 1e3:.1f} | {scipy * 1e3:.1f} | **{scipy / ours:.1f}** | {by_plain} | {ours / copy:.1f}"
        print(f"| `{case.name}` | {shown} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
