"""What one batch shows of a vehicle within one boot, ready to be judged: the one thing that every check is given."""

from __future__ import annotations

from dataclasses import dataclass

from gcs_bridge.columns import Floats, Int64s, Mask
from gcs_bridge.pairing.neighbours import Track
from gcs_bridge.pairing.pairs import Pairs
from gcs_bridge.pairing.references import ImuWithAttitude
from gcs_bridge.pairing.steps import Steps
from gcs_bridge.telemetry.batches import Ahrs2Batch, ImuBatch
from gcs_bridge.telemetry.samples import AttitudeSamples
from gcs_bridge.telemetry.statements import Statement, StepSignal
from gcs_bridge.telemetry.stream_liveness import StreamChange, Timeline


@dataclass(frozen=True)
class CheckBatch:
    """One batch of one vehicle within one boot.

    `euler`, `quaternion`: the samples that came, with the `frame_index` of each one's frame; the Euler angles with what
    the firmware differs in on purpose undone. `pairs` of the two, completed by the frames `pair_frame_index`. `steps`
    of both streams with the frames of their later samples. `attitude`: the one attitude that others are compared
    with, rows of q_nb and body rates. `imu`: n samples of one inertial sensor; (n,) whether the vehicle `may_rest` then
    by what it says itself, and whether it `stands` on the ground; `trim_b_rad` (n, 3) the turn from the body's axes to
    the sensor's. `imu_with_attitude`: those of the sensor's samples, of this batch or before, whose attitude is known
    now. `secondary`: of the second estimate. `fixed_wing`, `ardupilot`: 1 or 0 by frame, NaN before a heartbeat said
    so. `stream_changes`: what started, went stale or resumed; `line`: all timed messages, with the vehicle's frames
    `lost` and `received` by each. `statements`: what the vehicle said of itself.
    """

    euler: AttitudeSamples
    euler_frame_index: Int64s
    quaternion: AttitudeSamples
    quaternion_frame_index: Int64s
    pairs: Pairs
    pair_frame_index: Int64s
    steps: tuple[Steps, Steps]
    step_frame_index: tuple[Int64s, Int64s]
    attitude: Track
    imu: ImuBatch | None
    may_rest: Mask
    stands: Mask
    trim_b_rad: Floats
    imu_with_attitude: ImuWithAttitude
    secondary: Ahrs2Batch
    fixed_wing: StepSignal
    ardupilot: StepSignal
    stream_changes: list[StreamChange]
    line: Timeline
    lost: Int64s
    received: Int64s
    statements: list[Statement]
