"""The down that the accelerometer sees against the attitude's down (rule M23): at rest they must be one.

In flight an accelerometer feels every force but gravity, so there only gross differences over seconds tell anything.
While nobody has told ArduPilot's AHRS_TRIM, what it could make at rest is neither judged nor called good.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from msgspec.structs import replace

from gcs_bridge.alarms.ballot import Ballot
from gcs_bridge.alarms.votes import Votes, vote
from gcs_bridge.attitude.compiled import REST, is_at_rest, new_rest, ray_at, vector_at
from gcs_bridge.attitude.gravity import down_felt, down_of, tilt_felt
from gcs_bridge.attitude.quaternion import cross, exponential, length, product
from gcs_bridge.checks.base import NO_DETAIL, ImuCheck, Watched, is_known, watch
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.checks.windows import Sliding, SlidingSums, slide_in
from gcs_bridge.columns import FloatRows, Floats, Int64s, Mask, Records
from gcs_bridge.jit import helper, kernel
from gcs_bridge.pairing.seen import rates_of
from gcs_bridge.settings import AlarmSettings, GravitySettings
from gcs_bridge.telemetry.statements import held_at

_STATE = np.dtype(
    [
        ("loud_us", "i8"),  # when the vehicle turned fast last, −1: never
        ("last_us", "i8"),
        ("swing_rad", "f8"),  # how far the attitude turned of late from one to the next, as its rates allow for
        ("fast_rad_s", "f8"),  # the largest of these rates
        # Of the settings.
        ("window_us", "f8"),
        ("below_rad_s", "f8"),
        ("bank_rad", "f8"),
    ]
)
_HELD = np.dtype(
    [
        ("samples", "i8"),  # at rest, that AHRS_TRIM may have made, which was not told
        ("most_rad", "f8"),
    ]
)
_MOST_TRIM_RAD = math.radians(10.0)  # AHRS_TRIM's own limit
_GROSS = 2  # place of that alarm, and of its limit


class Gravity(ImuCheck):
    """The check over one vehicle."""

    name: ClassVar[str] = "gravity"
    judges: ClassVar[Literal["f_b_m_s2", "w_b_rad_s"]] = "f_b_m_s2"
    not_a_sign_of: ClassVar[str] = "not the heading, which gravity cannot show"
    ok_text: ClassVar[str] = "at rest the accelerometer and the attitude see the same down"

    def __init__(self, settings: GravitySettings, delays: AlarmSettings) -> None:
        """Start with nothing judged."""
        super().__init__()
        self._settings = settings
        self._limits = settings.warning_rad, settings.alarm_rad, settings.gross_rad
        # At rest a warning and an alarm; in flight an alarm.
        at_rest = "at rest the accelerometer's down is not the attitude's"
        gross = "for seconds the accelerometer's down is far from the attitude's"
        gross_alarm = self._alarm_spec("gross", "alarm", gross, replace(delays, on_delay_s=0.0))
        self._held = np.zeros(1, _HELD)
        self.alarm_specs = *self._warning_and_alarm(at_rest, delays), gross_alarm
        self._start()

    def start_boot(self) -> None:
        """Forget what counts within one boot alone."""
        super().start_boot()
        self._start()

    def _start(self) -> None:
        settings = self._settings
        self._rest, self._sums, self._state = new_rest(), SlidingSums(settings.gross_window_s, 6), np.zeros(1, _STATE)
        self._state["loud_us"], self._state["window_us"] = -1, settings.gross_window_s * 1e6
        self._state["below_rad_s"], self._state["bank_rad"] = settings.gross_below_rad_s, settings.gross_bank_rad

    def judge(self, batch: CheckBatch, ballot: Ballot) -> None:
        """Rate each sample of the IMU by the attitude at its time."""
        self._follow_scale(batch, ballot)
        seen = batch.imu_with_attitude
        if n := len(seen):
            rate_downs(
                ballot.votes(3 * n),
                self._watching(n),
                self._places(ballot),
                self._limits,
                self._state,
                self._rest,
                self._sums.room(n),
                self._held,
                batch.fixed_wing.steps,
                batch.ardupilot.steps,
                batch.trim_open.steps,
                seen.frame_index,
                seen.t_boot_us,
                seen.f_b_m_s2,
                seen.w_b_rad_s,
                seen.w0_b_rad_s,
                seen.w1_b_rad_s,
                seen.turn_b_rad,
                seen.gap_s,
                seen.trim_b_rad,
                seen.may_rest,
                seen.q_nb,
            )

    def why_not(self) -> str:
        """Why nothing was judged."""
        if self._scale is None:
            return "no message with an accelerometer was received"
        if self._sends_zeros is not None:
            return self._sends_zeros
        if self._held["samples"][0]:
            return f"{self._open_trim}: ask for the parameters"
        return "the vehicle was never known to be at rest for 3 s while its attitude came"

    @property
    def remark(self) -> str | None:
        """Also what was held back."""
        remarks = [super().remark, self._open_trim if self._held["samples"][0] and self.judged else None]
        return "; ".join(filter(None, remarks)) or None

    @property
    def _open_trim(self) -> str:
        held = self._held[0]
        return (
            f"{held['samples']} samples at rest with up to {math.degrees(held['most_rad']):.3g}° were not judged: "
            "AHRS_TRIM may make that, which was not told then"
        )


@kernel
def rate_downs(
    votes: Votes,
    watched: Watched,
    places: Int64s,
    limits: tuple[float, float, float],
    states: Annotated[Records, _STATE],
    rests: Annotated[Records, REST],
    sums: Sliding,
    held: Annotated[Records, _HELD],
    fixed_wing: tuple[Int64s, Floats],
    ardupilot: tuple[Int64s, Floats],
    trim_open: tuple[Int64s, Floats],
    frame_index: Int64s,
    t_us: Int64s,
    f_b: FloatRows,
    w_b: FloatRows,
    w0_b: FloatRows,
    w1_b: FloatRows,
    turn_b: FloatRows,
    gap_s: Floats,
    trim_b: FloatRows,
    may_rest: Mask,
    q_nb: FloatRows,
) -> None:
    """Rate the accelerometer's down at samples (n,) with the attitude at their times."""
    state = states[0]
    for i in range(t_us.size):
        if not is_known(f_b[i]):
            continue
        force, rates = vector_at(f_b, i), vector_at(w_b, i) if is_known(w_b[i]) else vector_at(w1_b, i)
        q, norm2 = _before_trim(q_nb, trim_b, i)
        rate = max(length(_rates_at(w0_b, i)), length(_rates_at(w1_b, i)))
        swing = _may_have_swung(state, t_us[i], length(vector_at(turn_b, i)), rate, gap_s[i])
        down, resting = down_of(q, norm2), is_at_rest(rests[0], t_us[i] * 1e-6, force, rates, may_rest[i])
        angle = tilt_felt(q, norm2, force) if resting else np.nan
        if limits[0] < angle <= _MOST_TRIM_RAD and _is_open(ardupilot, trim_open, frame_index[i]):
            held[0].samples += 1
            held[0].most_rad = max(held[0].most_rad, angle)
            angle = np.nan
        watch(watched, t_us[i], angle, np.isfinite(angle))
        _, since_us = slide_in(sums, t_us[i], (force[0], force[1], force[2], down[0], down[1], down[2]))
        if _is_loud(state, rates, down, held_at(fixed_wing, frame_index[i]) == 1.0):
            state.loud_us = max(state.loud_us, t_us[i])
        mean_force = sums.sums[0], sums.sums[1], sums.sums[2]
        mean_down = sums.sums[3], sums.sums[4], sums.sums[5]
        mean_angle = np.nan
        if t_us[i] - since_us >= 0.8 * state.window_us and t_us[i] - state.loud_us >= state.window_us:
            mean_angle = _angle(mean_down, down_felt(mean_force))
        for k in range(3):
            value, own, felt = (mean_angle, mean_down, mean_force) if k == _GROSS else (angle, down, force)
            if np.isfinite(value):
                limit = limits[k] if k == _GROSS else limits[k] + swing
                detail = _tilting(own, felt, value) if value > limit else NO_DETAIL
                vote(votes, places[k], frame_index[i], t_us[i], value, limit, detail)


