"""Copy a window of a .tlog, record by record and byte for byte.

A record is an 8-byte big-endian time stamp (microseconds UTC) and one MAVLink frame. pymavlink's reader is used for
one thing only: to find where each record of an undamaged recording begins. A damaged recording has no trustworthy
borders, so it is cut with `--bytes`.

    python trim.py whole.tlog cut.tlog --from 44 --to 72        # seconds after the recording's first record
    python trim.py whole.tlog cut.tlog --bytes 205000:395000

One line of JSON on stdout says what was cut from what; the figures go into provenance.toml.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import json
import os
import struct
import sys
from pathlib import Path
from typing import Any

STAMP_BYTES = 8


class DamagedError(ValueError):
    """The recording has no trustworthy record borders."""


def record_offsets(path: Path) -> list[tuple[int, int]]:
    """(offset, time stamp in microseconds) of every record, and a last pair that marks the end of the file."""
    os.environ["MAVLINK20"] = "1"
    # Loaded by name because pymavlink ships without types: everything from it is Any, and only here.
    mavutil: Any = importlib.import_module("pymavlink.mavutil")
    data = path.read_bytes()
    log: Any = mavutil.mavlink_connection(str(path), dialect="all", robust_parsing=True)
    pairs: list[tuple[int, int]] = []
    offset = 0
    while True:
        message = log.recv_msg()
        if message is None:
            break
        frame = bytes(message.get_msgbuf())
        begin = offset + STAMP_BYTES
        if message.get_type() == "BAD_DATA" or data[begin : begin + len(frame)] != frame:
            raise DamagedError(f"{path.name}: damaged at byte {offset}; cut it with --bytes")
        pairs.append((offset, struct.unpack_from(">Q", data, offset)[0]))
        offset = begin + len(frame)
    log.close()
    if not pairs or offset != len(data):
        raise DamagedError(f"{path.name}: {len(data) - offset} bytes after the last whole record; cut it with --bytes")
    pairs.append((offset, pairs[-1][1]))
    return pairs


def time_window(path: Path, from_s: float, to_s: float) -> tuple[int, int]:
    """Byte range from the first record at or after `from_s` up to the first at or after `to_s`.

    The range is one contiguous piece, also where record times run backwards by a little.
    """
    pairs = record_offsets(path)
    start_us = pairs[0][1]
    end = pairs[-1][0]
    first = next((offset for offset, t_us in pairs[:-1] if t_us - start_us >= from_s * 1e6), end)
    last = next((offset for offset, t_us in pairs[:-1] if offset >= first and t_us - start_us >= to_s * 1e6), end)
    return first, last


def byte_range(text: str) -> tuple[int, int]:
    first, _, last = text.partition(":")
    return int(first), int(last)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Copy a window of a .tlog byte for byte.")
    parser.add_argument("source", type=Path)
    parser.add_argument("destination", type=Path)
    parser.add_argument("--from", dest="from_s", type=float, default=0.0, metavar="S", help="seconds of record time")
    parser.add_argument(
        "--to", dest="to_s", type=float, default=float("inf"), metavar="S", help="seconds of record time"
    )
    parser.add_argument("--bytes", type=byte_range, metavar="FIRST:LAST", help="byte range, for damaged recordings")
    arguments = parser.parse_args(argv)

    data = arguments.source.read_bytes()
    try:
        first, last = arguments.bytes or time_window(arguments.source, arguments.from_s, arguments.to_s)
    except DamagedError as error:
        print(error, file=sys.stderr)
        return 3
    piece = data[first:last]
    if not piece:
        print(f"{arguments.source.name}: nothing in that window", file=sys.stderr)
        return 2
    arguments.destination.write_bytes(piece)
    cut = {
        "original_bytes": len(data),
        "original_sha256": hashlib.sha256(data).hexdigest(),
        "first_byte": first,
        "last_byte": first + len(piece),
    }
    print(json.dumps({"recording": arguments.destination.name} | cut))
    return 0


if __name__ == "__main__":
    sys.exit(main())
