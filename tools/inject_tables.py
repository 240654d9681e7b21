"""Writes the tables of docs/inject.md: each fault put into the demo flight, and what `gcs-bridge check` then says.

python tools/inject_tables.py           # writes them; a second run changes nothing
python tools/inject_tables.py --check   # exit 1 if the page is not what would be written
"""

from __future__ import annotations

import re
import sys
import tempfile
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

from gcs_bridge import check
from gcs_bridge.diagnosis.causes import CAUSES
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject_file
from gcs_bridge.recordings.link_faults import LINK_FAULTS
from gcs_bridge.resources import demo_recording

PAGE = Path(__file__).parents[1] / "docs" / "inject.md"
FROM_S = 60.0
"""The demo flight hovers then, and tilts some ten seconds later."""

LINK_VALUES = {
    "loss": "0.1",
    "reorder": "0.1",
    "duplicate": "0.1",
    "corrupt": "0.001",
    "truncate": "100000",
    "thin": "ATTITUDE_QUATERNION=4",
}


def judged(fault: str, *, from_s: float | None = None) -> dict[str, Any]:
    """The report's entry of the demo flight with the fault in it."""
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "faulty.tlog"
        inject_file(demo_recording(), target, [parse_fault(fault)], from_s=from_s)
        entry: dict[str, Any] = check(target).to_dict()["files"][0]
        return entry


def mistakes() -> Iterator[tuple[str, ...]]:
    """A row a mistake: the alarm, its delay and size, the cause that is named, and what other checks raise."""
    yield "fault", "raised after", "differs by up to", "tilt", "heading", "cause named", "raised by other checks"
    start_s = int.from_bytes(demo_recording().read_bytes()[:8], "big") / 1e6
    for name, cause in CAUSES.items():
        if cause.falsify is None:
            continue
        (vehicle,) = judged(name, from_s=FROM_S)["vehicles"]
        first = {alarm["check"]: alarm for alarm in reversed(vehicle["alarms"])}
        alarm = first.pop("euler_quaternion", None)
        of_others = (other["diagnosis"] for other in first.values() if other["diagnosis"] is not None)
        told: tuple[str, ...] = ("never", "–", "–", "–", named(next(of_others, None)))
        if alarm is not None:
            after_s = datetime.fromisoformat(alarm["raised_utc"]).timestamp() - start_s - FROM_S
            sizes = (
                "unknown" if alarm[key] is None else f"{abs(alarm[key]):.1f}°" for key in ("peak", "tilt", "heading")
            )
            told = (f"{after_s:.1f} s", *sizes, named(alarm["diagnosis"]))
        others = " ".join(f"`{check}`" for check in sorted(first)) or "–"
        yield f"`{parse_fault(name)}`", *told, others


def named(diagnosis: dict[str, Any] | None) -> str:
    """The causes that the report names, the likeliest first."""
    if diagnosis is None:
        return "–"
    others = [cause for cause in diagnosis["candidates"] if cause != diagnosis["cause"]]
    return " or ".join(f"`{cause}`" for cause in (diagnosis["cause"], *others))


def link_faults() -> Iterator[tuple[str, ...]]:
    """A row a fault of the link: what is counted, and that it is no disagreement."""
    yield "fault", "frames", "bad checksums", "doubled", "ATTITUDE_QUATERNION", "lost of it", "verdict"
    for fault in ("", *(f"{name}:{LINK_VALUES[name]}" for name in LINK_FAULTS)):
        entry = judged(fault) if fault else check(demo_recording()).to_dict()["files"][0]
        (vehicle,) = entry["vehicles"]
        stream, salvage = vehicle["streams"]["ATTITUDE_QUATERNION"], entry["salvage"]
        numbers = (
            salvage["frames"],
            salvage["bad_crc"],
            salvage["duplicates"],
            f"{stream['rate_hz']:.1f} Hz",
            stream["lost"],
        )
        yield f"`{fault}`" if fault else "none", *map(str, numbers), entry["verdict"].upper()


def as_markdown(rows: Iterator[tuple[str, ...]]) -> str:
    """A table whose first row is its head."""
    head, *body = rows
    return "".join(f"| {' | '.join(row)} |\n" for row in (head, ("---",) * len(head), *body))


def with_tables(page: str) -> str:
    """The page with its tables made anew, each between its two marks."""
    for name, rows in (("mistakes", mistakes()), ("link-faults", link_faults())):
        table = f"<!-- {name} -->\n\n{as_markdown(rows)}\n<!-- end -->"
        page = re.sub(rf"<!-- {name} -->.*?<!-- end -->", table.replace("\\", r"\\"), page, flags=re.DOTALL)
    return page


def main() -> int:
    """Write the page, or say whether it is up to date."""
    old = PAGE.read_text(encoding="utf-8")
    new = with_tables(old)
    if sys.argv[1:] == ["--check"]:
        return int(new != old)
    PAGE.write_text(new, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
