"""What is followed of a vehicle within one boot, and forgotten with it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from gcs_bridge.alarms.record import AlarmRecord
from gcs_bridge.checks.base import Check
from gcs_bridge.columns import all_true, any_true
from gcs_bridge.events import utc
from gcs_bridge.judging.diagnosis_cases import DiagnosisCases
from gcs_bridge.judging.estimator_resets import Resets
from gcs_bridge.judging.start_up import StartUp
from gcs_bridge.pairing.pairs import Aligned, Aligner
from gcs_bridge.pairing.references import PrimaryImu, References
from gcs_bridge.report import schema
from gcs_bridge.settings import Settings
from gcs_bridge.telemetry.batches import BootSegment, VehicleBatch
from gcs_bridge.telemetry.link_clock import LinkClock
from gcs_bridge.telemetry.samples import Ahrs2Samples, ImuSamples
from gcs_bridge.telemetry.statements import Statement
from gcs_bridge.telemetry.stream_liveness import OTHER, Liveness, Timeline


class Boot:
    """What is followed within one boot of the vehicle."""

    def __init__(
        self, index: int, frame_index: int, t_boot_us: int, t_rx_us: int, said: Iterable[Statement], settings: Settings
    ) -> None:
        """Start with the boot's first message: the frame and its times; boot time −1: not told yet.

        `said`: statements that held before.
        """
        self.index = index
        self.frame_index = frame_index
        self.first_us = self.last_us = -1
        self.start_rx_us = -1
        self.begin_clock(t_boot_us, t_rx_us)
        self.aligner = Aligner(settings.alignment, settings.reset)
        self.liveness = Liveness(settings.stream)
        self.resets = Resets()
        self.diagnosis_cases = DiagnosisCases(settings)
        self.asked: dict[str, AlarmRecord] = {}  # alarms that stand, about which the doctor is asked
        self.imu = PrimaryImu()
        self.references = References(settings.alignment)
        self.alive = [False, False]  # the two streams
        self.no_compare_told = False
        self.start_up = StartUp(t_boot_us, said)
        self.is_starting = False

    def begin_clock(self, t_boot_us: int, t_rx_us: int) -> None:
        """Take the first time that was told within it."""
        if self.first_us < 0 <= t_boot_us:
            self.first_us = self.last_us = t_boot_us
            self.start_rx_us = t_rx_us - t_boot_us if t_rx_us >= 0 else -1

    def has_sources(self, check: Check) -> bool:
        """Whether the streams come that a check needs, of an attitude that is ready."""
        if self.is_starting and check.compares:
            return False
        return {"both": all(self.alive), "quaternion": self.alive[1], "any": any(self.alive), "nothing": True}[
            check.needs
        ]

    def entry(self) -> schema.Boot:
        """The boot's entry in the report."""
        return schema.Boot(
            index=self.index,
            first_boot_s=self.first_us / 1e6 if self.first_us >= 0 else None,
            last_boot_s=self.last_us / 1e6 if self.last_us >= 0 else None,
            start_utc=utc(self.start_rx_us),
        )

    def inertial(self, batch: VehicleBatch) -> ImuSamples | None:
        """The samples, within the boot, of the one sensor that is judged by."""
        own = {}
        for name, samples in batch.imu.items():
            mine = (samples.boot == self.index) & (samples.t_boot_us >= 0) & (samples.frame_index >= self.frame_index)
            if all_true(mine):
                own[name] = samples
            elif any_true(mine):
                own[name] = samples[mine]
        return self.imu.take(own)

    def secondary(self, batch: VehicleBatch) -> Ahrs2Samples:
        """What came of the second estimate within the boot."""
        secondary = batch.secondary
        if not len(secondary):
            return secondary
        return secondary.where((secondary.boot == self.index) & (secondary.frame_index >= self.frame_index))


def timeline_of(segment: BootSegment, aligned: Aligned, link: LinkClock) -> Timeline:
    """A segment's messages with the times at which the link was heard, and the periods of their streams."""
    rows = segment.frame_index - link.frame_index[0]
    return Timeline(
        frame_index=segment.frame_index,
        stream=np.minimum(segment.message, OTHER),
        t_boot_us=segment.t_boot_us,
        t_rx_us=link.latest_rx_us[rows],
        heard_us=link.heard_us[rows],
        period_us=aligned.period_us,
        rx_period_us=aligned.rx_period_us,
        lost=segment.lost,
        received=segment.received,
    )
