"""Signed links: what is refused changes nothing, what is amiss is told once, and the key is nowhere.

Flights are made by hand (tests/helpers/wire.py) and signed by the protocol's own description.
"""

import json
from collections.abc import Callable, Sequence
from typing import Any

import pytest

from gcs_bridge import Monitor
from gcs_bridge.judging import monitor as judging
from gcs_bridge.mavlink.signing import SigningKey
from tests.helpers import wire
from tests.helpers.everyday import one_in
from tests.helpers.paths import FIXTURES

Record = tuple[int, bytes]
Json = dict[str, Any]
KEY, OTHER_KEY = bytes(range(32)), b"!" * 32
S = 1_000_000
NOON = 35_000_000_000_000  # in units of 10 µs since 2015
TURNED = (0.0, 0.0, 2.5)  # rad, not where any of these flights points


def sign(records: Sequence[Record], key: bytes = KEY, *, late_us: int = 0, link: int = 0) -> list[Record]:
    """The records, signed at their times, or later than they came; no two at one time."""
    return [
        (t_us, wire.signed(frame, key, time=NOON + (t_us - wire.START_US + late_us) // 10 + i, link=link))
        for i, (t_us, frame) in enumerate(records)
    ]


def flown(seconds: float = 12.0) -> list[Record]:
    return sign(wire.flight(wire.Motion(seconds, seed=3), seconds, euler_hz=10.0, quaternion_hz=10.0))


def forged(seconds: float = 12.0, **wired: Any) -> list[Record]:
    """ATTITUDE of another attitude at the times of the true ones, under the numbers that come next."""
    true = wire.flight(wire.Motion(seconds, seed=3), seconds, euler_hz=10.0, quaternion_hz=0.0)
    return [
        (t_us + 3, wire.attitude(10_000 + (t_us - wire.START_US) // 1000, TURNED, seq=100 + i, **wired))
        for i, (t_us, _) in enumerate(true)
    ]


def judged(
    records: Sequence[Record], unsigned: str | None = "reject", key: bytes | None = KEY
) -> tuple[Json, list[Json]]:
    """The recording's entry in the report, and the events."""
    monitor = Monitor(signing_key=key, unsigned=unsigned)  # type: ignore[arg-type]  # as a user may give it
    events = monitor.feed_recording(wire.tlog(records)) + monitor.finish()
    (entry,) = monitor.close().to_dict()["files"]
    return entry, events


def merged(*several: Sequence[Record]) -> list[Record]:
    return sorted((one for records in several for one in records), key=lambda one: one[0])


def told(events: Sequence[Json]) -> list[tuple[str, list[int]]]:
    return [(event["signature"], event["sender"]) for event in events if event["event"] == "damage"]


FORGERIES: dict[str, Callable[[], list[Record]]] = {
    "unsigned": forged,
    "wrong": lambda: sign(forged(), OTHER_KEY),
    # With a time far ahead, which silences the true sender in a judge that believes it.
    "wrong, late": lambda: sign(forged(), OTHER_KEY, late_us=3600 * S),
    "replayed": lambda: [(t_us + 2 * S, frame) for t_us, frame in flown(9.0)],
    "old": lambda: sign(forged(), late_us=-3600 * S, link=5)[:1],
    "unsigned, MAVLink 1": lambda: forged(version=1),
}


@pytest.mark.parametrize("kind", one_in(2, FORGERIES))
def test_a_forged_attitude_changes_nothing_when_rejected(kind: str) -> None:
    """The vehicles' part of the report, and all events but that it was refused, are as if it had not come."""
    alone, quiet = judged(flown())
    mixed = merged(flown(), FORGERIES[kind]())
    entry, events = judged(mixed)
    assert entry["vehicles"] == alone["vehicles"]
    assert entry["vehicles"][0]["verdict"] == "agree"
    assert entry["vehicles"][0]["streams"]["ATTITUDE"]["lost"] == 0
    assert [event for event in events if event["event"] != "damage"] == quiet
    what = kind.split(",", maxsplit=1)[0]
    assert told(events) == [(what, [1, 1])]
    count = len(mixed) - len(flown())
    expected = {"valid": len(flown()), "unsigned": 0, "wrong": 0, "replayed": 0, "old": 0, "refused": count}
    assert entry["salvage"]["signatures"] == expected | {what: count}
    assert entry["salvage"]["frames"] == len(mixed)


@pytest.mark.parametrize("kind", ["unsigned", "wrong"])
@pytest.mark.parametrize("unsigned", one_in(2, ["accept", "flag", None], swept=False))
def test_otherwise_it_raises_an_alarm_and_is_told(kind: str, unsigned: str | None) -> None:
    """So that the test above is of something; unsigned frames among signed ones are told in any case."""
    entry, events = judged(merged(flown(), FORGERIES[kind]()), unsigned)
    assert entry["verdict"] == "alarm"
    assert told(events) == [(kind, [1, 1])]
    assert entry["salvage"]["signatures"]["refused"] == 0


def test_accepted_is_not_told_where_nobody_signs() -> None:
    """`accept` is for links that are not signed yet; `flag` tells of them, `reject` sees nothing on them."""
    plain = wire.flight(wire.Motion(6, seed=3), 6, euler_hz=10.0, quaternion_hz=10.0)
    assert told(judged(plain, "accept")[1]) == []
    entry, events = judged(plain, "flag")
    assert told(events) == [("unsigned", [1, 1])]
    assert entry["verdict"] == "agree"
    entry, events = judged(plain, "reject")
    assert told(events) == [("unsigned", [1, 1])]
    assert (entry["verdict"], entry["vehicles"]) == ("no_compare", [])


def test_each_run_is_told_once() -> None:
    """Again only when none came for ten seconds; each sender by itself, radios that cannot sign not at all."""
    beats = [(wire.START_US + s * S, s) for s in (0, 1, 2, 11, 22, 23)]
    station = [(t_us, wire.heartbeat(sysid=255, compid=190, seq=s)) for t_us, s in beats]
    other = [(t_us, wire.heartbeat(sysid=9, compid=1, seq=s)) for t_us, s in beats[:2]]
    radio = [(t_us, wire.heartbeat(sysid=51, compid=68, seq=s)) for t_us, s in beats]
    _, events = judged(merged(station, other, radio, flown(25.0)))
    assert told(events) == [("unsigned", [255, 190]), ("unsigned", [9, 1]), ("unsigned", [255, 190])]
    reasons = [event["reason"] for event in events if event["event"] == "damage"]
    assert reasons[0] == "255,190: frames without a signature; they are not used"
    times = [event["utc"] for event in events if event["event"] == "damage"]
    assert times[0] < times[2]


def test_without_a_key_a_signed_and_an_unsigned_sender_of_one_identity_are_told() -> None:
    """It is not verified, and seen all the same; a station that never signs is another one."""
    station = [(wire.START_US + s * S, wire.heartbeat(sysid=255, compid=190, seq=s)) for s in range(12)]
    entry, events = judged(merged(flown(), station), None, key=None)
    assert told(events) == []
    assert entry["salvage"]["signatures"] is None
    assert entry["salvage"]["signed"] == len(flown())
    beats = [(t_us + 7, wire.heartbeat(seq=200 + i)) for i, (t_us, _) in enumerate(station)]
    entry, events = judged(merged(flown(), station, beats), None, key=None)
    assert told(events) == [("unsigned", [1, 1])]
    assert "with and without a signature" in next(e["reason"] for e in events if e["event"] == "damage")


@pytest.mark.slow
@pytest.mark.parametrize("unsigned", ["flag", "reject"])
def test_cut_anywhere(unsigned: str) -> None:
    """Whole, in pieces of 37 bytes and a record at a time: the same events in the same order, and the same report."""
    strange = [(t_us, frame) for t_us, frame in forged(5.0) if t_us % (2 * S) < S // 2]
    beats = [(wire.START_US + s * S + 11, wire.heartbeat(sysid=255, compid=190, seq=s)) for s in range(5)]
    data = wire.tlog(merged(flown(5.0), strange, beats))
    stories = []
    for size in (len(data), 37, 60):
        monitor = Monitor(signing_key=KEY, unsigned=unsigned)  # type: ignore[arg-type]  # one of them
        events = [e for at in range(0, len(data), size) for e in monitor.feed_recording(data[at : at + size])]
        events += monitor.finish()
        stories.append(json.dumps([events, monitor.close().to_dict()]))
    assert stories[1:] == stories[:-1]
    assert '"signature": "unsigned"' in stories[0]


def test_each_link_is_verified_by_itself() -> None:
    """The same frames over two radios are no replay on either."""
    monitor = Monitor(signing_key=KEY, unsigned="reject")
    for t_us, frame in flown(3.0):
        monitor.feed(frame, t_us, link=0)
        monitor.feed(frame, t_us + 40, link=1)
    for entry in monitor.close().to_dict()["files"]:
        assert entry["salvage"]["signatures"]["refused"] == 0
        assert entry["salvage"]["signatures"]["valid"] == len(flown(3.0))


def test_a_link_of_which_all_is_refused_is_no_noise() -> None:
    """Frames were found there: `listen` tells of a link without any by this number."""
    monitor = judging.Monitor(signing_key=SigningKey(OTHER_KEY), unsigned="reject")
    for t_us, frame in flown(3.0):
        monitor.feed(frame, t_us)
    assert monitor.frames_of(0) == len(flown(3.0))
    assert monitor.snapshot().vehicles == ()


def test_a_recording_in_which_signing_is_set_up() -> None:
    """ArduPilot's: by its key each signature is valid, and what was judged is the same with and without the key."""
    records = list(wire.records((FIXTURES / "g_signed.tlog").read_bytes()))
    flagged, events = judged(records, None)
    unverified, _ = judged(records, None, key=None)
    assert flagged["vehicles"] == unverified["vehicles"]
    found = flagged["salvage"]["signatures"]
    assert found["valid"] + found["replayed"] == flagged["salvage"]["signed"] > 1000
    assert (found["replayed"], found["wrong"], found["old"]) == (30, 0, 0)  # its clock was set back twice
    assert found["unsigned"] == len(records) - flagged["salvage"]["signed"]
    assert {signature for signature, _ in told(events)} == {"unsigned", "replayed"}
