"""How many frames of a damaged recording are recovered, by gcs-bridge and by pymavlink.

Six damages are done to the first frames of a recording, each at random places from a fixed seed. A frame counts as
recovered if it is, byte for byte, one of those that the damage left whole; any other one is false.

    python -m benchmarks.damage long.tlog
    python -m benchmarks.damage long.tlog --write FOLDER    # the damaged recordings, for others to read
"""

from __future__ import annotations

import argparse
import json
import random
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks import COMPARED
from benchmarks.make_recording import CRC_BYTES, HEADER_BYTES, STAMP_BYTES, Record, records

FRAMES = 20_000
SEED = 7
UNKNOWN_ID = 0x7FFFF0  # in no dialect


class Damaged(NamedTuple):
    """A damaged recording: its bytes, and which of the original frames are not whole in it any more."""

    data: bytes
    hit: frozenset[int]


class Recovered(NamedTuple):
    """Frames that a reader found: of the undamaged ones, and others."""

    good: int
    false: int


def random_bytes(parts: list[bytes], chance: random.Random) -> Damaged:
    return _inserted(parts, [chance.randbytes(1000) for _ in range(10)], chance)


def start_marks(parts: list[bytes], chance: random.Random) -> Damaged:
    return _inserted(parts, [b"\xfd" * 200] * 10, chance)


def bad_checksums(parts: list[bytes], chance: random.Random) -> Damaged:
    all_hit = chance.sample(range(len(parts)), 200)
    for hit in all_hit:
        at = len(parts[hit]) - CRC_BYTES
        parts[hit] = _changed(parts[hit], at, chance)
    return Damaged(b"".join(parts), frozenset(all_hit))


def bad_lengths(parts: list[bytes], chance: random.Random) -> Damaged:
    all_hit = chance.sample(range(len(parts)), 50)
    for hit in all_hit:
        parts[hit] = _changed(parts[hit], STAMP_BYTES + 1, chance)
    return Damaged(b"".join(parts), frozenset(all_hit))


def lost_bytes(parts: list[bytes], chance: random.Random) -> Damaged:
    all_hit = chance.sample(range(len(parts)), 50)
    for hit in all_hit:
        at = chance.randrange(STAMP_BYTES + 1, len(parts[hit]) - 7)
        parts[hit] = parts[hit][:at] + parts[hit][at + 7 :]
    return Damaged(b"".join(parts), frozenset(all_hit))


def unknown_ids(parts: list[bytes], chance: random.Random) -> Damaged:
    unknown = []
    for model in chance.sample(parts, 100):
        at = STAMP_BYTES + HEADER_BYTES - 3
        unknown.append(model[:at] + UNKNOWN_ID.to_bytes(3, "little") + model[at + 3 :])
    return _inserted(parts, unknown, chance)


DAMAGES: dict[str, Callable[[list[bytes], random.Random], Damaged]] = {
    "10 × 1000 random bytes": random_bytes,
    "10 × 200 bytes of 0xFD": start_marks,
    "200 bad checksums": bad_checksums,
    "50 bad lengths": bad_lengths,
    "50 × 7 bytes lost": lost_bytes,
    "100 unknown ids": unknown_ids,
}


def _inserted(parts: list[bytes], pieces: list[bytes], chance: random.Random) -> Damaged:
    """Put the pieces between records; no record is hurt."""
    before = dict(zip(chance.sample(range(1, len(parts)), len(pieces)), pieces, strict=True))
    return Damaged(b"".join(before.get(n, b"") + part for n, part in enumerate(parts)), frozenset())


def _changed(part: bytes, at: int, chance: random.Random) -> bytes:
    """Another value in the byte at `at`."""
    return part[:at] + bytes([part[at] ^ chance.randrange(1, 256)]) + part[at + 1 :]


def found_by_gcs_bridge(path: Path) -> Iterator[bytes]:
    from gcs_bridge.mavlink.dialect import load_dialect
    from gcs_bridge.mavlink.scanner import Scanner

    data = path.read_bytes()
    for frame in Scanner(load_dialect("all"), timed=True).scan(data, final=True):
        start = int(frame["offset"])
        yield data[start : start + HEADER_BYTES + int(frame["length"]) + CRC_BYTES]


def found_by_pymavlink(path: Path) -> Iterator[bytes]:
    from pymavlink import mavutil

    log = mavutil.mavlink_connection(str(path), dialect="all", robust_parsing=True)
    while (message := log.recv_msg()) is not None:
        if message.get_type() != "BAD_DATA" and not message.get_type().startswith("UNKNOWN_"):
            yield bytes(message.get_msgbuf())
    log.close()


def recovered(found: Iterator[bytes], originals: Counter[bytes]) -> Recovered:
    """Compare what was found with what was there. The hit frames' own bytes are gone, so none of them can match."""
    counts = Counter(found)
    good = (counts & originals).total()
    return Recovered(good, counts.total() - good)


def damaged_copies(whole: list[Record]) -> Iterator[tuple[str, Damaged]]:
    """The recording with each damage, and its name; the same in every run."""
    for name, damage in DAMAGES.items():
        parts = [record.t_us.to_bytes(STAMP_BYTES, "big") + record.frame for record in whole]
        yield name, damage(parts, random.Random(SEED))


def write_copies(whole: list[Record], folder: Path) -> list[dict[str, Any]]:
    """Write the damaged recordings; of each its damage, its file, and how many of COMPARED are left whole in it."""
    written = []
    for number, (name, damaged) in enumerate(damaged_copies(whole)):
        path = folder / f"damaged{number}.tlog"
        path.write_bytes(damaged.data)
        left = Counter(record.message.msgname for n, record in enumerate(whole) if n not in damaged.hit)
        written.append({"damage": name, "file": path.name, "whole": {one: left[one] for one in COMPARED}})
    return written


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Count the frames recovered from damaged recordings.")
    parser.add_argument("recording", type=Path, help="undamaged and unsigned, MAVLink 2")
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="only write them there; tells of them as JSON")
    arguments = parser.parse_args(argv)
    whole = records(arguments.recording.read_bytes())[:FRAMES]
    if arguments.write is not None:
        print(json.dumps(write_copies(whole, arguments.write)))
        return 0
    originals = Counter(record.frame for record in whole)
    print(f"| damage to {len(whole):,} frames | left whole | gcs-bridge | pymavlink |\n| --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "damaged.tlog")
        for name, damaged in damaged_copies(whole):
            path.write_bytes(damaged.data)
            shown = []
            for found in (found_by_gcs_bridge, found_by_pymavlink):
                result = recovered(found(path), originals)
                shown.append(f"{result.good:,}" + (f" and {result.false} false" if result.false else ""))
            print(f"| {name} | {len(whole) - len(damaged.hit):,} | {' | '.join(shown)} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
