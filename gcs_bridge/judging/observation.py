"""What one batch showed of a vehicle, for whoever looks on; who that is, is not known here."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from gcs_bridge.alarms.manager import TakenBack
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.checks.disagreement import Disagreement
from gcs_bridge.columns import record
from gcs_bridge.events import Notice
from gcs_bridge.expected import Corrected
from gcs_bridge.pairing.pairs import Pairs
from gcs_bridge.telemetry.batches import BootSegment
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.telemetry.positions import PositionSamples


@record
class Observation:
    """What one batch showed of a vehicle: its samples, the pairs they made, the disagreement of each pair, and all
    that its checks were given; how the Euler angles were corrected, and what was told of alarms in consequence. `type`:
    what kind of vehicle it is, as in the report ("fixed_wing"), by the latest HEARTBEAT; "unknown" before the first.
    `positions`: where it was in this boot, by what came since the last observation.
    """

    vehicle: VehicleId
    type: str
    segment: BootSegment
    pairs: Pairs
    disagreement: Disagreement
    flight: CheckBatch
    corrected: Corrected
    notices: tuple[Notice, ...]
    taken_back: tuple[TakenBack, ...]
    judged: Mapping[str, int]
    positions: PositionSamples


Observer = Callable[[Observation], None]
