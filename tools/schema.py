"""Writes the JSON Schemas of reports, events and what the doctor tells, of the structs that they are made of.

python tools/schema.py           # writes gcs_bridge/schema/*.json; a second run changes nothing
python tools/schema.py --check   # exit 1 if they are not what would be written
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import msgspec

from gcs_bridge.events import AnyEvent
from gcs_bridge.inspection.schema import Examination
from gcs_bridge.report import Report

FOLDER = Path(__file__).parents[1] / "gcs_bridge" / "schema"
_ROOTS: dict[str, tuple[Any, str]] = {
    "report": (Report, "gcs-bridge/report/1: what `gcs-bridge check --format json` writes"),
    "event": (AnyEvent, "an event of gcs-bridge: a line of `--events`, or what `gcs_bridge.Monitor` returns"),
    "doctor": (Examination, "gcs-bridge/doctor/1: what `gcs-bridge doctor --format json` writes"),
}


def schemas() -> dict[str, str]:
    """The files' texts by their names. A key that is not named may be added: who reads must pass over it."""
    texts = {}
    for name, (root, title) in _ROOTS.items():
        head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": title}
        texts[f"{name}.json"] = json.dumps(head | msgspec.json.schema(root), indent=2, ensure_ascii=False) + "\n"
    return texts


def main() -> int:
    """Write or check; 1 if something is to be written anew."""
    stale = [
        name
        for name, text in schemas().items()
        if not (FOLDER / name).exists() or (FOLDER / name).read_text(encoding="utf-8") != text
    ]
    if "--check" in sys.argv[1:]:
        for name in stale:
            print(f"gcs_bridge/schema/{name} is not what the structs say: run python tools/schema.py")
        return int(bool(stale))
    FOLDER.mkdir(exist_ok=True)
    for name in stale:
        (FOLDER / name).write_text(schemas()[name], encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
