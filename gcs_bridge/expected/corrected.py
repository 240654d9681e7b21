"""What comes out: samples of ATTITUDE with the expected differences undone, and what of them is still open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Self

import numpy as np
import numpy.typing as npt

from gcs_bridge.columns import Floats, FrameColumns, Int64s, Mask, record
from gcs_bridge.expected.correction import (
    AHRS_TRIM,
    NOTHING,
    PITCH_TRIM,
    TRIM_FITTED,
    UNSURE,
    VTOL_VIEW,
    Correction,
)


@record
class Corrected(FrameColumns):
    """n Euler samples with the expected differences undone.

    `q_nb` (n, 4) [w, x, y, z], FRD to NED; `causes` (n,) bits PITCH_TRIM, AHRS_TRIM, VTOL_VIEW of what turned a sample
    by more than 0.02°; `open` (n,) bits of what may be in it, was not told and not fitted yet, UNSURE where that takes
    time, and TRIM_FITTED; `applied` (n,) which of the `corrections` was undone, the first of which is none. `found_at`:
    the frames with which a trim was fitted that was none before.
    """

    q_nb: Floats
    causes: npt.NDArray[np.uint8]
    open: npt.NDArray[np.uint8]
    applied: Int64s
    corrections: tuple[Correction, ...]
    changes: Int64s | None = None
    found_at: tuple[int, ...] = ()

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """All of `parts`, one or more, one behind the other; how often what was undone changed is left out."""
        corrections = dict.fromkeys(one for part in parts for one in part.corrections)
        place = {one: index for index, one in enumerate(corrections)}
        return cls(
            frame_index=np.concatenate([part.frame_index for part in parts]),
            q_nb=np.concatenate([part.q_nb for part in parts]),
            causes=np.concatenate([part.causes for part in parts]),
            open=np.concatenate([part.open for part in parts]),
            applied=np.concatenate([part._applied_as(place) for part in parts]),
            corrections=tuple(corrections),
            found_at=tuple(at for part in parts for at in part.found_at),
        )

    def _applied_as(self, place: Mapping[Correction, int]) -> Int64s:
        """Which correction was applied to each sample, by other places than here."""
        if not self.undoes:
            return self.applied
        return np.array([place[one] for one in self.corrections])[self.applied]

    def undo(self, rpy_rad: Floats, rows: Int64s) -> Floats:
        """What was undone at `rows` (n,) of the batch, undone in other angles (n, 3): q_nb (n, 4)."""
        q_nb = NOTHING.undo(rpy_rad)
        applied = self.applied[rows]
        for index in np.unique(applied[applied > 0]).tolist():
            mine = applied == index
            q_nb[mine] = self.corrections[index].undo(rpy_rad[mine])
        return q_nb

    @property
    def undoes(self) -> bool:
        """Whether anything was undone."""
        return len(self.corrections) > 1

    @property
    def open_in_all(self) -> int | None:
        """The bits of `open` where all samples have the same; None where they differ, or there is none."""
        bits = self.open.tobytes()
        return bits[0] if bits and bits.count(bits[0]) == len(bits) else None

    def may_be_trim_from(self, before: float) -> tuple[Int64s, Floats]:
        """Frames (k,) from which on AHRS_TRIM may still be found in what differs, 1, or may not, 0, unlike before."""
        bits = self.open_in_all
        if bits is not None and bool(bits & UNSURE) == before:
            return _NEVER, _NO_VALUES
        may_be = ((self.open & UNSURE) != 0).astype(np.float64)
        changes = np.flatnonzero(np.diff(may_be, prepend=before))
        return self.frame_index[changes], may_be[changes]

    @property
    def untold(self) -> npt.NDArray[np.uint8]:
        """Bits (n,) PITCH_TRIM, AHRS_TRIM, VTOL_VIEW of what may be in a sample, was not told and not fitted yet."""
        return self.open & np.uint8(PITCH_TRIM | AHRS_TRIM | VTOL_VIEW)

    @property
    def trim_fitted(self) -> Mask:
        """Whether AHRS_TRIM was fitted (n,), and is known as well as if it had been told."""
        return np.asarray((self.open & TRIM_FITTED) != 0)

    @property
    def trim_b_rad(self) -> Floats:
        """AHRS_TRIM as it was undone in each of the samples: the turn (n, 3) from the body's axes to the IMU's."""
        return np.array([(one.trim_x_rad, one.trim_y_rad, 0.0) for one in self.corrections])[self.applied]


_NEVER, _NO_VALUES = np.empty(0, np.int64), np.empty(0)
