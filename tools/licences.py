"""Writes docs/licences.md: under which licence everything comes that an installation brings along.

    python tools/licences.py

The licence is what a package's own metadata say.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

PAGE = Path(__file__).resolve().parent.parent / "docs" / "licences.md"
EXTRAS = {"": "the plain installation", "cluster": "`gcs-bridge[cluster]`", "remote": "`gcs-bridge[remote]`"}
_CLASSIFIER = "License :: OSI Approved :: "


def main() -> None:
    """Write the page."""
    lines = [
        "# Licences",
        "",
        "gcs-bridge is under the [Apache License 2.0](../LICENSE). Page and report carry [uPlot](https://github.com/leeoniya/uPlot)",
        "(MIT). What an installation brings along, by what each package says of itself:",
    ]
    known: set[str] = set()
    for extra, called in EXTRAS.items():
        found = {name: licence_of(name) for name in sorted(needed("gcs-bridge", extra)) if name not in known}
        known |= set(found)
        lines += ["", f"## {called[0].upper()}{called[1:]}" if not extra else f"## {called}, in addition", ""]
        lines += ["| package | licence |", "| --- | --- |"]
        lines += [f"| {name} | {licence} |" for name, licence in found.items()]
    PAGE.write_text("\n".join(lines) + "\n", encoding="utf-8")
    sys.stdout.write(f"{PAGE}: {len(known)} packages\n")


def needed(name: str, extra: str) -> set[str]:
    """All that a package needs, directly or not, on this machine."""
    found: set[str] = set()
    waiting = [(name, extra)]
    while waiting:
        for wanted in requirements(*waiting.pop()):
            called = canonicalize_name(wanted.name)
            if called not in found:
                found.add(called)
                waiting += [(called, one) for one in ("", *wanted.extras)]
    return found - {name}


def requirements(name: str, extra: str) -> Iterator[Requirement]:
    """What a package asks for, with one of its extras."""
    here = {**{key: str(value) for key, value in default_environment().items()}, "extra": extra}
    for text in metadata.requires(name) or ():
        wanted = Requirement(text)
        if wanted.marker is None or wanted.marker.evaluate(here):
            yield wanted


def licence_of(name: str) -> str:
    """What a package says of its licence, in a few words."""
    told = metadata.metadata(name)
    if "License-Expression" in told:
        return told["License-Expression"]
    classifiers: list[str] = told.get_all("Classifier") or []
    licences = [one.removeprefix(_CLASSIFIER) for one in classifiers if one.startswith(_CLASSIFIER)]
    if licences:
        return ", ".join(licences)
    words = re.split(r"[\n,;]", told["License"].strip())[0] if "License" in told else ""
    return words if 0 < len(words) < 60 else "see the package"


if __name__ == "__main__":
    main()
