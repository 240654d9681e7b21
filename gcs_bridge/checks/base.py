"""What a check is: one batch of a vehicle in; rated samples for its alarms, and numbers for the report, out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, TypedDict

import numpy as np

import gcs_bridge.attitude.compiled  # noqa: F401  # its import lets kernels call this package
from gcs_bridge.alarms.ballot import Ballot
from gcs_bridge.alarms.record import scale_of
from gcs_bridge.alarms.spec import AlarmSpec
from gcs_bridge.alarms.state import Signal
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.checks.quantiles import Quantiles, note
from gcs_bridge.columns import FloatRows, Floats, Int64s, Records
from gcs_bridge.contract import Distribution, Severity, known
from gcs_bridge.jit import helper, kernel
from gcs_bridge.settings import AlarmSettings

NO_DETAIL = (np.nan, np.nan, np.nan, np.nan, np.nan)
"""Of a value that has no direction."""

_UNKNOWN_SAMPLES, _ZERO_SAMPLES = 200, 50
# Of a source: whether its numbers mean nothing, how many samples were zeros in all, and how many in a row are not
# known, or zeros.
_BROKEN, _DEAD, _NOT_KNOWN, _ZEROS = range(4)
_MOSTLY = 0.9
_LONGEST_US = 2_000_000  # of the time between two samples, what counts as watched


_WATCHED = np.dtype(
    [
        ("started", "i8"),
        ("latest_us", "i8"),
        ("alive_us", "i8"),  # time in which the sources were there
        ("judged_us", "i8"),  # and of it, in which something could be judged
        ("judged", "i8"),  # samples
    ]
)


class Watched(NamedTuple):
    """What a kernel is given to count what it judges."""

    of: Annotated[Records, _WATCHED]  # (1,) _WATCHED
    value: Floats  # what is to be counted, see Waiting
    waiting: Int64s


@helper
def watch(watched: Any, t_us: Any, value: Any, judged: Any) -> Any:
    """Count a sample whose sources are there, and its value if it could be judged."""
    of = watched.of[0]
    if not of.started:
        of.started, of.latest_us = 1, t_us
    stands_for = min(max(t_us - of.latest_us, 0), _LONGEST_US)
    of.latest_us = max(of.latest_us, t_us)
    of.alive_us += stands_for
    if judged:
        of.judged_us += stands_for
        of.judged += 1
        note(watched, value)


@helper
def row_at(v: Any, row: Any) -> Any:
    """Row `row` of v (n, 3), as it is."""
    return v[row, 0], v[row, 1], v[row, 2]


@helper
def is_known(numbers: Any) -> Any:
    """As `finite`: whether a sample holds numbers only."""
    known = True
    for number in numbers:
        known &= np.isfinite(number)
    return known


@helper
def is_dead(force: Any, numbers: Any) -> Any:
    """Whether a sample's specific force, and some numbers beside it, are zeros: no sensor measures that for long."""
    none = True
    for number in force:
        none &= number == 0.0
    for number in numbers:
        none &= number == 0.0
    return none


@kernel
def follow_meaning(rows: FloatRows, force: FloatRows, state: Int64s, turns: Int64s) -> int:
    """Follow samples (n, k) beside their `force` (n, 3); put down at which of them they lost or got their meaning.

    Return how many `turns` that are; there must be room for n. `state`: of a `Usable`.
    """
    n = 0
    for i in range(len(rows)):
        known, dead = is_known(rows[i]), is_dead(force[i], rows[i])
        state[_DEAD] += dead
        state[_NOT_KNOWN] = 0 if known else state[_NOT_KNOWN] + 1
        state[_ZEROS] = state[_ZEROS] + 1 if dead else 0
        means = known and not dead
        lost = state[_NOT_KNOWN] >= _UNKNOWN_SAMPLES or state[_ZEROS] >= _ZERO_SAMPLES
        if (state[_BROKEN] != 0) == means and (means or lost):
            state[_BROKEN] = not means
            turns[n] = i
            n += 1
    return n


class Break(NamedTuple):
    """A comparison became unable to run, or able again, with a frame."""

    frame_index: int
    t_boot_us: int
    broken: bool


