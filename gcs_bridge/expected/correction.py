"""What a firmware did to the Euler angles of a sample, and how it is undone: pure functions of angles."""

from __future__ import annotations

from typing import NamedTuple

from gcs_bridge import attitude
from gcs_bridge.columns import Floats

PITCH_TRIM, AHRS_TRIM, VTOL_VIEW = 1, 2, 4  # bits: the causes
UNSURE = 8  # another bit: AHRS_TRIM may be in it, and pairs of one instant, which would tell at once, do not come
TRIM_FITTED = 16  # and another: AHRS_TRIM was fitted to pairs of one instant, which tell both of its numbers
CAUSE_NAMES = {PITCH_TRIM: "pitch_trim", AHRS_TRIM: "ahrs_trim", VTOL_VIEW: "vtol_view"}


class Correction(NamedTuple):
    """What the firmware did to the Euler angles, rad: trims, or a view of the pitched body."""

    pitch_rad: float = 0.0
    trim_x_rad: float = 0.0
    trim_y_rad: float = 0.0
    view_rad: float = 0.0

    def undo(self, rpy_rad: Floats) -> Floats:
        """The attitudes q_nb (n, 4) that angles as sent (n, 3) stand for; they may lie outside of nominal ranges."""
        roll, pitch, yaw = rpy_rad[:, 0], rpy_rad[:, 1], rpy_rad[:, 2]
        if self.trim_x_rad or self.trim_y_rad or self.pitch_rad:
            roll, pitch = roll + self.trim_x_rad, pitch + (self.trim_y_rad + self.pitch_rad)
        q_nb = attitude.quaternion_from_rpy(roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw)
        if self.trim_x_rad or self.trim_y_rad:
            q_nb = attitude.multiply(q_nb, attitude.quaternion_from_rotvec((-self.trim_x_rad, -self.trim_y_rad, 0.0)))
        if self.view_rad:
            q_nb = attitude.multiply(q_nb, attitude.quaternion_from_rotvec((0.0, self.view_rad, 0.0)))
        return q_nb

    def without(self, cause: int) -> Correction:
        """The same but for one cause."""
        if cause == AHRS_TRIM:
            return self._replace(trim_x_rad=0.0, trim_y_rad=0.0)
        return self._replace(pitch_rad=0.0) if cause == PITCH_TRIM else self._replace(view_rad=0.0)

    def values(self) -> dict[int, tuple[float, ...]]:
        """The numbers of each cause, rad."""
        trim = (self.trim_x_rad, self.trim_y_rad)
        every = {PITCH_TRIM: (self.pitch_rad,), AHRS_TRIM: trim, VTOL_VIEW: (self.view_rad,)}
        return {cause: value for cause, value in every.items() if any(value)}


NOTHING = Correction()


class CorrectionChange(NamedTuple):
    """From the pair `at` on, another correction holds."""

    at: int
    correction: Correction
    fitted: int = 0  # causes of it that are fitted
    gives_up: int = 0  # causes that were fitted, and are none after all
    between: bool = False  # fitted to pairs of neighbouring instants
    refines: bool = False  # the same fit as before, better known
    like_mount: bool = False  # it may be a mount offset instead
    like_sign: bool = False  # or a wrong sign
