"""What is told of frames that are not signed as they should be: once a run of them, not once a frame.

Without a key nothing can be verified, but that a sender signs some of its frames and not others is seen all the same:
somebody has taken the signatures off, signing was switched off, or two senders use one identity.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np
from msgspec import UNSET

from gcs_bridge.columns import Int64s
from gcs_bridge.events import Damage, Notice, Rank, head
from gcs_bridge.mavlink.scan import BARE, Frames
from gcs_bridge.mavlink.scanner import Scanner
from gcs_bridge.mavlink.signing import Outcome, Outcomes, Signing
from gcs_bridge.telemetry.identity import VehicleId

_RUN_US = 10_000_000  # a run is over when no such frame came for so long
_MOST_RUNS = 256  # that are told apart; those of further senders are one
_CANNOT_SIGN = 51 * 256 + 68  # the identity of SiK radios, which tell of their link among the frames of others
_OTHERS = -1
_SAID = {
    Outcome.UNSIGNED: "frames without a signature",
    Outcome.WRONG: "frames that are signed by another key, or were changed",
    Outcome.REPLAYED: "signed frames whose time had passed before: they came again, or too late",
    Outcome.OLD: "signed frames of a new stream that is more than a minute old: replayed, or by a clock that is behind",
}
_NAMES: dict[Outcome, Literal["unsigned", "wrong", "replayed", "old"]] = {
    Outcome.UNSIGNED: "unsigned",
    Outcome.WRONG: "wrong",
    Outcome.REPLAYED: "replayed",
    Outcome.OLD: "old",
}
_NO_KEY = "frames with and without a signature: it was switched off, or taken off, or there are two senders"
_NOTHING: list[Notice] = []


class SigningWatch:
    """Follows how the frames of one link are signed."""

    def __init__(self, signing: Signing | None, link: int | None) -> None:
        """Start with nothing told; `link`: its number, None of the first and of a recording."""
        self._signing = signing
        self._link = link
        self._bare = 0
        self._last_us: dict[tuple[int, int], int] = {}  # of each run, by sender and outcome

    def look(self, scanner: Scanner, first: int) -> list[Notice]:
        """What there is to tell of the frames of the last scan, the first of which to be judged has the index `first`.

        A frame that is refused is told of before the next one that is not.
        """
        outcomes = scanner.outcomes
        if outcomes is None:
            bare, self._bare = self._bare, scanner.bare
            if bare == self._bare:
                return _NOTHING
            outcomes = np.zeros(len(scanner.all_frames), np.int8)
        elif (outcomes == Outcome.HOLDS).all():
            return _NOTHING
        return list(self._look(scanner.all_frames, outcomes, first))

    def _look(self, frames: Frames, outcomes: Outcomes, first: int) -> Iterator[Notice]:
        sender = frames["sysid"].astype(np.int64) * 256 + frames["compid"]
        rows = self._amiss(frames, outcomes, sender)
        before: Int64s | None = None
        for row, of, outcome, t_us in zip(
            rows.tolist(), sender[rows].tolist(), outcomes[rows].tolist(), frames["t_rx_us"][rows].tolist(), strict=True
        ):
            run = of, outcome
            if run not in self._last_us and len(self._last_us) >= _MOST_RUNS:
                run = _OTHERS, outcome
            last_us = self._last_us.get(run)
            self._last_us[run] = t_us
            if last_us is None or abs(t_us - last_us) > _RUN_US:
                if before is None:
                    judged = frames["verified"].astype(np.int64)
                    before = np.cumsum(judged) - judged
                yield self._notice(first + int(before[row]), run[0], Outcome(outcome), t_us)

    def _amiss(self, frames: Frames, outcomes: Outcomes, sender: Int64s) -> Int64s:
        """Which frames there is something to be said of."""
        if self._signing is None:
            return np.flatnonzero(frames["signed"] == BARE)
        unsigned = outcomes == Outcome.UNSIGNED
        amiss = ~unsigned & (outcomes != Outcome.HOLDS) & (outcomes != Outcome.UNKNOWN)
        if self._signing.unsigned == "accept":
            return np.flatnonzero(amiss | (frames["signed"] == BARE))
        return np.flatnonzero(amiss | (unsigned & (sender != _CANNOT_SIGN)))

    def _notice(self, frame_index: int, sender: int, outcome: Outcome, t_rx_us: int) -> Notice:
        address = (0, 0) if sender == _OTHERS else (sender >> 8, sender & 0xFF)
        who = "further senders" if sender == _OTHERS else "{},{}".format(*address)
        said = _NO_KEY if self._signing is None else f"{_SAID[outcome]}; they are {self._use}"
        # It is nobody's but the link's: who sent them is not known.
        where = head(VehicleId(self._link, *address), None, None, t_rx_us)
        where["vehicle"] = None
        event = Damage(
            **where,
            reason=f"{who}: {said}",
            dropped=0,
            signature=_NAMES[outcome],
            sender=address if any(address) else UNSET,
        )
        return Notice(frame_index, event, Rank.IDENTITY)

    @property
    def _use(self) -> str:
        return "not used" if self._signing is not None and self._signing.unsigned == "reject" else "used all the same"
