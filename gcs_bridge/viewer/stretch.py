"""What several batches showed of a vehicle within one boot, put together: to work on it costs as much as on one.

A live link's batches hold a sample or two. Each part of the picture is worked on when it is to be drawn again, from
all that came meanwhile; how it was cut does not change what is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

from gcs_bridge import attitude
from gcs_bridge.checks.disagreement import Disagreement
from gcs_bridge.columns import Floats
from gcs_bridge.judging.observation import Observation
from gcs_bridge.pairing.references import ImuWithAttitude
from gcs_bridge.telemetry.batches import BootSegment
from gcs_bridge.telemetry.positions import PositionSamples
from gcs_bridge.telemetry.samples import Ahrs2Samples, AttitudeSamples
from gcs_bridge.viewer.scene import Source
from gcs_bridge.viewer.times import Times, pair_times

__all__ = ["Angles", "Stretch", "times_of"]

_SOURCES: tuple[Source, ...] = ("euler", "quaternion")


class Angles:
    """Attitudes of one source that mean something, at least one: as sent, and as roll, pitch, yaw."""

    def __init__(self, source: Source, samples: AttitudeSamples) -> None:
        """Of valid samples."""
        self.source, self.samples = source, samples
        self.times = times_of(samples)

    @cached_property
    def rpy_rad(self) -> Floats:
        """Roll, pitch and yaw (n, 3): as sent, where angles are."""
        sent = self.samples.rpy_rad
        return attitude.rpy_from_quaternion(self.samples.q_nb) if sent is None else sent


class Stretch:
    """Observations of one vehicle in one boot, at least one, in order."""

    def __init__(self, observations: Sequence[Observation]) -> None:
        """Put together what is asked for, and that once."""
        self.observations = observations
        self.boot = observations[0].segment.boot
        self.type = observations[-1].type

    @cached_property
    def segment(self) -> BootSegment:
        """All timed messages; their attitudes are elsewhere."""
        return BootSegment.joined([one.segment for one in self.observations])

    @cached_property
    def sent(self) -> dict[Source, AttitudeSamples]:
        """The attitudes of each source that sent any."""
        found: dict[Source, AttitudeSamples] = {}
        for source in _SOURCES:
            parts = [part for one in self.observations if len(part := getattr(one.segment, source))]
            if parts:
                found[source] = AttitudeSamples.joined(parts)
        return found

    @cached_property
    def angles(self) -> list[Angles]:
        """Of these the valid ones, of each source that has any."""
        valid = {source: samples.where(samples.valid) for source, samples in self.sent.items()}
        return [Angles(source, samples) for source, samples in valid.items() if len(samples)]

    @cached_property
    def secondary(self) -> Ahrs2Samples | None:
        """Attitudes of the second estimate; None: there is none."""
        parts = [one.flight.secondary for one in self.observations if len(one.flight.secondary)]
        return Ahrs2Samples.joined(parts) if parts else None

    @cached_property
    def seen(self) -> ImuWithAttitude | None:
        """Inertial samples with the attitude at their times; None: there is none."""
        parts = [one.flight.imu_with_attitude for one in self.observations if len(one.flight.imu_with_attitude)]
        return ImuWithAttitude.joined(parts) if parts else None

    @cached_property
    def positions(self) -> PositionSamples:
        """Where it was."""
        return PositionSamples.joined([one.positions for one in self.observations])

    @cached_property
    def compared(self) -> tuple[Times, Disagreement] | None:
        """What pairs came to, and when; None: there were none."""
        several = [one for one in self.observations if len(one.pairs)]
        if not several:
            return None
        return Times.joined(list(map(pair_times, several))), Disagreement.joined([one.disagreement for one in several])


def times_of(samples: AttitudeSamples) -> Times:
    """When samples of one boot were true."""
    return Times(boot=int(samples.boot[0]), t_boot_us=samples.t_boot_us, t_rx_us=samples.t_rx_us)