class Usable:
    """Tells a source whose numbers mean nothing from one that has not decided yet: by many such samples in a row."""

    def __init__(self) -> None:
        """Start with a source that is believed to be usable."""
        self.breaks: list[Break] = []
        self._samples = 0
        self._state = np.zeros(4, np.int64)

    def follow(self, numbers: Floats, force: Floats, t_us: Int64s, frame_index: Int64s) -> None:
        """Take the next samples (n, k): those with NaN in them mean nothing, nor do zeros beside a `force` of zero."""
        broken, turns = self.broken, np.empty(len(numbers), np.int64)
        self._samples += len(numbers)
        self.breaks = []
        for row in turns[: follow_meaning(numbers, force, self._state, turns)].tolist():
            broken = not broken
            self.breaks.append(Break(int(frame_index[row]), int(t_us[row]), broken))

    @property
    def broken(self) -> bool:
        """Whether its numbers mean nothing, by what came last."""
        return bool(self._state.item(_BROKEN))

    @property
    def is_dead(self) -> bool:
        """Whether nearly all that came were zeros."""
        dead = self._state.item(_DEAD)
        return dead > 0 and dead >= _MOSTLY * self._samples


class Numbers(TypedDict):
    """The numbers of a check's entry in the report."""

    coverage: float | None
    pairs: int
    same_instant: int | None
    residual: Distribution
    raw: Distribution
    tilt: Distribution | None
    heading: Distribution | None


class Check(ABC):
    """One check of one vehicle, over all its boots."""

    name: ClassVar[str]
    needs: ClassVar[Literal["both", "quaternion", "any", "nothing"]] = "any"  # of the two streams, to judge at all
    compares: ClassVar[bool] = True  # an attitude with something; else it judges the data's quality only
    unit: ClassVar[str] = "deg"
    not_a_sign_of: ClassVar[str]  # what its alarm is no sign of
    ok_text: ClassVar[str]  # what it means that nothing was raised

    def __init__(self) -> None:
        """Start with nothing judged; who has alarms lists them in `alarm_specs`."""
        # The same objects for life. Of two at one time, a warning is not told beside an alarm.
        self.alarm_specs: tuple[AlarmSpec, ...] = ()
        self._made: list[AlarmSpec] = []
        self._alarm_places: Int64s | None = None
        self.residual = Quantiles()
        self._watched = np.zeros(1, _WATCHED)
        self._judged: Int64s = self._watched["judged"]  # the same, quicker to read
        self._judged_us: Int64s = self._watched["judged_us"]
        self._alive_us: Int64s = self._watched["alive_us"]

    def start_boot(self) -> None:
        """Forget what counts within one boot alone."""
        self._watched["started"] = 0

    @property
    def judged(self) -> int:
        """Samples that could be judged."""
        return self._judged.item()

    @property
    def judged_us(self) -> int:
        """Time in which something could be judged."""
        return self._judged_us.item()

    @property
    def alive_us(self) -> int:
        """Time in which its sources were there."""
        return self._alive_us.item()

    @abstractmethod
    def judge(self, batch: CheckBatch, ballot: Ballot) -> None:
        """Judge what one batch brought: each sample is given to the alarms that it may raise."""

    @property
    def broken(self) -> str | None:
        """Why the comparison cannot run although its sources are there, None where it can."""
        return None

    def breaks(self) -> list[Break]:
        """Where, in the last batch, the comparison became unable to run, or able again."""
        return []

    @property
    def tells(self) -> bool:
        """Whether what was judged tells anything."""
        return True

    @abstractmethod
    def why_not(self) -> str:
        """Why nothing was judged."""

    @property
    def remark(self) -> str | None:
        """What else there is to say of a comparison that was judged."""
        return None

    @property
    def bias(self) -> tuple[float, float, float] | None:
        """What of the difference is taken for the sensor's own and not judged, in body axes, in the check's unit."""
        return None

    def numbers(self) -> Numbers:
        """The report's numbers, in the check's unit."""
        residual, alive_us = self.distribution(self.residual), self.alive_us
        return {
            "coverage": min(self.judged_us / alive_us, 1.0) if alive_us > 0 else None,
            "pairs": self.judged,
            "same_instant": None,
            "residual": residual,
            "raw": residual,
            "tilt": None,
            "heading": None,
        }

    def distribution(self, values: Quantiles) -> Distribution:
        """How large values are, in the check's unit."""
        return Distribution(**{name: known(value) for name, value in values.summary(self.scale).items()})

    @property
    def scale(self) -> float:
        """From the values' own unit to the report's."""
        return scale_of(self.unit)

    def _alarm_spec(
        self,
        name: str,
        severity: Severity,
        what: str,
        delays: AlarmSettings,
        *,
        id_part: str | None = None,
        unit: str | None = None,
        not_a_sign_of: str | None = None,
        recurring_window_s: float = 0.0,
        asks_doctor: bool = False,
        onset_lead_s: float = 0.0,
    ) -> AlarmSpec:
        """One of its alarms: what is not said is the check's, and ids have both names."""
        spec = AlarmSpec(
            check=self.name,
            name=name,
            id_part=f"{self.name}-{name.replace(' ', '-').lower()}" if id_part is None else id_part,
            severity=severity,
            what=what,
            not_a_sign_of=self.not_a_sign_of if not_a_sign_of is None else not_a_sign_of,
            unit=self.unit if unit is None else unit,
            delays=delays,
            recurring_window_s=recurring_window_s,
            asks_doctor=asks_doctor,
            onset_lead_s=onset_lead_s,
        )
        self._made.append(spec)
        return spec

    def _warning_and_alarm(
        self, what: str, delays: AlarmSettings, *, asks_doctor: bool = False
    ) -> tuple[AlarmSpec, AlarmSpec]:
        """Two limits of one thing; the alarm is known by the check's name alone."""
        return (
            self._alarm_spec("warning", "warning", what, delays, asks_doctor=asks_doctor),
            self._alarm_spec("alarm", "alarm", what, delays, id_part=self.name, asks_doctor=asks_doctor),
        )

    def _places(self, ballot: Ballot) -> Int64s:
        """Where its alarms are, in the order of its specs; LookupError for one that it made and did not list there."""
        if self._alarm_places is None:  # a kernel trusts that there are as many as it votes in
            for spec in self._made:
                ballot.place_of(spec)
            self._alarm_places = np.array([ballot.place_of(spec) for spec in self.alarm_specs])
        return self._alarm_places

    def _watching(self, samples: int) -> Watched:
        """What a kernel needs to count so many samples."""
        return Watched(self._watched, *self.residual.room(samples))


