"""Whether frames are signed with a key, by MAVLink's rules (mavlink.io, guide/message_signing.html).

A signed frame ends with the id of its link, a time in units of 10 µs since 2015, and the first six bytes of the SHA-256
of the key and of all that stands before them. The frames of one system, component and link id are a stream. One
**holds** if its signature is right, and its time

- is later than that of the frame of its stream that held last,
- or, of a stream that is new, no more than a minute earlier than the latest of all that held.

pymavlink says the same, with one difference: there a frame that is forged moves the time of its stream as well, so
that a single one with a late time silences the true sender for good. Here only what holds moves anything, as in
the C library that autopilots use (`mavlink_signature_check`).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from gcs_bridge.errors import UsageError
from gcs_bridge.mavlink.scan import Bytes, Frames

__all__ = [
    "BLOCK_BYTES",
    "KEY_BYTES",
    "Outcome",
    "Outcomes",
    "SignatureCounts",
    "Signatures",
    "Signing",
    "SigningKey",
    "Unsigned",
]

Unsigned = Literal["accept", "flag", "reject"]
"""What is done with frames that do not hold: they are used, used and told of, or not used and told of."""
KEY_BYTES = 32
BLOCK_BYTES = 13  # behind the checksum: link id, time, signature
_TIME_BYTES, _SIGNATURE_BYTES = 6, 6
_MINUTE = 6_000_000  # in units of 10 µs
Outcomes = npt.NDArray[np.int8]


class Outcome(IntEnum):
    """What a frame's signature came to."""

    UNSIGNED = 0
    HOLDS = 1
    WRONG = 2
    """By another key, or the frame was changed."""
    REPLAYED = 3
    """Right, and no later than a frame before it: it came again, or too late."""
    OLD = 4
    """Right, and of a new stream that is more than a minute behind."""
    UNKNOWN = 5
    """Of an id that the dialect does not know, and not signed with the key: it may be noise."""


class SigningKey:
    """A key that shows itself to nobody: it is kept only as a SHA-256 that has begun with it."""

    __slots__ = ("_begun",)

    def __init__(self, key: bytes) -> None:
        """Take the 32 bytes; UsageError, which does not name them, where they are not as many."""
        import hashlib

        if len(key) != KEY_BYTES:
            raise UsageError(f"a signing key has {KEY_BYTES} bytes: {len(key)} given")
        self._begun = hashlib.sha256(key)

    def __repr__(self) -> str:
        return "SigningKey(…)"

    def signature(self, signed: bytes | memoryview) -> bytes:
        """Of a frame: all its bytes but for the last six."""
        digest = self._begun.copy()
        digest.update(signed)
        return digest.digest()[:_SIGNATURE_BYTES]


@dataclass(frozen=True)
class Signing:
    """By which key frames are verified, and what is done with those that do not hold."""

    key: SigningKey
    unsigned: Unsigned

    @classmethod
    def of(cls, key: bytes | SigningKey | None, unsigned: str | None) -> Signing | None:
        """With a key, or its 32 bytes, by default to `flag` frames; None without a key: then all are used.

        UsageError for another number of bytes, for an `unsigned` that is unknown, or that needs a key and has none.
        """
        if unsigned is not None and unsigned not in get_args(Unsigned):
            raise UsageError(f"unsigned is {unsigned!r}: it must be one of {', '.join(get_args(Unsigned))}")
        if key is None:
            if unsigned in ("flag", "reject"):
                raise UsageError(
                    f"unsigned frames: to {unsigned} them needs the signing key: nothing is verified without"
                )
            return None
        known = key if isinstance(key, SigningKey) else SigningKey(key)
        return cls(known, unsigned or "flag")  # type: ignore[arg-type]  # one of them, as was asked above


@dataclass
class SignatureCounts:
    """How many frames came to each `Outcome` but UNKNOWN, and how many of known ids were not used for it."""

    unsigned: int = 0
    holds: int = 0
    wrong: int = 0
    replayed: int = 0
    old: int = 0
    refused: int = 0


class Signatures:
    """Verifies the frames of one link, in order of arrival."""

    def __init__(self, signing: Signing) -> None:
        """Start with no stream known."""
        self._key = signing.key
        self.refuses = signing.unsigned == "reject"
        self.counts = SignatureCounts()
        self._newest = 0  # time of all that held, in units of 10 µs
        self._streams: dict[int, int] = {}  # the same of each stream; none is new but by a frame that holds

    def judge(self, buffer: Bytes, base: int, frames: Frames) -> Outcomes:
        """What each of the next frames (n,) came to; they lie in `buffer`, whose first byte has the offset `base`."""
        data, outcomes, counted = buffer.data, [], [0] * len(Outcome)
        # A loop of Python's: most batches of a link are a few frames, and hashing takes longer than the loop.
        for offset, payload, length, sysid, compid, verified, signed in frames[_LOOKED_AT].tolist():
            outcome = Outcome.UNSIGNED
            if signed == 1:
                frame = data[offset - base : payload + length + 2 + BLOCK_BYTES]
                outcome = self._judge(frame, sysid << 16 | compid << 8, verified)
            if not verified and outcome != Outcome.HOLDS:
                outcome = Outcome.UNKNOWN
            outcomes.append(outcome)
            counted[outcome] += 1
        for outcome, name in _COUNTED.items():
            if counted[outcome]:
                setattr(self.counts, name, getattr(self.counts, name) + counted[outcome])
        return np.array(outcomes, np.int8)

    def _judge(self, frame: memoryview, stream: int, is_known: bool) -> Outcome:
        """What a signed frame came to; one of an unknown id, which pymavlink does not look at, moves no time."""
        end = len(frame) - _SIGNATURE_BYTES
        if self._key.signature(frame[:end]) != frame[end:]:
            return Outcome.WRONG
        time = int.from_bytes(frame[end - _TIME_BYTES : end], "little")
        stream |= frame[end - _TIME_BYTES - 1]
        last = self._streams.get(stream)
        if last is None:
            if time + _MINUTE < self._newest:
                return Outcome.OLD
        elif time <= last:
            return Outcome.REPLAYED
        if is_known:
            self._streams[stream] = time
            self._newest = max(self._newest, time)
        return Outcome.HOLDS


_LOOKED_AT = ["offset", "payload", "length", "sysid", "compid", "verified", "signed"]
_COUNTED = {outcome: outcome.name.lower() for outcome in Outcome if outcome is not Outcome.UNKNOWN}
