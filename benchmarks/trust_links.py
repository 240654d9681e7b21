"""The links of the benchmark of trust: one recording, as a slower, lossier, more disorderly link would have brought it.

Everything that is left to chance comes from a fixed seed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from gcs_bridge.mavlink.dialect import load_dialect
from gcs_bridge.mavlink.scanner import RawFrame, Scanner
from gcs_bridge.recordings.faults import Fault
from gcs_bridge.recordings.inject import inject
from gcs_bridge.telemetry.samples import AHRS2, ATTITUDE, ATTITUDE_QUATERNION, IMU_MESSAGES

THINNED = (ATTITUDE, ATTITUDE_QUATERNION, AHRS2, *IMU_MESSAGES)
RATES_HZ = (50.0, 25.0, 10.0, 4.0, 2.0)
LOSSES = (0.0, 0.05, 0.1, 0.2)
TROUBLES = {
    "none": "",
    "jitter": "each message up to 0.1 s late, others overtake it",
    "bursts": "what came within 0.5 s comes at its end, at once",
    "reordered": "a tenth changes places with the next one",
    "doubled": "a tenth comes twice",
    "staggered": "the two attitudes never share an instant: of each, every second one",
}
SEED = 5
LATE_S = 0.1
BURST_S = 0.5
SHARE = 0.1  # of the messages, that change places or come twice


class Link(NamedTuple):
    """What a link does to a recording: the rate of each message that is judged, a share lost, and one of TROUBLES."""

    rate_hz: float
    loss: float
    trouble: str

    def __str__(self) -> str:
        lost = f", {self.loss:.0%} lost" if self.loss else ""
        return f"{self.rate_hz:g} Hz{lost}" + (f", {self.trouble}" if self.trouble != "none" else "")

    def bring(self, data: bytes) -> bytes:
        """The recording as this link would have brought it."""
        if self.trouble == "staggered":
            data = staggered(data)
        faults = [Fault("thin", (self.rate_hz,), name) for name in sorted(sent(data))]
        if self.loss:
            faults.append(Fault("loss", (self.loss,)))
        if self.trouble in ("reordered", "doubled"):
            faults.append(Fault("reorder" if self.trouble == "reordered" else "duplicate", (SHARE,)))
        if faults:
            data = inject(data, faults, seed=SEED)
        return retimed(data, _ARRIVALS[self.trouble]) if self.trouble in _ARRIVALS else data


def sent(data: bytes) -> set[str]:
    """Which of THINNED are in a recording."""
    dialect = load_dialect("all")
    present = set(np.unique(Scanner(dialect, timed=True).scan(data, final=True)["msgid"]).tolist())
    return {name for name in THINNED if dialect[name].msgid in present}


def retimed(data: bytes, arrivals: Callable[[np.ndarray], np.ndarray]) -> bytes:
    """The recording with other receive times, and its frames in the order of these."""
    scanner = Scanner(load_dialect("all"), timed=True)
    scanner.scan(data, final=True)
    frames = scanner.raw_frames()
    t_rx_us = arrivals(np.array([frame.t_rx_us for frame in frames], np.int64))
    order = np.argsort(t_rx_us, kind="stable")
    return b"".join(records([RawFrame(int(t_rx_us[row]), frames[row].data) for row in order.tolist()]))


def records(frames: list[RawFrame]) -> Iterator[bytes]:
    """Frames as a .tlog holds them."""
    return (frame.t_rx_us.to_bytes(8, "big") + frame.data for frame in frames)


def late(t_rx_us: np.ndarray) -> np.ndarray:
    """Each message takes up to LATE_S longer, and others overtake it."""
    return t_rx_us + np.random.default_rng(SEED).integers(0, round(LATE_S * 1e6), len(t_rx_us))


def bursts(t_rx_us: np.ndarray) -> np.ndarray:
    """What came within BURST_S comes at the end of it, all at once."""
    burst_us = round(BURST_S * 1e6)
    return -(-t_rx_us // burst_us) * burst_us


def staggered(data: bytes) -> bytes:
    """Of two attitudes one: each second ATTITUDE and the ATTITUDE_QUATERNION between: never the same instant."""
    dialect = load_dialect("all")
    scanner = Scanner(dialect, timed=True)
    scanner.scan(data, final=True)
    found = scanner.all_frames
    kept = np.ones(len(found), np.bool_)
    sender = found["sysid"].astype(np.int64) * 256 + found["compid"]
    for key in np.unique(sender):
        for first, name in enumerate((ATTITUDE, ATTITUDE_QUATERNION)):
            of = np.flatnonzero((sender == key) & (found["msgid"] == dialect[name].msgid))
            kept[of[first::2]] = False
    return b"".join(records([frame for frame, keep in zip(scanner.raw_frames(), kept.tolist(), strict=True) if keep]))


_ARRIVALS = {"jitter": late, "bursts": bursts}
