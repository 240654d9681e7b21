"""The down that the accelerometer sees against the attitude's down (rule M23): at rest they must be one.

In flight an accelerometer feels every force but gravity, so there only gross differences over seconds tell anything.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from msgspec.structs import replace

from gcs_bridge import attitude
from gcs_bridge.attitude import RestWatch
from gcs_bridge.checks.protocol import (
    Break,
    Check,
    Ratings,
    SlidingSums,
    Tier,
    Usable,
    attitude_at,
    finite,
    in_order,
    length,
    rated,
)
from gcs_bridge.flight import ATTITUDE_WIDTH, Flight
from gcs_bridge.lookup import Lookup, Track, no_track
from gcs_bridge.settings import AlarmSettings, GravitySettings

Floats = npt.NDArray[np.float64]
Int64s = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

_MAX_GAP_US = 1_000_000
_WIDTH = 10  # of a query: force, rates, trim, whether it may rest


class Gravity(Check):
    """The check over one vehicle."""

    name: ClassVar[str] = "gravity"
    is_not: ClassVar[str] = "not the heading, which gravity cannot show"
    agrees: ClassVar[str] = "at rest the accelerometer and the attitude see the same down"

    def __init__(self, settings: GravitySettings, delays: AlarmSettings) -> None:
        """Start with nothing judged."""
        super().__init__()
        self._settings = settings
        self._delays = delays
        self._at_once = replace(delays, on_delay_s=0.0)
        self._scale: str | None = None
        self._usable = Usable()
        self._start()

    @property
    def tiers(self) -> tuple[Tier, ...]:
        """At rest a warning and an alarm; in flight an alarm."""
        what = "at rest the accelerometer's down is not the attitude's"
        gross = "for seconds the accelerometer's down is far from the attitude's"
        return (
            Tier("warning", "warning", what, self._delays),
            Tier("alarm", "alarm", what, self._delays),
            Tier("gross", "alarm", gross, self._at_once),
        )

    def start_boot(self) -> None:
        """Forget what counts within one boot alone."""
        super().start_boot()
        self._start()

    def _start(self) -> None:
        self._lookup = Lookup(_WIDTH, ATTITUDE_WIDTH, _MAX_GAP_US)
        self._rest = RestWatch()
        self._sums = SlidingSums(self._settings.gross_window_s, 6)
        self._latest_us = -1
        self._loud_us = -1

    def judge(self, flight: Flight) -> Iterator[Ratings]:
        """Rate each sample of the IMU by the attitude at its time."""
        queries = no_track(_WIDTH)
        self._usable.breaks = []
        if flight.imu is not None:
            samples = flight.imu.samples
            self._scale = samples.scale
            usable = finite(samples.f_b_m_s2)
            self._usable.follow(usable, samples.t_boot_us, flight.imu.ordinal)
            may_rest = flight.may_rest[:, None].astype(np.float64)
            rows = np.hstack((samples.f_b_m_s2, samples.w_b_rad_s, flight.trim_b_rad, may_rest))
            queries = Track(samples.t_boot_us, flight.imu.ordinal, rows)[usable]
        found = self._lookup.feed(flight.attitude, queries)
        picked = in_order(found.query.t_us, self._latest_us)
        if not len(picked):
            return
        t_us, ordinal, rows = found.query.t_us[picked], found.ordinal[picked], found.query.rows[picked]
        self._latest_us = int(t_us[-1])
        # The IMU's axes are the body's before the trim: both downs are compared there.
        force, rates, trim, may_rest = rows[:, :3], rows[:, 3:6], rows[:, 6:9], rows[:, 9] != 0
        q_nb = attitude.multiply(attitude_at(found)[picked], attitude.quaternion_from_rotvec(trim))
        reported = np.where(finite(rates)[:, None], rates, found.after.rows[picked, 4:])
        resting = self._rest.feed(t_us * 1e-6, force, reported, may_rest)
        value = attitude.accelerometer_tilt(q_nb, force)
        down = attitude.body_down(q_nb)
        self._watch(t_us, value, resting & np.isfinite(value))
        at = np.flatnonzero(resting & np.isfinite(value))
        detail = _between_downs(down[at], force[at], value[at])
        for tier, limit in (("warning", self._settings.warning_rad), ("alarm", self._settings.alarm_rad)):
            yield Ratings(tier, rated(t_us[at], ordinal[at], value[at], limit, self._delays, detail))
        yield self._gross(t_us, ordinal, force, reported, down, flight.fixed_wing.at(ordinal) == 1)

    def _gross(
        self, t_us: Int64s, ordinal: Int64s, force: Floats, rates: Floats, down: Floats, fixed_wing: Mask
    ) -> Ratings:
        """The mean specific force of some seconds against the mean down, while the vehicle turns slowly."""
        settings = self._settings
        size = np.sqrt(rates[:, 0] ** 2 + rates[:, 1] ** 2 + rates[:, 2] ** 2)
        loud = ~(size < settings.gross_below_rad_s)
        # On fixed wings a coordinated turn feels level.
        loud |= fixed_wing & (np.abs(np.arctan2(down[:, 1], down[:, 2])) > settings.gross_bank_rad)
        loud_us = np.maximum.accumulate(np.concatenate(([self._loud_us], np.where(loud, t_us, -1))))[1:]
        self._loud_us = int(loud_us[-1])
        sums, _, since_us = self._sums.feed(t_us, np.hstack((force, down)))
        window_us = settings.gross_window_s * 1e6
        rows = np.flatnonzero((t_us - since_us >= 0.8 * window_us) & (t_us - loud_us >= window_us))
        mean_force, mean_down = sums[rows, :3], sums[rows, 3:]
        seen = attitude.down_from_specific_force(mean_force)
        angle = np.arctan2(length(np.cross(mean_down, seen)), np.sum(mean_down * seen, axis=1))
        known = np.isfinite(angle)
        rows, angle = rows[known], angle[known]
        detail = _between_downs(mean_down[known], mean_force[known], angle)
        return Ratings("gross", rated(t_us[rows], ordinal[rows], angle, settings.gross_rad, self._at_once, detail))

    @property
    def broken(self) -> str | None:
        """Why the accelerometer's numbers mean nothing."""
        return self._scale if self._usable.broken else None

    def breaks(self) -> list[Break]:
        """Where the IMU's numbers lost or got their meaning."""
        return self._usable.breaks

    def why_not(self) -> str:
        """Why nothing was judged."""
        if self._scale is None:
            return "no message with an accelerometer was received"
        return "the vehicle was never known to be at rest for 3 s while its attitude came"

    @property
    def remark(self) -> str | None:
        """The unit that was taken for the numbers, where none is defined."""
        return self._scale if self._scale is not None and self._scale.startswith("assumed") else None


def _between_downs(down: Floats, force: Floats, angle: Floats) -> Floats:
    """The detail (n, 5) of the turn from the attitude's down to the accelerometer's: all of it tilt."""
    seen = attitude.down_from_specific_force(force)
    axis = np.cross(seen, down)  # the attitude must turn the other way to see what the accelerometer sees
    size = length(axis)
    turn = axis * np.divide(angle, size, out=np.zeros_like(size), where=size > 0)[:, None]
    return np.column_stack((angle, np.full_like(angle, np.nan), turn))
