"""What one batch shows of a vehicle within one boot, ready to be judged: the one thing that every check is given."""

from __future__ import annotations

from dataclasses import replace

from gcs_bridge.columns import record
from gcs_bridge.pairing.neighbours import Track
from gcs_bridge.pairing.pairs import Pairs
from gcs_bridge.pairing.references import ImuWithAttitude, VehicleImu
from gcs_bridge.pairing.steps import Steps
from gcs_bridge.telemetry.heard import HeardFrames
from gcs_bridge.telemetry.others import OfOthers
from gcs_bridge.telemetry.samples import Ahrs2Samples, AttitudeSamples
from gcs_bridge.telemetry.statements import Statement, StepSignal
from gcs_bridge.telemetry.stream_liveness import StreamChange, Timeline


@record
class CheckBatch:
    """One batch of one vehicle within one boot.

    `euler`, `quaternion`: the samples that came, the Euler angles with what the firmware differs in on purpose undone;
    `pairs` and `steps` of both. `attitude`: the one attitude that others are compared with, rows of q_nb and body
    rates. `imu`: samples of one inertial sensor. `imu_with_attitude`: those of its samples, of this batch or before,
    whose attitude is known now. `secondary`: of the second estimate. `fixed_wing`, `ardupilot`: 1 or 0 by frame, NaN
    before a heartbeat said so; `may_be_trim`: 1 while AHRS_TRIM may still be found in what disagrees; `explained`: how
    often a trim was fitted that was none before; `trim_open`: 1 while AHRS_TRIM is neither told nor fitted, so that
    it may be anything. `stream_changes`: what started, went stale or resumed; `line`: all timed messages. `heard`: all
    of the vehicle's frames up to the last of these. `said_by_others`: rates that were asked for, and what slows the
    streams. `statements`: what the vehicle said of itself.
    """

    euler: AttitudeSamples
    quaternion: AttitudeSamples
    pairs: Pairs
    steps: tuple[Steps, Steps]
    attitude: Track
    imu: VehicleImu | None
    imu_with_attitude: ImuWithAttitude
    secondary: Ahrs2Samples
    fixed_wing: StepSignal
    ardupilot: StepSignal
    may_be_trim: StepSignal
    explained: StepSignal
    trim_open: StepSignal
    stream_changes: list[StreamChange]
    line: Timeline
    heard: HeardFrames
    said_by_others: list[OfOthers]
    statements: list[Statement]

    def frames(self, first: int, end: int) -> CheckBatch:
        """What the frames from `first` up to, and without, `end` brought."""
        euler_steps, quaternion_steps = self.steps
        return replace(
            self,
            euler=self.euler.frames(first, end),
            quaternion=self.quaternion.frames(first, end),
            pairs=self.pairs.frames(first, end),
            steps=(euler_steps.frames(first, end), quaternion_steps.frames(first, end)),
            attitude=self.attitude.frames(first, end),
            imu=None if self.imu is None else self.imu.frames(first, end),
            imu_with_attitude=self.imu_with_attitude.frames(first, end),
            secondary=self.secondary.frames(first, end),
            line=self.line.frames(first, end),
            heard=self.heard.frames(first, end),
            said_by_others=[one for one in self.said_by_others if first <= one.frame_index < end],
            stream_changes=[change for change in self.stream_changes if first <= change.frame_index < end],
            statements=[say for say in self.statements if first <= say.frame_index < end],
        )
