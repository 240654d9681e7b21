"""What ArduPilot's parameters and modes tell of the differences that it makes, and what they leave open.

No sample is looked at here.
"""

from __future__ import annotations

import math

import numpy as np

from gcs_bridge.columns import Floats, Mask
from gcs_bridge.expected.correction import AHRS_TRIM, NOTHING, PITCH_TRIM, VTOL_VIEW, Correction
from gcs_bridge.expected.pairs import VIEW_NOISE_RAD
from gcs_bridge.telemetry.statements import ModeSet, ParameterSet

FORWARD, HOVER = 0, 1  # the views

_MOST_VIEW_TRIM_RAD = math.radians(10.0)  # a larger one is not fitted
TAILSITTER_RAD = math.radians(90.0)
_LEFT_OF_VIEW_RAD = 2.0 * _MOST_VIEW_TRIM_RAD
_VTOL_MODES = (17, 18, 19, 20, 21, 22, 23, 25)  # ArduPlane's QSTABILIZE … QACRO, and LOITER_ALT_QLAND
_EITHER_MODES = (10, 14, 15, 24, 25)  # AUTO, AVOID_ADSB, GUIDED, THERMAL, LOITER_ALT_QLAND: hovering or not
_KEEP_TRIM = 1 << 8  # FLIGHT_OPTIONS: the pitch trim is not subtracted
_FRAME_TAILSITTER = 10  # Q_FRAME_CLASS
_TAILSITTER_PARAMETERS = ("Q_TAILSIT_ENABLE", "Q_FRAME_CLASS", "Q_TAILSIT_MOTMX")


# No trim is beyond these: who tells one is not believed. In each parameter's own unit.
_LARGEST = {
    **dict.fromkeys(("AHRS_TRIM_X", "AHRS_TRIM_Y"), math.pi / 2),
    **dict.fromkeys(("PTCH_TRIM_DEG", "Q_TRIM_PITCH"), 90.0),
    "TRIM_PITCH_CD": 9000.0,
}


def is_possible(what: ParameterSet) -> bool:
    """Whether a parameter can have this value: a finite one, and no trim of more than 90°."""
    return math.isfinite(what.value) and abs(what.value) <= _LARGEST.get(what.name, math.inf)


def left_of(view: Correction) -> float:
    """How far from a view that was fitted, in rad, forward flight is none, but still pitched by what was taken for it.

    A tailsitter's quarter turn goes with the mode. What stays is a mount, whatever trims come and go beside it.
    """
    return _LEFT_OF_VIEW_RAD if view.view_rad > TAILSITTER_RAD - _MOST_VIEW_TRIM_RAD else 0.0


