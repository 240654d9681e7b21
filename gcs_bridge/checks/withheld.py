"""Which bad pairs have no vote for a while: those that disagree as a firmware may on purpose, until that is known."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from gcs_bridge.attitude.compiled import ray_at
from gcs_bridge.attitude.gravity import down_of
from gcs_bridge.checks.base import row_at
from gcs_bridge.jit import helper

CALM_US = 5_000_000  # without a bad pair, before the next one is a new onset
# How long a disagreement may be withheld; longer where pairs come slowly, or are of neighbouring instants alone.
_HELD_US, _HELD_SLOW_US = 3_000_000, 6_000_000
_SLOW_US = 400_000
_START_US = 3_000_000
_OFF_AXIS = 0.05  # share of a turn that may be about other axes
_STEEP = 0.1  # the cosine of a pitch at which there is no level axis to the right any more
_MOST_TRIM_RAD = math.radians(10.0)
# No view is further from its place, 0° or a quarter turn: so much its own trim and one of the body may make together.
_MOST_OFF_VIEW_RAD = 2.0 * _MOST_TRIM_RAD
LEVEL_TRIM_RAD = _MOST_TRIM_RAD**2 / 2.0  # so much of heading both AHRS_TRIMs together make of a level vehicle


@helper
def is_withheld(
    pairs: Any, i: Any, of: Any, found: Any, may_be_fixed_wing: Any, may_be_trim: Any, explained: Any
) -> Any:
    """Whether a bad pair disagrees as a firmware may on purpose, while that could still be found out.

    What a firmware does is told by parameters and modes, or fitted to some pairs: both take a moment. For so long
    after its onset a disagreement has no vote if it is a turn about the body's y axis, or the level one to its right,
    on an ArduPlane (a view, a trim), or no larger than AHRS_TRIM could make it there: from a boot's first seconds on,
    or while it takes time to fit that trim. `explained` counts fitted trims: behind one another disagreement begins.
    Once a pair of it was neither, nothing of it is withheld any more: no firmware makes it on purpose.
    """
    before_us, of.bad_us = of.bad_us, max(of.bad_us, pairs.t_boot_us[i])
    if of.bad_us - before_us > CALM_US or explained != of.explained:
        of.onset_us, of.explained, of.is_fault = of.bad_us, explained, 0
    x, y, z = row_at(found.rotvec_body, i)
    angle, limit = found.angle[i], found.limit[i]
    q_nb, norm2 = ray_at(pairs.q_quaternion, i)
    _, down_y, cos_tilt = down_of(q_nb, norm2)
    off_level = abs(cos_tilt * z + down_y * y) / max(np.hypot(down_y, cos_tilt), _STEEP)
    is_about_y = min(np.hypot(x, z), np.hypot(x, off_level)) <= _OFF_AXIS * angle + limit
    is_view = is_about_y and min(angle, abs(angle - np.pi / 2.0)) <= _MOST_OFF_VIEW_RAD + limit
    tilt = np.arccos(np.minimum(np.maximum(cos_tilt, -1.0), 1.0))
    by_trim = angle <= 2.0 * np.sin(tilt / 2.0) * _MOST_TRIM_RAD + limit
    is_starting = of.onset_us - of.first_us < _START_US
    fits_slowly = pairs.duration_us[i] >= _SLOW_US or not pairs.same_instant[i]
    held_us = _HELD_SLOW_US if fits_slowly else _HELD_US
    is_young = of.bad_us - of.onset_us < held_us
    is_meant = (is_view and may_be_fixed_wing) or (by_trim and (is_starting or may_be_trim))
    of.is_fault |= np.int64(not is_meant)
    return is_young and is_meant and not of.is_fault
