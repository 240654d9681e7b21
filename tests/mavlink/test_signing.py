"""Signatures against pymavlink's own judgement, frame by frame."""

import hashlib
import random
from collections.abc import Iterator, Sequence
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_bridge.errors import UsageError
from gcs_bridge.mavlink.dialect import load_dialect
from gcs_bridge.mavlink.scanner import Scanner
from gcs_bridge.mavlink.signing import Outcome, Signing, SigningKey
from tests.helpers import wire
from tests.helpers.paths import FIXTURES

KEY = bytes(range(32))
OTHER_KEY = bytes(range(1, 33))
NOON = 35_000_000_000_000  # in units of 10 µs since 2015: some day in 2026
S, MINUTE = 100_000, 6_000_000
UNSIGNED, HOLDS, WRONG, REPLAYED, OLD = Outcome.UNSIGNED, Outcome.HOLDS, Outcome.WRONG, Outcome.REPLAYED, Outcome.OLD


class Steady(mavlink.MAVLink):  # type: ignore[misc]  # pymavlink has no types
    """pymavlink's judge, but that a forged frame does not move the time of its stream."""

    def check_signature(self, *frame: Any) -> bool:
        before = dict(self.signing.stream_timestamps)
        holds: bool = super().check_signature(*frame)
        if not holds:
            self.signing.stream_timestamps = before
        return holds


def by_pymavlink(frames: Sequence[bytes], judge: Any = mavlink.MAVLink, key: bytes = KEY) -> list[bool]:
    """Which frames a receiver that has the key accepts, as pymavlink decodes one after the other."""
    receiver = judge(None)
    receiver.signing.secret_key = key
    accepted = []
    for frame in frames:
        try:
            receiver.decode(bytearray(frame))
            accepted.append(True)
        except mavlink.MAVError:
            accepted.append(False)
    return accepted


def by_us(frames: Sequence[bytes], key: bytes = KEY, *, together: bool = True) -> list[Outcome | None]:
    """What each frame came to, None of what is no frame; a datagram each, or a batch of its own each."""
    scanner = Scanner(load_dialect(), timed=False, signing=Signing(SigningKey(key), "reject"))
    outcomes: list[Outcome | None] = []
    for frame in frames:
        scanner.scan(frame, final=True)
        assert scanner.outcomes is not None
        assert len(scanner.outcomes) <= 1
        outcomes += [Outcome(one) for one in scanner.outcomes.tolist()] or [None]
    whole = Scanner(load_dialect(), timed=False, signing=Signing(SigningKey(key), "reject"))
    whole.scan(b"".join(frames), final=True)
    assert whole.outcomes is not None
    if None not in outcomes:
        assert whole.outcomes.tolist() == outcomes  # and the same in one batch
    return outcomes


def frame(seq: int = 0, sysid: int = 1, compid: int = 1, version: int = 2) -> bytes:
    return wire.attitude(1000 + seq, (0.1, 0.2, 0.3), seq=seq, sysid=sysid, compid=compid, version=version)


def signed(seq: int, time: int, *, key: bytes = KEY, link: int = 0, **sender: int) -> bytes:
    return wire.signed(frame(seq, **sender), key, time=NOON + time, link=link)


def stripped(whole: bytes) -> bytes:
    """The flag cleared, all else as it was: its checksum fails."""
    return whole[:2] + b"\x00" + whole[3:]