class FirmwareConfig:
    """What is known of the vehicle: it predicts, and says what may be fitted."""

    _RELEVANT = frozenset(
        {
            *("AHRS_TRIM_X", "AHRS_TRIM_Y", "PTCH_TRIM_DEG", "TRIM_PITCH_CD", "FLIGHT_OPTIONS"),
            *("Q_ENABLE", "Q_TRIM_PITCH", *_TAILSITTER_PARAMETERS),
        }
    )

    def __init__(self) -> None:
        self.autopilot = "unknown"
        self.type = "unknown"
        self.custom_mode = -1
        self.view_refuted = False  # a fitted one did not go with the mode
        self.sits_on_tail = False  # so the accelerometer felt, where nothing was told
        self._hovered = False  # a VTOL mode was seen
        self._parameters: dict[str, float] = {}

    def is_new(self, what: ParameterSet | ModeSet) -> bool:
        """Whether it says anything that was not known, and matters: the modes of planes alone do."""
        if isinstance(what, ParameterSet):
            relevant = what.name in self._RELEVANT and is_possible(what)
            return relevant and self._parameters.get(what.name) != what.value
        if (self.autopilot, self.type) != (what.autopilot, what.type):
            return True
        return self._is_plane and self.custom_mode != what.custom_mode

    def take(self, what: ParameterSet | ModeSet) -> None:
        """Take in what is new."""
        if isinstance(what, ParameterSet):
            self._parameters[what.name] = what.value
        else:
            self.autopilot, self.type, self.custom_mode = what.autopilot, what.type, what.custom_mode
            self._hovered |= self._is_plane and self.custom_mode in _VTOL_MODES

    @property
    def makes_none(self) -> bool:
        """Whether this autopilot is known to make no difference."""
        return self.autopilot not in ("ardupilot", "unknown")

    @property
    def may_be_plane(self) -> bool:
        """Whether it is an ArduPlane, or may turn out to be one."""
        return self._is_plane or self.autopilot == "unknown"

    @property
    def _is_plane(self) -> bool:
        return self.autopilot == "ardupilot" and (self.type == "fixed_wing" or self.type.startswith("vtol_"))

    @property
    def can_hover(self) -> bool:
        """Whether it is a plane with a VTOL view: told by Q_ENABLE, by its type, by a VTOL mode, or as a tailsitter."""
        enabled = self._parameters.get("Q_ENABLE")
        if enabled is not None:
            return self._is_plane and enabled > 0
        is_tailsitter = self._view_parts()[0] == TAILSITTER_RAD
        return self._is_plane and (self._hovered or self.type.startswith("vtol_") or is_tailsitter)

    @property
    def view(self) -> int | None:
        """The view that belongs to the mode, None where it may be either."""
        if not self.can_hover:
            return FORWARD
        if self.custom_mode in _EITHER_MODES:
            return None
        return HOVER if self.custom_mode in _VTOL_MODES else FORWARD

    def predicted(self) -> Correction:
        """What is to be expected in forward flight, and of everything that does not hover."""
        if self.autopilot != "ardupilot":
            return NOTHING
        trim_x, trim_y = (self._parameters.get(f"AHRS_TRIM_{axis}", 0.0) for axis in "XY")
        return Correction(self._pitch_rad() or 0.0, trim_x, trim_y)

    def open_causes(self) -> int:
        """The trims that were not told: bits."""
        if self.autopilot != "ardupilot":
            return 0
        told = self._parameters.keys()
        causes = 0 if {"AHRS_TRIM_X", "AHRS_TRIM_Y"} <= told else AHRS_TRIM
        return causes | (PITCH_TRIM if self._is_plane and self._pitch_rad() is None else 0)

    def changeable_causes(self) -> int:
        """The trims that were told, and may have another value since without a word that arrived: bits."""
        is_trimmed = self._is_plane and self._pitch_rad() is not None and not self._keeps_trim
        return PITCH_TRIM if is_trimmed else 0

    def predicted_view(self) -> Correction:
        """What is to be expected of a plane that hovers; a guess where it was told in part."""
        base, trim = self._view_parts()
        return NOTHING if self.view_refuted else Correction(view_rad=(base or 0.0) + (trim or 0.0))

    @property
    def open_view(self) -> int:
        """VTOL_VIEW where the view of a plane that hovers was not told, or in part."""
        return VTOL_VIEW if self.can_hover and not self.view_refuted and None in self._view_parts() else 0

    @property
    def may_sit_on_tail(self) -> bool:
        """Whether nobody told if a plane that hovers is a tailsitter, and nothing showed it."""
        return self.can_hover and not self.view_refuted and self._view_parts()[0] is None

    def allows_view(self, view_rad: Floats) -> Mask:
        """Which fitted views agree with what was told of it."""
        base, trim = self._view_parts()
        bases = (0.0, TAILSITTER_RAD) if base is None else (base,)
        margin = _MOST_VIEW_TRIM_RAD if trim is None else VIEW_NOISE_RAD
        return np.asarray(np.logical_or.reduce([np.abs(view_rad - one - (trim or 0.0)) <= margin for one in bases]))

    def _view_parts(self) -> tuple[float | None, float | None]:
        """90° for a tailsitter, 0 for none, and the trim of the view, rad; None where it was not told."""
        told = self._parameters
        base: float | None = None
        if "Q_TAILSIT_ENABLE" in told:
            base = TAILSITTER_RAD if told["Q_TAILSIT_ENABLE"] > 0 else 0.0
        elif self._is_old_tailsitter or self.sits_on_tail:
            base = TAILSITTER_RAD
        trim = math.radians(told["Q_TRIM_PITCH"]) if "Q_TRIM_PITCH" in told else None
        return base, trim

    @property
    def _is_old_tailsitter(self) -> bool:
        """Whether the parameters say so that did before there was Q_TAILSIT_ENABLE."""
        told = self._parameters
        return told.get("Q_FRAME_CLASS") == _FRAME_TAILSITTER or told.get("Q_TAILSIT_MOTMX", 0.0) > 0

    @property
    def _keeps_trim(self) -> bool:
        return bool(int(self._parameters.get("FLIGHT_OPTIONS", 0)) & _KEEP_TRIM)

    def _pitch_rad(self) -> float | None:
        """The trim that ArduPlane subtracts, None where it was not told."""
        told = self._parameters
        if not self._is_plane or self._keeps_trim:
            return 0.0
        if "PTCH_TRIM_DEG" in told:
            return math.radians(told["PTCH_TRIM_DEG"])
        return math.radians(told["TRIM_PITCH_CD"] * 0.01) if "TRIM_PITCH_CD" in told else None
