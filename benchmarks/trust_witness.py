"""What is asked of the comparators by one who looks on: how much they judged, and what a naive one would have said."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import radians

import numpy as np
import numpy.typing as npt

from gcs_bridge import attitude
from gcs_bridge.alarms.ballot import Ballot
from gcs_bridge.alarms.rated import Rated
from gcs_bridge.alarms.spec import AlarmSpec
from gcs_bridge.alarms.state import PENDING, State
from gcs_bridge.judging.observation import Observation
from gcs_bridge.settings import load_settings
from gcs_bridge.telemetry.samples import AttitudeSamples
from gcs_bridge.telemetry.statements import ModeSet

Ints = npt.NDArray[np.int64]

NAIVE_LIMIT_DEG = 5.0
_DELAYS = load_settings("default").alarm
_SPEC = AlarmSpec(
    check="naive",
    name="alarm",
    id_part="naive",
    severity="alarm",
    what="the latest of both differ",
    not_a_sign_of="anything",
    unit="deg",
    delays=_DELAYS,
)
_LIMIT = radians(NAIVE_LIMIT_DEG)
_LOW = _DELAYS.clear_below * _LIMIT
_LONGEST_S = 0.5  # between two judged pairs: the time between them is judged; at low rates so many of these periods
_PERIODS = 2.5


@dataclass
class Coverage:
    """How much was judged: pairs of the same instant, and armed time (all time, where no HEARTBEAT tells), s."""

    same_instant: int = 0
    judged_same_instant: int = 0
    armed_s: float = 0.0
    judged_armed_s: float = 0.0

    def __add__(self, other: Coverage) -> Coverage:
        mine, its = vars(self), vars(other)
        return Coverage(**{name: mine[name] + its[name] for name in mine})


class Naive:
    """The usual comparator: the latest ATTITUDE against the latest ATTITUDE_QUATERNION whenever one of them comes.

    Its votes and delays are those of gcs-bridge, on receive time, as it has no other.
    """

    def __init__(self) -> None:
        self.alarms = 0
        self._ballot = Ballot([_SPEC])
        self._latest = [np.full((1, 4), np.nan)] * 2

    def take(self, streams: tuple[AttitudeSamples, AttitudeSamples]) -> None:
        """Take what came of both within one boot."""
        valid = [samples[samples.valid] for samples in streams]
        at = [samples.frame_index for samples in valid]
        both = np.concatenate(at)
        order = np.argsort(both, kind="stable")
        pairs = []
        for k in (0, 1):
            q = np.concatenate((self._latest[k], valid[k].q_nb))
            pairs.append(q[np.searchsorted(at[k], both[order], side="right")])
            self._latest[k] = q[-1:]
        angle = attitude.angle_between(*pairs)
        known = np.flatnonzero(np.isfinite(angle))
        t_rx_us = np.concatenate([samples.t_rx_us for samples in valid])[order][known]
        angle = angle[known]
        rated = Rated(
            frame_index=both[order][known],
            t_boot_us=t_rx_us,
            value=angle,
            limit=np.full(len(known), _LIMIT),
            bad=angle > _LIMIT,
            low=angle <= _LOW,
            detail=np.full((len(known), 5), np.nan),
        )
        self._ballot.rate(_SPEC, rated)
        for _, _, change in self._ballot.changes():
            self.alarms += change.state is State.RAISED and change.before in PENDING


@dataclass
class Witness:
    """Looks on while a recording is judged, which is fed as one piece."""

    coverage: dict[tuple[int, int], Coverage] = field(default_factory=dict)
    _naive: dict[tuple[int, int], Naive] = field(default_factory=dict)

    @property
    def naive_alarms(self) -> int:
        return sum(naive.alarms for naive in self._naive.values())

    def __call__(self, seen: Observation) -> None:
        """Take what was judged of one boot of one vehicle."""
        segment = seen.segment
        address = seen.vehicle.address
        self._naive.setdefault(address, Naive()).take((segment.euler, segment.quaternion))
        self.coverage[address] = self.coverage.get(address, Coverage()) + covered(seen)


def covered(seen: Observation) -> Coverage:
    """How much of a boot was judged, if both attitudes came."""
    segment, judged = seen.segment, seen.disagreement.judged
    euler_us, quaternion_us = (of.t_boot_us[of.valid] for of in (segment.euler, segment.quaternion))
    if min(len(euler_us), len(quaternion_us)) < 2:
        return Coverage()
    shared = np.intersect1d(euler_us, quaternion_us)
    same = np.intersect1d(shared, seen.pairs.t_boot_us[judged])

    rows = np.flatnonzero(segment.valid_attitude)
    rows = rows[np.argsort(segment.t_boot_us[rows], kind="stable")]
    t_us = segment.t_boot_us[rows]
    is_armed = armed(seen, segment.frame_index[rows])[1:]
    # Each step from one sample to the next lies between two judged pairs, which may not be too far apart.
    pairs_us = np.unique(np.concatenate(([-(2**60)], seen.pairs.t_boot_us[judged], [2**60])))
    before, after = np.searchsorted(pairs_us, t_us[:-1], "right") - 1, np.searchsorted(pairs_us, t_us[1:])
    period_us = max(float(np.median(np.diff(np.unique(of)))) for of in (euler_us, quaternion_us))
    judged_step = pairs_us[after] - pairs_us[before] <= max(_LONGEST_S * 1e6, _PERIODS * period_us)
    step_s = np.diff(t_us) * 1e-6
    return Coverage(len(shared), len(same), float(step_s[is_armed].sum()), float(step_s[is_armed & judged_step].sum()))


def armed(seen: Observation, frame_index: Ints) -> npt.NDArray[np.bool_]:
    """Whether the vehicle was armed when the frames `frame_index` (n,) came, if it ever was; else always."""
    told = [(say.frame_index, say.armed) for say in seen.flight.statements if isinstance(say, ModeSet)]
    if not any(is_armed for _, is_armed in told):
        return np.ones(len(frame_index), np.bool_)
    since, is_armed = (np.array(column) for column in zip(*told, strict=True))
    return np.asarray(is_armed[np.maximum(np.searchsorted(since, frame_index, "right") - 1, 0)])