@helper
def _may_have_swung(state: Any, t_us: Any, turn_rad: Any, rate: Any, gap_s: Any) -> Any:
    """How far the attitude may be, between two samples, from what lies between them: as far as it turned of late.

    A swing as fast as the samples may look like rest to a sensor that is read at its ends; its rates show it. A leap
    that they do not know is none.
    """
    gaps = (t_us - state.last_us) * 1e-6 / max(gap_s, 1e-3)
    state.last_us = max(state.last_us, t_us)
    fades = 0.5 ** (0.2 * max(gaps, 0.0))  # to half within five of them
    state.fast_rad_s = max(rate, state.fast_rad_s * fades)
    state.swing_rad = max(min(turn_rad, state.fast_rad_s * gap_s), state.swing_rad * fades)
    return state.swing_rad


@helper
def _rates_at(w: Any, i: Any) -> Any:
    return rates_of(w[i, 0], w[i, 1], w[i, 2])


@helper
def _is_open(ardupilot: Any, trim_open: Any, frame_index: Any) -> Any:
    """Whether AHRS_TRIM may be anything."""
    return held_at(ardupilot, frame_index) == 1.0 and held_at(trim_open, frame_index) == 1.0


@helper
def _before_trim(q_nb: Any, trim_b: Any, i: Any) -> Any:
    """The attitude of the body's axes before the trim, which are the sensor's, and its squared norm."""
    q, norm2 = ray_at(q_nb, i)
    if trim_b[i, 0] != 0.0 or trim_b[i, 1] != 0.0 or trim_b[i, 2] != 0.0:
        q = product(q, exponential(vector_at(trim_b, i)))
        norm2 = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    return q, norm2


@helper
def _is_loud(state: Any, rates: Any, down: Any, fixed_wing: Any) -> Any:
    """Whether the vehicle turns fast, or may: on fixed wings a coordinated turn feels level."""
    return not length(rates) < state.below_rad_s or (fixed_wing and abs(np.arctan2(down[1], down[2])) > state.bank_rad)


@helper
def _angle(one: Any, other: Any) -> Any:
    """The angle between two vectors."""
    return np.arctan2(length(cross(one, other)), one[0] * other[0] + one[1] * other[1] + one[2] * other[2])


@helper
def _tilting(down: Any, force: Any, angle: Any) -> Any:
    """The detail of a turn from the attitude's down to the accelerometer's: all of it tilt.

    The attitude must turn the other way to see what the accelerometer sees.
    """
    x, y, z = cross(down_felt(force), down)
    size = length((x, y, z))
    share = angle / size if size > 0 else 0.0
    return angle, np.nan, x * share, y * share, z * share