CASES = {
    "valid": ([signed(i, i) for i in range(5)], [HOLDS] * 5),
    "by another key": ([signed(i, i, key=OTHER_KEY) for i in range(5)], [WRONG] * 5),
    "replayed": ([signed(0, 0), signed(1, 1), signed(0, 0), signed(1, 1), signed(2, 2)],
                 [HOLDS, HOLDS, REPLAYED, REPLAYED, HOLDS]),
    "as late as the last": ([signed(0, 7), signed(1, 7)], [HOLDS, REPLAYED]),
    "a late one goes on from": ([signed(0, 0), signed(1, 90 * MINUTE), signed(2, 1)], [HOLDS, HOLDS, REPLAYED]),
    "a new link id, a minute behind": ([signed(0, MINUTE), signed(1, 0, link=1)], [HOLDS, HOLDS]),
    "more than a minute behind": ([signed(0, MINUTE + 1), signed(1, 0, link=1), signed(2, 1, link=1),
                                   signed(3, 2, link=1)], [HOLDS, OLD, HOLDS, HOLDS]),
    "another component, long behind": ([signed(0, 9 * MINUTE), signed(0, 0, compid=2), signed(0, 0, sysid=2)],
                                       [HOLDS, OLD, OLD]),
    "known, long behind": ([signed(0, 0, link=1), signed(0, 9 * MINUTE), signed(1, 1, link=1)], [HOLDS] * 3),
    "unsigned": ([frame(0), frame(1, version=1), frame(2)], [UNSIGNED] * 3),
    "stripped": ([signed(0, 0), stripped(signed(1, 1)), frame(1), signed(2, 2)], [HOLDS, None, UNSIGNED, HOLDS]),
    "changed on the way": ([signed(0, 0), signed(1, 1)[:-13] + signed(2, 2)[-13:], signed(2, 3)],
                           [HOLDS, WRONG, HOLDS]),
    "mixed": ([signed(0, 0), frame(1), signed(1, 1, key=OTHER_KEY), signed(2, 2), frame(3, version=1),
               signed(3, 3, link=4), signed(3, 1)], [HOLDS, UNSIGNED, WRONG, HOLDS, UNSIGNED, HOLDS, REPLAYED]),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_each_frame_is_judged_as_pymavlink_judges_it(name: str) -> None:
    """Accepted by pymavlink, unchanged, is what holds; why the others do not was thought out by hand."""
    frames, outcomes = CASES[name]
    assert by_us(frames) == outcomes
    assert by_pymavlink(frames) == [one is HOLDS for one in outcomes]


def test_the_helper_signs_as_pymavlink_signs() -> None:
    """Byte for byte, so that these cases are of the real protocol."""
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    sender.signing.secret_key, sender.signing.sign_outgoing = KEY, True
    sender.signing.timestamp, sender.signing.link_id, sender.seq = NOON + 5, 3, 9
    message = mavlink.MAVLink_attitude_message(1009, 0.1, 0.2, 0.3, 0, 0, 0)
    assert signed(9, 5, link=3) == message.pack(sender)


def mixture(seed: int) -> list[bytes]:
    """Frames of a few senders over a few links, with right and wrong keys, old and new times, in any order."""
    chance = random.Random(seed)
    times = [0, 1, 2, S, 30 * S, MINUTE - 1, MINUTE, MINUTE + 1, 5 * MINUTE]
    frames: list[bytes] = []
    for i in range(40):
        sender = {"sysid": chance.choice([1, 2]), "compid": chance.choice([1, 190])}
        kind = chance.random()
        if kind < 0.15:
            frames.append(frame(i, version=chance.choice([1, 2]), **sender))
        elif kind < 0.3 and frames:
            frames.append(chance.choice(frames))
        else:
            key = KEY if chance.random() < 0.75 else OTHER_KEY
            time = chance.choice(times) + chance.choice([0, 10 * i, 1000 * i])
            frames.append(signed(i, time, key=key, link=chance.choice([0, 0, 0, 7]), **sender))
    return frames


@pytest.mark.parametrize("seed", range(25))
def test_mixtures(seed: int) -> None:
    """Of everything: as pymavlink judges, once a forged frame moves no time there."""
    frames = mixture(seed)
    outcomes = by_us(frames)
    assert by_pymavlink(frames, Steady) == [one is HOLDS for one in outcomes]
    assert {HOLDS, UNSIGNED, WRONG} <= set(outcomes)


def test_a_forged_frame_does_not_silence_the_true_sender() -> None:
    """With a late time and a wrong key it does so in pymavlink; in the C library of the autopilots, as here, not."""
    frames = [signed(0, 0), signed(1, 99 * MINUTE, key=OTHER_KEY), signed(1, 1), signed(2, 2)]
    assert by_us(frames) == [HOLDS, WRONG, HOLDS, HOLDS]
    assert by_pymavlink(frames) == [True, False, False, False]
    assert by_pymavlink(frames, Steady) == [True, False, True, True]


def recorded() -> Iterator[bytes]:
    for _, one in wire.records((FIXTURES / "g_signed.tlog").read_bytes()):
        yield one


@pytest.mark.parametrize("key", [KEY, OTHER_KEY], ids=["its", "another"])
def test_a_recording_of_a_real_autopilot(key: bytes) -> None:
    """ArduPilot's own signatures, by the key that they were made with: all are right; by another, none.

    As signing was set up it set its clock back twice, by 140 µs, and by pymavlink's rules too 30 frames do not hold.
    """
    frames = list(recorded())
    scanner = Scanner(load_dialect(), timed=True, signing=Signing(SigningKey(key), "flag"))
    scanner.scan((FIXTURES / "g_signed.tlog").read_bytes(), final=True)
    assert scanner.outcomes is not None
    accepted = by_pymavlink(frames, key=key)
    assert (scanner.outcomes == HOLDS).tolist() == accepted
    found, salvage = scanner.salvage.signatures, scanner.salvage
    assert found is not None
    carry = sum(one[0] == 0xFD and one[2] & 1 for one in frames)
    assert (found.holds, found.replayed, found.wrong) == ((carry - 30, 30, 0) if key == KEY else (0, 0, carry))
    assert (found.unsigned, found.refused, salvage.signed) == (len(frames) - carry, 0, carry)
    assert carry > 1000
    assert found.unsigned > 100


def test_a_frame_of_an_unknown_id_moves_no_time() -> None:
    """pymavlink does not look at it; a message of a newer dialect is no reason to refuse what is known."""
    unknown = wire.with_checksum(b"\xfd\x01\x01\x00\x05\x01\x01\xde\xbc\x0a" + b"\x01" + b"\x00\x00", 0)
    unknown += b"\x00" + (NOON + MINUTE).to_bytes(6, "little")
    unknown += hashlib.sha256(KEY + unknown).digest()[:6]
    frames = [signed(0, 0), unknown, signed(1, 1)]
    assert by_us(frames) == [HOLDS, HOLDS, HOLDS]
    forged = unknown[:-1] + bytes([unknown[-1] ^ 1])
    assert by_us([frames[0], forged, frames[2]]) == [HOLDS, Outcome.UNKNOWN, HOLDS]


@pytest.mark.parametrize("key", [b"", bytes(31), bytes(33), b"secret-secret-secret-secret-secret-secret"])
def test_a_key_of_another_length_is_refused_and_not_told(key: bytes) -> None:
    """The line has the length alone."""
    with pytest.raises(UsageError) as refused:
        Signing.of(key, None)
    assert str(refused.value) == f"a signing key has 32 bytes: {len(key)} given"


def test_what_is_asked_for_must_be_possible() -> None:
    """Nothing can be rejected by a key that is not there; without any, nothing is asked for."""
    assert Signing.of(None, None) is Signing.of(None, "accept") is None
    for unsigned in ("flag", "reject"):
        with pytest.raises(UsageError, match="needs the signing key"):
            Signing.of(None, unsigned)
    with pytest.raises(UsageError, match="'drop': it must be one of accept, flag, reject"):
        Signing.of(KEY, "drop")
    with_key = Signing.of(KEY, None)
    assert with_key is not None
    assert with_key.unsigned == "flag"


def test_the_key_does_not_show() -> None:
    """In no representation of what holds it."""
    shown = repr(Signing.of(b"A" * 32, "reject"))
    assert "AAAA" not in shown
    assert "4141" not in shown
    assert not hasattr(SigningKey(KEY), "__dict__")
