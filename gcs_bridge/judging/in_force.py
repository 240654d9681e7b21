"""What a vehicle has said of itself, by mode, parameters and texts, and what of that is in force at each frame.

A statement counts from its frame on; it waits for the next message with a time, with which it is looked at.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from gcs_bridge.expected import Corrected
from gcs_bridge.expected.trims import TrimsInForce
from gcs_bridge.judging.estimator_resets import Statements
from gcs_bridge.pairing.references import VehicleImu
from gcs_bridge.settings import Settings
from gcs_bridge.telemetry.batches import VehicleBatch
from gcs_bridge.telemetry.link_clock import LinkClock
from gcs_bridge.telemetry.samples import ImuSamples
from gcs_bridge.telemetry.statements import ModeSet, ReadySet, Statement, StepSignal
from gcs_bridge.telemetry.stillness import Stillness

_FIXED_WING = ("fixed_wing",)  # MAV_TYPE; what hovers too is told by its VTOL types
_MOST_NEWS = 10_000  # statements that can wait for a message with a time


class InForce:
    """What one vehicle has said of itself, and what of that is in force."""

    def __init__(self, settings: Settings) -> None:
        """Start with nothing said."""
        self.fixed_wing, self.ardupilot, self.may_be_trim = StepSignal(), StepSignal(), StepSignal(0.0)
        self.explained = StepSignal(0.0)  # how often a trim was fitted
        self._news: list[Statement] = []  # that came behind the last message with a time
        self._statements = Statements()
        self._said: dict[str, Statement] = {}  # whether it is ready, by the message that says so, and its mode
        self._stillness = Stillness(settings.gravity)
        self._trims = TrimsInForce()

    @property
    def trim_open(self) -> StepSignal:
        """1 while AHRS_TRIM is neither told nor fitted: it may be anything."""
        return self._trims.open

    @property
    def at_boot(self) -> Iterable[Statement]:
        """What a boot begins with: whether it is ready, by the message that says so, and its mode."""
        return self._said.values()

    @property
    def type(self) -> str:
        """Of what kind it is, by the latest heartbeat that was looked at; "unknown" before there was one."""
        mode = self._said.get("mode")
        return mode.type if isinstance(mode, ModeSet) else "unknown"

    def hear(self, batch: VehicleBatch, link: LinkClock) -> None:
        """Take what the vehicle said of itself."""
        self._statements.take(batch.statements, link)
        self._news = [*self._news, *batch.statements][-_MOST_NEWS:]
        self._trims.hear(batch.statements)
        self._stillness.told(batch.statements, batch.motion)
        modes = [say for say in batch.statements if isinstance(say, ModeSet)]
        if modes:
            since = np.array([say.frame_index for say in modes])
            self.fixed_wing.put(since, np.array([float(say.type in _FIXED_WING) for say in modes]))
            self.ardupilot.put(since, np.array([float(say.autopilot == "ardupilot") for say in modes]))

    def up_to(self, frame_index: int) -> list[Statement]:
        """The statements that were not looked at yet, up to a frame."""
        told = [say for say in self._news if say.frame_index <= frame_index]
        for say in told:
            if isinstance(say, ReadySet):
                self._said[say.source] = say
            elif isinstance(say, ModeSet):
                self._said["mode"] = say
        self._news = [say for say in self._news if say.frame_index > frame_index]
        return told

    def before(self, frame_index: int, t_rx_us: int) -> list[str]:
        """What it said lately, before a frame, in its own words."""
        return self._statements.before(frame_index, t_rx_us)

    def follow(self, corrected: Corrected) -> None:
        """Take which trims show in the attitude."""
        self._trims.follow(corrected)
        self.may_be_trim.put(*corrected.may_be_trim_from(before=self.may_be_trim.latest))
        if not corrected.found_at:
            return
        found_at = np.array(corrected.found_at, np.int64)
        # The pair that completes a fit was itself judged without it.
        so_far = np.arange(len(found_at), dtype=np.float64)
        so_far += self.explained.latest + 1.0
        self.explained.put(found_at + 1, so_far)

    def imu_of(self, chosen: ImuSamples | None) -> VehicleImu | None:
        """Inertial samples with what the vehicle says of itself then."""
        if chosen is None:
            return None
        may_rest, stands = self._stillness.at(chosen.frame_index)
        trim_b_rad = self._trims.at(chosen.frame_index)
        return VehicleImu(**vars(chosen), may_rest=may_rest, stands=stands, trim_b_rad=trim_b_rad)

    def forget(self, frame_index: int) -> None:
        """All up to a frame was looked at."""
        signals = self.fixed_wing, self.ardupilot, self.may_be_trim, self.explained
        for latest in (*signals, self._stillness, self._trims):
            latest.forget(frame_index)
