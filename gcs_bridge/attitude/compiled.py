"""This package's math inside compiled kernels: one row at a time, by the very functions that take whole columns.

A kernel calls what works on components (`product`, `logarithm`, `interpolated`, …) as it stands in the other modules.
Here is what a kernel needs beside: how a row is opened, and closed again.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from gcs_bridge.attitude import _rows, euler, gravity, kinematics, quaternion
from gcs_bridge.attitude.dead_reckoning import is_quiet, rests_since, stays_quiet
from gcs_bridge.attitude.quaternion import length
from gcs_bridge.jit import helper, in_kernels, share

share(
    quaternion.product,
    quaternion.conjugated,
    quaternion.cross,
    length,
    quaternion.turned,
    quaternion.exponential,
    quaternion.logarithm,
    quaternion.angle_of,
    quaternion.tilt_heading_of,
    quaternion.between,
    kinematics.scaled,
    kinematics.added,
    kinematics.right_jacobian_times,
    kinematics.inverse_right_jacobian_times,
    kinematics.interpolated,
    kinematics.interpolated_along,
    gravity.down_of,
    gravity.down_felt,
    gravity.tilt_felt,
    euler.quaternion_of_rpy,
    is_quiet,
    stays_quiet,
    rests_since,
)
_LEAST, _MOST = _rows.LARGEST**-2, _rows.LARGEST**2
_LARGEST = _rows.LARGEST


# What follows carries no types: numba types it anew wherever it is compiled into a kernel.


@in_kernels(_rows.where)
def _where(mask: Any, there: Any, elsewhere: Any) -> Any:
    return there if mask else elsewhere


@helper
def ray_at(q: Any, row: Any) -> Any:
    """As `ray`: row `row` of q (n, 4) as w, x, y, z, and the squared norm; NaN without a direction."""
    w, x, y, z = q[row, 0], q[row, 1], q[row, 2], q[row, 3]
    norm2 = w * w + x * x + y * y + z * z
    if not _LEAST <= norm2 <= _MOST:
        w = x = y = z = norm2 = np.nan
    return (w, x, y, z), norm2


@helper
def unit_at(q: Any, row: Any) -> Any:
    """As `unit`: row `row` of q (n, 4), of unit norm."""
    (w, x, y, z), norm2 = ray_at(q, row)
    scale = 1.0 / np.sqrt(norm2)
    return w * scale, x * scale, y * scale, z * scale


@helper
def vector_at(v: Any, row: Any) -> Any:
    """As `vector`: row `row` of v (n, 3) as x, y, z; NaN as a whole where any of them means nothing."""
    return vector_of(v[row, 0], v[row, 1], v[row, 2])


@helper
def vector_of(x: Any, y: Any, z: Any) -> Any:
    """The same of three numbers."""
    if not (abs(x) <= _LARGEST and abs(y) <= _LARGEST and abs(z) <= _LARGEST):
        x = y = z = np.nan
    return x, y, z


@helper
def put(parts: Any, out: Any, row: Any) -> Any:
    """As `join`: write the parts into row `row` of out (n, k), without negative zeros."""
    for i in range(len(parts)):
        out[row, i] = parts[i] + 0.0


REST = np.dtype([("latest_s", "f8"), ("quiet_since_s", "f8"), ("quiet", "?")])
"""What is followed of a vehicle to know its rest: see `new_rest`."""


def new_rest() -> npt.NDArray[np.void]:
    """Of one vehicle (1,), before its first sample: for `is_at_rest`."""
    return np.array([(-np.inf, -np.inf, False)], REST)


@helper
def is_at_rest(rest: Any, t_s: Any, f_b: Any, w: Any, may_rest: Any) -> Any:
    """As `RestWatch`, for the next sample: whether the vehicle is known to rest; `rest` is followed."""
    force, rate = length(f_b), length(w)
    if not np.isfinite(t_s + force + rate) or t_s < rest.latest_s:
        return False
    quiet = is_quiet(force, rate) and may_rest
    if not stays_quiet(quiet, rest.quiet, t_s - rest.latest_s):
        rest.quiet_since_s = t_s
    rest.latest_s, rest.quiet = t_s, quiet
    return rests_since(quiet, rest.quiet_since_s, t_s)