class ImuCheck(Check):
    """A check of an inertial sensor, whose numbers may mean nothing: RAW_IMU's unit is not always known."""

    judges: ClassVar[Literal["f_b_m_s2", "w_b_rad_s"]]  # which of its numbers

    def __init__(self) -> None:
        """Start with no sensor heard."""
        super().__init__()
        self._scale: str | None = None
        self._source = "the IMU"
        self._usable = Usable()

    def _follow_scale(self, batch: CheckBatch, ballot: Ballot) -> None:
        """Take in what the sensor's numbers mean, and let the alarms know where that changes."""
        self._usable.breaks = []
        if batch.imu is not None:
            imu = batch.imu
            self._scale, self._source = imu.scale, imu.source
            self._usable.follow(getattr(imu, self.judges), imu.f_b_m_s2, imu.t_boot_us, imu.frame_index)
        if self._usable.breaks:
            signals = [(one.frame_index, Signal.BROKEN if one.broken else Signal.FOUND) for one in self._usable.breaks]
            for place in self._places(ballot):
                ballot.signal(place, signals)

    @property
    def broken(self) -> str | None:
        """Why the sensor's numbers mean nothing."""
        return (self._sends_zeros or self._scale) if self._usable.broken else None

    @property
    def _sends_zeros(self) -> str | None:
        """That there is no sensor behind the numbers."""
        return f"the IMU sends zeros ({self._source}): no sensor measures that" if self._usable.is_dead else None

    def breaks(self) -> list[Break]:
        """Where the sensor's numbers lost or got their meaning."""
        return self._usable.breaks

    @property
    def remark(self) -> str | None:
        """The unit that was taken for the numbers, where none is defined."""
        assumed = self._scale is not None and self._scale.startswith("assumed") and not self._usable.is_dead
        return self._scale if assumed else None
