"""Keeps what a vehicle sent lately, and asks the convention doctor about every disagreement that becomes an alarm.

The first answer comes with the alarm; better ones as the disagreement goes on, when it has lasted twice as long as at
the one before. Each rests on the frames up to its own, however the input was cut.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from gcs_bridge.columns import Floats, Int64s
from gcs_bridge.contract import Diagnosis
from gcs_bridge.expected import CAUSE_NAMES
from gcs_bridge.judging.sent import Sent, SentBatch
from gcs_bridge.pairing.pairs import Pairs
from gcs_bridge.settings import Settings
from gcs_bridge.telemetry.samples import ATTITUDE, ATTITUDE_QUATERNION, AttitudeSamples, no_attitudes

Question = Literal["forms", "norm", "rates"]
"""The two forms of the attitude, the quaternion's norm, or each message's turn against its own rates."""
QUESTIONS: dict[str, Question] = {"quaternion_norm": "norm", "kinematics": "rates"}
"""What alarms of a check ask about; all others about the two forms."""

_KEPT_US = 30_000_000  # without a disagreement: what an onset may reach back, and clean data before it
_LONGEST_US = 40_000_000  # of a disagreement: more data tells no more
_FIRST_AGAIN_US = 2_000_000
_CLEAN_US = 10_000_000
_CLEAN_PAIRS = 5
_CLEAN_RAD = math.radians(0.003)
_RESET_NEAR_US = 2_000_000
_RESETS_KEPT_US = 120_000_000
_NO_ROWS = np.empty(0, np.int64)


class Answer(NamedTuple):
    """A diagnosis, known with the frame `frame_index` at `t_boot_us`."""

    frame_index: int
    t_boot_us: int
    entry: Diagnosis | None


@dataclass
class _Case:
    """One disagreement that is being followed: since when, and when it is asked about again."""

    onset_us: int
    again_us: int
    until_us: int


class DiagnosisCases:
    """Of one vehicle within one boot; alarms are known by any name."""

    def __init__(self, settings: Settings) -> None:
        """Start with nothing sent."""
        self._settings = settings
        self._kept = Sent()
        self._last: Pairs | None = None  # of the last batch
        self._cases: dict[str, _Case] = {}
        self._resets: list[tuple[int, int]] = []  # frame_index and boot time; the last few

    def keep(self, sent: SentBatch | None, pairs: Pairs, now_us: int) -> None:
        """Remember a batch, and its pairs, None where it brought nothing of either stream.

        What no disagreement needs any more at the boot time `now_us`, µs, is forgotten: of one that stands nothing is
        asked once it has lasted so long that more data would tell no more.
        """
        self._last = pairs
        if sent is not None and self._kept.keep(sent):
            asked = (case for case in self._cases.values() if max(case.again_us, now_us - _KEPT_US) <= case.until_us)
            needed_us = min((case.onset_us - _CLEAN_US for case in asked), default=now_us)
            self._kept.forget(min(now_us - _KEPT_US, needed_us))

    def reset_at(self, frame_index: int, t_boot_us: int) -> None:
        """The estimator was reset, as the frame `frame_index` showed."""
        self._resets.append((frame_index, t_boot_us))
        latest_us = max(at_us for _, at_us in self._resets)
        self._resets = [one for one in self._resets if one[1] >= latest_us - _RESETS_KEPT_US]

    def open(self, name: str, onset_us: int, raised_us: int) -> None:
        """An alarm was raised, at `raised_us`, about a disagreement that began at `onset_us`."""
        after_us = _FIRST_AGAIN_US
        while onset_us + after_us <= raised_us:
            after_us *= 2
        self._cases[name] = _Case(onset_us, onset_us + after_us, onset_us + _LONGEST_US)

    def close(self, name: str) -> None:
        """The alarm has gone."""
        self._cases.pop(name, None)

    def due(self, name: str, until_frame_index: int | None = None) -> Iterator[tuple[int, int]]:
        """Index and time of the frames of the last batch at which an alarm is to be asked about again."""
        case = self._cases.get(name)
        if case is None or self._last is None:
            return
        pairs = self._last
        latest = np.maximum.accumulate(pairs.t_boot_us)
        while case.again_us <= case.until_us:
            row = int(np.searchsorted(latest, case.again_us))
            if row == len(latest) or (until_frame_index is not None and pairs.frame_index[row] >= until_frame_index):
                return
            case.again_us = case.onset_us + 2 * (case.again_us - case.onset_us)
            yield int(pairs.frame_index[row]), int(latest[row])

    def ask(self, name: str, frame_index: int, t_boot_us: int, *, of: Question) -> Answer:
        """What explains the disagreement `of` what the question is about, by all that came up to the frame."""
        case = self._cases[name]
        from gcs_bridge import diagnosis  # only here: most vehicles have no use for a doctor

        window = diagnosis.Window(**self._window(case, frame_index, of))
        if of == "norm":
            found = diagnosis.diagnose_norm(window.quaternion)
        elif of == "rates":
            found = diagnosis.diagnose_rates(window.euler, window.quaternion)
        else:
            found = diagnosis.diagnose(window, self._settings.alignment)
        return Answer(frame_index, t_boot_us, None if found is None else found.entry())

    def _window(self, case: _Case, frame_index: int, of: Question) -> dict[str, Any]:
        """What was sent from the onset on, as the doctor's window wants it."""
        kept = self._kept.since(case.onset_us)
        until_us = case.onset_us + _LONGEST_US
        if of != "rates":  # these have a part in no pair
            until_us = min(until_us, _last_bad_us(kept, case.onset_us, frame_index))
        euler, quaternion = [no_attitudes(ATTITUDE)], [no_attitudes(ATTITUDE_QUATERNION)]
        origin: list[tuple[int, Int64s]] = []  # of the Euler samples: the batch kept, and their rows in it
        for index, sent in enumerate(kept):
            for parts, samples in ((euler, sent.euler), (quaternion, sent.quaternion)):
                inside = (
                    (samples.t_boot_us >= case.onset_us)
                    & (samples.t_boot_us <= until_us)
                    & (samples.frame_index <= frame_index)
                )
                rows = np.flatnonzero(inside)
                parts.append(samples[rows])
                if parts is euler:
                    origin.append((index, rows))
        batch = np.concatenate([_NO_ROWS, *(np.full(len(rows), index) for index, rows in origin)])
        row = np.concatenate([_NO_ROWS, *(rows for _, rows in origin)])
        untold = [kept[index].corrected.untold[rows] for index, rows in origin]
        trims = int(np.bitwise_or.reduce(np.concatenate(untold))) if untold else 0

        def attitude_of(rpy_rad: Floats, asked: Int64s) -> Floats:
            q_nb = np.empty((len(rpy_rad), 4))
            for index in np.unique(batch[asked]).tolist():
                mine = np.flatnonzero(batch[asked] == index)
                q_nb[mine] = kept[index].corrected.undo(rpy_rad[mine], row[asked][mine])
            return q_nb

        return {
            "euler": AttitudeSamples.joined(euler),
            "quaternion": AttitudeSamples.joined(quaternion),
            "attitude_of": attitude_of,
            "clean_before": _clean_before(self._kept.since(case.onset_us - _CLEAN_US), case.onset_us),
            "trims": tuple(name for bit, name in CAUSE_NAMES.items() if trims & bit),
            "reset": any(
                known <= frame_index and abs(t_us - case.onset_us) < _RESET_NEAR_US for known, t_us in self._resets
            ),
        }


def _last_bad_us(kept: list[SentBatch], onset_us: int, frame_index: int) -> int:
    """When both last disagreed, as of a frame: what came behind is no part of the disagreement."""
    bad_us = [
        pairs.t_boot_us[pairs.bad & (pairs.frame_index <= frame_index) & (pairs.t_boot_us >= onset_us)]
        for pairs in (sent.pairs for sent in kept)
    ]
    return max((int(times.max()) for times in bad_us if len(times)), default=onset_us + _LONGEST_US)


def _clean_before(kept: list[SentBatch], onset_us: int) -> bool:
    """Whether both forms agreed to the noise floor for some time before."""
    apart_rad = []
    for pairs in (sent.pairs for sent in kept):
        t_us = pairs.t_boot_us
        apart_rad.append(pairs.apart_rad[pairs.same_instant & (t_us < onset_us) & (t_us >= onset_us - _CLEAN_US)])
    known = np.concatenate(apart_rad) if apart_rad else np.empty(0)
    return len(known) >= _CLEAN_PAIRS and _median(known) < _CLEAN_RAD


def _median(values: Floats) -> float:
    """The median of at least one value; numpy's own, the first time, loads what takes longer than the whole answer."""
    ordered = np.sort(values)
    return float(ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2.0
