"""Judges recordings with two checkouts and lists every difference in reports, events and evidence tables.

    python tools/compare_checkouts.py BEFORE AFTER RECORDING_OR_FOLDER…

BEFORE and AFTER are checkouts, or folders that an earlier run has left behind with `--keep`. Both run under this
interpreter. Ends with 1 if anything differs; `--ignore id` passes over keys that are meant to.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

_SUFFIXES = (".tlog", ".raw", ".rlog")
_SAID = 8  # differences of one recording that are spelled out

# Runs inside a checkout, by names that users may rely on: whatever its insides look like.
_DRIVER = """
import json, sys
from pathlib import Path

import gcs_bridge
from gcs_bridge.cli import main

for line in sys.stdin:
    recording, out = json.loads(line)
    out = Path(out)
    out.mkdir(parents=True)
    main(["check", recording, "--quiet", "--format", "json", "--output", str(out / "report.json"),
          "--evidence", str(out / "evidence")])
    monitor = gcs_bridge.Monitor()
    data = Path(recording).read_bytes()
    timed = recording.endswith(".tlog")
    with (out / "events.jsonl").open("w") as file:
        for start in range(0, len(data), 65536):
            piece = data[start : start + 65536]
            for event in monitor.feed_recording(piece) if timed else monitor.feed(piece, -1):
                file.write(json.dumps(event) + "\\n")
"""


def main() -> int:
    """Compare; 1 if anything differs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("recordings", nargs="+", type=Path)
    parser.add_argument("--keep", type=Path, help="leave the results of AFTER in this folder")
    parser.add_argument("--ignore", action="append", default=[], metavar="KEY", help="a key that may differ")
    parser.add_argument("--within", type=float, default=0.0, metavar="X", help="numbers this near are equal")
    given = parser.parse_args()
    recordings = [path.resolve() for path in _found(given.recordings)]
    with tempfile.TemporaryDirectory() as scratch:
        folders = [Path(scratch) / "before", given.keep or Path(scratch) / "after"]
        runs = []
        for at, checkout in enumerate((given.before, given.after)):
            if (checkout / "gcs_bridge").is_dir():
                runs.append(_start(checkout, folders[at], recordings))
            else:
                folders[at] = checkout
        if sum(run.wait() for run in runs):
            return 2
        different = 0
        for place, recording in enumerate(recordings):
            before, after = (folder / _name(place, recording) for folder in folders)
            found = list(_compare(before, after, set(given.ignore), given.within))
            different += bool(found)
            for line in found[:_SAID]:
                print(f"{recording.name}: {line}")
            if len(found) > _SAID:
                print(f"{recording.name}: and {len(found) - _SAID} more")
    print(f"{len(recordings)} recordings, {different} with differences")
    return int(different > 0)


def _found(paths: list[Path]) -> Iterator[Path]:
    for path in paths:
        yield from sorted(one for one in path.rglob("*") if one.suffix in _SUFFIXES) if path.is_dir() else [path]


def _name(place: int, recording: Path) -> str:
    return f"{place:03}-{recording.name}"


def _start(checkout: Path, folder: Path, recordings: list[Path]) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-P", "-c", _DRIVER],  # -P: or the folder that it is run in comes first
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "PYTHONPATH": str(checkout.resolve())},
    )
    assert process.stdin is not None
    for place, recording in enumerate(recordings):
        process.stdin.write(json.dumps([str(recording), str((folder / _name(place, recording)).resolve())]) + "\n")
    process.stdin.close()
    return process


def _compare(before: Path, after: Path, ignored: set[str], within: float) -> Iterator[str]:
    """The differences between two results."""
    for name in ("report.json", "events.jsonl"):
        texts = [(folder / name).read_text() if (folder / name).exists() else None for folder in (before, after)]
        if texts[0] != texts[1]:
            one, other = (_parsed(name, text) for text in texts)
            told = list(_apart(one, other, name, ignored, within))
            yield from told if told or ignored or within else [f"{name}: the bytes differ, the values do not"]
    tables = sorted({str(path.relative_to(f)) for f in (before, after) for path in f.rglob("*.parquet")})
    for name in tables:
        if not ((before / name).exists() and (after / name).exists()):
            yield f"{name}: only {'after' if (after / name).exists() else 'before'}"
            continue
        one, other = (pq.read_table(folder / name) for folder in (before, after))
        if one.schema != other.schema:
            yield f"{name}: other columns"
        elif not one.equals(other):  # NaN is not equal to itself: row by row
            yield from _apart(one.to_pylist(), other.to_pylist(), name, ignored, within)


def _parsed(name: str, text: str | None) -> Any:
    if text is None:
        return None
    return json.loads(text) if name.endswith(".json") else [json.loads(line) for line in text.splitlines()]


def _apart(one: Any, other: Any, path: str, ignored: set[str], within: float) -> Iterator[str]:
    if isinstance(one, dict) and isinstance(other, dict):
        if list(one) != list(other):
            yield f"{path}: keys {list(one)} and {list(other)}"
        for key in one.keys() & other.keys() - ignored:
            yield from _apart(one[key], other[key], f"{path}.{key}", ignored, within)
    elif isinstance(one, list) and isinstance(other, list):
        if len(one) != len(other):
            yield f"{path}: {len(one)} and {len(other)} entries"
        for at, (a, b) in enumerate(zip(one, other, strict=False)):
            yield from _apart(a, b, f"{path}[{at}]", ignored, within)
    elif one != other and not (isinstance(one, float) and isinstance(other, float) and _alike(one, other, within)):
        by = f" (by {abs(one - other):.3g})" if isinstance(one, float) and isinstance(other, float) else ""
        yield f"{path}: {one!r} and {other!r}{by}"


def _alike(one: float, other: float, within: float) -> bool:
    return abs(one - other) <= within or (math.isnan(one) and math.isnan(other))


if __name__ == "__main__":
    sys.exit(main())
