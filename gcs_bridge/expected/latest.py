"""The latest samples of both streams that can still find a partner, and how many at once pass as no news.

Of a vehicle with one view alone: `quiet` goes through its samples in tails of arrays, which hold the pairs of the view
as well meanwhile. A closer look wants both as rows.
"""

from __future__ import annotations

import numpy as np

from gcs_bridge.expected.pairs import (
    NO_EULER,
    NO_QUATERNION,
    EulerRows,
)
from gcs_bridge.expected.quiet import (
    Expectation,
    Samples,
    Tails,
    between_rows,
    euler_rows,
    fill_tails,
    new_tails,
    pair_rows,
    pass_quietly,
    quaternion_rows,
)
from gcs_bridge.expected.view import View
from gcs_bridge.telemetry.samples import AttitudeSamples

_FEW = 16  # samples: many a component sends no more, and the tails would take 40 kB of each


class Latest:
    """Of one vehicle: where a closer look wants them, or in the tails of what passes at once."""

    def __init__(self) -> None:
        """Start with none."""
        self.euler, self.quaternion = NO_EULER, NO_QUATERNION  # in order, within this boot
        self._tails: Tails | None = None  # for them, and the pairs of the view: made when some come
        self._tails_hold = False  # whether they are there

    def start_boot(self) -> None:
        """Forget them."""
        self.euler, self.quaternion = NO_EULER, NO_QUATERNION
        self._tails_hold = False

    def pass_quietly(
        self,
        euler: AttitudeSamples,
        quaternion: AttitudeSamples,
        done: tuple[int, int],
        forward: View,
        expectation: Expectation,
    ) -> tuple[int, int]:
        """Take samples from `done` on up to the first that may be news to the view; return up to which."""
        if self._tails is None and len(self.euler) + len(self.quaternion) < _FEW:
            return done
        tails = self._tails = self._tails or new_tails()
        if not self._tails_hold:
            of = forward.between
            fill_tails(tails, self.euler, self.quaternion, (forward.recent, forward.sparse), (of.recent, of.sparse))
            self._tails_hold = True
        passed = np.array(done)
        pass_quietly(_euler_of(euler), _quaternion_of(quaternion), expectation, tails, forward.learnt, passed)
        e, q = passed.tolist()
        return e, q

    def unload(self, forward: View) -> None:
        """Have them, and the pairs of the view, where a closer look wants them."""
        tails = self._tails
        if self._tails_hold and tails is not None:
            self.euler, self.quaternion = euler_rows(tails.euler), quaternion_rows(tails.quaternion)
            forward.recent, forward.sparse = pair_rows(tails.recent), pair_rows(tails.sparse)
            between = forward.between
            between.recent, between.sparse = between_rows(tails.between), between_rows(tails.sparse_between)
            self._tails_hold = False


def one_view(euler: AttitudeSamples) -> EulerRows:
    """Samples of a vehicle with one view."""
    assert euler.rpy_rad is not None
    n = len(euler)
    return EulerRows(
        frame_index=euler.frame_index,
        t_us=euler.t_boot_us,
        rpy_rad=euler.rpy_rad,
        w_b_rad_s=euler.w_nb_b_rad_s,
        view=np.zeros(n, np.int8),
        free=np.zeros(n, np.bool_),
    )


def _euler_of(euler: AttitudeSamples) -> Samples:
    assert euler.rpy_rad is not None
    return Samples(euler.frame_index, euler.t_boot_us, euler.rpy_rad, euler.w_nb_b_rad_s, euler.valid)


def _quaternion_of(quaternion: AttitudeSamples) -> Samples:
    return Samples(
        quaternion.frame_index, quaternion.t_boot_us, quaternion.q_nb, quaternion.w_nb_b_rad_s, quaternion.valid
    )
