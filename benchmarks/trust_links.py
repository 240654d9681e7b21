"""The links of the benchmark of trust: one recording, as a slower, lossier, more disorderly link would have brought it.

Everything that is left to chance comes from a fixed seed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np

from benchmarks.trust_context import companion, suspended, transfer, twice
from gcs_bridge import attitude
from gcs_bridge.diagnosis.mistake import Cause, Parameter
from gcs_bridge.mavlink.dialect import load_dialect
from gcs_bridge.mavlink.scanner import RawFrame, Scanner
from gcs_bridge.recordings.edits import falsified, frames_in, spliced
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
    "suspended": "the receiver sleeps for 10 s, and then takes what has waited",
    "transfer": "for 8 s parameters come in place of the messages that are judged",
    "twice": "each frame comes again 3 ms later",
    "companions": "an onboard computer and a camera send heartbeats beside",
    "staggered": "the two attitudes never share an instant: of each, every second one",
    **{
        f"{name} apart": f"each quaternion is of {what} after its ATTITUDE; parameters are not told"
        for name, what in {"3 ms": "3 ms", "7 ms": "7 ms", "17 ms": "17 ms", "half": "half a period"}.items()
    },
}
_APART_MS = {"3 ms apart": 3.0, "7 ms apart": 7.0, "17 ms apart": 17.0}
_FAR_US = 300_000  # between two quaternions: nothing is interpolated
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

    @property
    def shares_no_instant(self) -> bool:
        """Whether the two attitudes never carry one stamp."""
        return self.trouble == "staggered" or self.trouble.endswith("apart")

    def bring(self, data: bytes) -> bytes:
        """The recording as this link would have brought it."""
        if self.trouble == "staggered":
            data = staggered(data)
        elif self.shares_no_instant:
            data = apart(untold(data), round(_APART_MS.get(self.trouble, 500.0 / self.rate_hz)))
        faults = [Fault("thin", (self.rate_hz,), name) for name in sorted(sent(data))]
        if self.loss:
            faults.append(Fault("loss", (self.loss,)))
        if self.trouble in ("reordered", "doubled"):
            faults.append(Fault("reorder" if self.trouble == "reordered" else "duplicate", (SHARE,)))
        if faults:
            data = inject(data, faults, seed=SEED)
        if self.trouble in _AROUND:
            return b"".join(records(_AROUND[self.trouble](data)))
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


def untold(data: bytes) -> bytes:
    """The recording without a parameter in it."""
    table = load_dialect("all")
    said = frames_in(data, table)
    said = said.where(said.frames["msgid"] == table["PARAM_VALUE"].msgid)
    return spliced(
        data, [(start, stop, b"") for start, stop in zip(said.start.tolist(), said.stop.tolist(), strict=True)]
    )


def apart(data: bytes, by_ms: int) -> bytes:
    """Each quaternion as it would have been so much later, stamped so."""
    table = load_dialect("all")
    found = frames_in(data, table)
    message = table[ATTITUDE_QUATERNION]
    found = found.where(found.frames["msgid"] == message.msgid)
    if not len(found.frames):
        return data
    data = spliced(data, sorted(falsified(found, message, _LATER, (float(by_ms),))))
    return inject(data, [Fault("time_skew", (float(by_ms),))])


def _later(sent: np.ndarray, by_ms: tuple[float, ...]) -> np.ndarray:
    """Fields of one component's quaternions as of a later time: between two by their rates, else by its own."""
    q = np.stack([sent[name] for name in ("q1", "q2", "q3", "q4")], axis=1).astype(np.float64)
    w = np.stack([sent[name] for name in ("rollspeed", "pitchspeed", "yawspeed")], axis=1).astype(np.float64)
    t_us, by_us = sent["time_boot_ms"].astype(np.int64) * 1000, round(1000 * by_ms[0])
    ahead_q, ahead_w = attitude.integrate(q, w, by_us * 1e-6), w.copy()
    for row in range(len(t_us) - 1):
        # The quaternion that is the first at or behind the later time, and the one before it.
        behind = row + 1
        while behind < len(t_us) - 1 and t_us[row] < t_us[behind] < t_us[row] + by_us:
            behind += 1
        before, gap_us = behind - 1, t_us[behind] - t_us[behind - 1]
        if 0 < gap_us <= _FAR_US and t_us[before] <= t_us[row] + by_us <= t_us[behind]:
            share = (t_us[row] + by_us - t_us[before]) / gap_us
            ends = q[before], q[behind], w[before], w[behind]
            ahead_q[row], _ = attitude.hermite(*ends, dt_s=gap_us * 1e-6, u=share)
            ahead_w[row] = (1.0 - share) * w[before] + share * w[behind]
    later = sent.copy()
    for column, name in enumerate(("q1", "q2", "q3", "q4")):
        later[name] = ahead_q[:, column]
    for column, name in enumerate(("rollspeed", "pitchspeed", "yawspeed")):
        later[name] = ahead_w[:, column]
    return later


_LATER = Cause(
    name="later",
    message=31,
    acts_on="payload",
    falsify=_later,
    undo=None,
    parameter=Parameter(unit="ms"),
    fix="",
    origin="the next instant's attitude",
)
_ARRIVALS = {"jitter": late, "bursts": bursts, "suspended": suspended}
_AROUND: dict[str, Callable[[bytes], list[RawFrame]]] = {
    "transfer": partial(transfer, instead_of=THINNED),
    "twice": twice,
    "companions": companion,
}
