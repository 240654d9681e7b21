"""Runs what the pages of the documentation tell people to type, and writes anew what they show of its output.

python -m tools.captures            # every console block; tests/site/test_commands.py says which are stale
python -m tools.captures PAGE ...   # those of some pages, as docs/wrong-attitude.md

Where a page shows parts of an output, with `…` alone on a line between them, the same parts are taken: each begins with
the same words as before, and goes on as far as it is indented.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

from gcs_bridge.cli import main as gcs_bridge
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from tools.site_pages import PAGES, ROOT, Command, as_shown, blocks, commands, inline_code

NOT_RUN = {
    r"pip install": "makes an environment of a package index: .ci/run does, by the README's own line",
    r"^\.venv/bin/pytest|^(\.venv/bin/)?sphinx-build": "is how tests are run; tests/site/test_built.py builds the site",
    r"^gcs-bridge (listen|demo)\b": "waits on a link until it is stopped: tests/cli/test_listen.py, test_demo.py",
    r"^gcs-bridge doctor (udpin|tcp|/dev)": "waits on a link for ten seconds: tests/inspection/",
    r"^gcs-bridge survey .*(s3://|--scheduler)|^dask ": "needs a bucket or a scheduler: tests/survey/ brings its own",
    r"^curl ": "asks a program that listens: tests/metrics/",
    r"^rerun ": "opens a window: tests/viewer/test_importer.py runs the importer",
    r"^python -m benchmarks\b": "takes minutes",
    r"^python (make_facts|trim)\.py": "of sitl_fixtures/, on uncut recordings; .ci/run checks the facts",
}
"""By pattern: why a command is not run. What is gcs-bridge's own is read by its command line all the same."""

TABLES = ("README.md", "docs/jobs.md")
"""Pages whose commands stand in a table; of two that have the same, the first one's are run."""

NO_REPORT = {"schema": "gcs-bridge/report/1", "version": "0", "verdict": "no_compare", "files": []}
_PARTS = "…"


def typed(page: str) -> list[Command]:
    """What the page has people type and can be run, in its order; that of its tables last."""
    found = [one for block in blocks(page, "console", "sh") for one in commands(block)]
    if page in TABLES:
        before = [code for other in TABLES[: TABLES.index(page)] for code in inline_code(other)]
        found += [Command(code, None) for code in inline_code(page) if _is_ours(code) and code not in before]
    return [one for one in found if why_not(one.line) is None and not re.search("COMMAND|…", one.line)]


def why_not(line: str) -> str | None:
    """The reason not to run a command; None where it is run."""
    return next((reason for pattern, reason in NOT_RUN.items() if re.search(pattern, line)), None)


def words(line: str) -> list[str]:
    """The words of a command, without what only stands for more of them."""
    return [word for word in shlex.split(line, comments=True) if word != _PARTS]


def prepare(folder: Path) -> None:
    """Lay out where somebody stands who types along: beside the recordings of a checkout, with some of their own."""
    faulty = [parse_fault("yaw_offset:25")]
    flight = inject((ROOT / "sitl_fixtures/c_copter_4hz.tlog").read_bytes(), faulty, from_s=5.0, to_s=10.0)
    for name in ("sitl_fixtures", "config"):
        (folder / name).symlink_to(ROOT / name)
    (folder / "logs").mkdir()
    for name in ("logs/one.tlog", "flight.tlog", "before.tlog", "after.tlog"):
        (folder / name).write_bytes(flight)
    (folder / "key").write_bytes(bytes(range(32)))
    (folder / "key").chmod(0o600)
    (folder / "before.json").write_text(json.dumps(NO_REPORT))


def run(line: str) -> tuple[int, str]:
    """A command in the current folder: its exit code and what it says; on standard error where nothing else.

    What is gcs-bridge's alone runs in this process, all else by a shell that finds this gcs-bridge.
    """
    if _is_ours(line) and not re.search(r"[|;&<>\n]", line):
        return _run_here(words(line)[1:])
    with tempfile.TemporaryDirectory() as programs:
        ours = Path(programs, "gcs-bridge")
        ours.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m gcs_bridge "$@"\n')
        ours.chmod(0o755)
        found = {"PATH": f"{programs}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}
        ended = subprocess.run(
            ["bash", "-c", line], env={**os.environ, **found}, capture_output=True, text=True, check=False
        )
        return ended.returncode, ended.stdout or ended.stderr


def _run_here(arguments: list[str]) -> tuple[int, str]:
    if arguments[0] == "replay" and "--viewer" not in arguments:
        arguments += ["--viewer", "none"]  # else it is shown until somebody closes it
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True) for _ in range(2))
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = gcs_bridge(arguments)
    told, complained = (stream.buffer.getvalue().decode() for stream in (out, err))
    return code, told or complained


def _is_ours(line: str) -> bool:
    return line.startswith("gcs-bridge ")


def same_parts(shown: str, said: str) -> str:
    """Of what is said, the parts that were shown of it before; ValueError where one of them is not there."""
    lines = said.rstrip("\n").split("\n")
    if _PARTS not in shown:
        return "\n".join(lines) + "\n"
    parts, at = [], 0
    for begin in _beginnings(shown.rstrip("\n").split("\n")):
        first = next((i for i in range(at, len(lines)) if lines[i].startswith(begin)), None)
        if first is None:
            raise ValueError(f"nothing begins with {begin.strip()!r}")
        last = next((i for i in range(first + 1, len(lines)) if _indent(lines[i]) <= _indent(begin)), len(lines))
        parts += [_PARTS] * (first > at) + lines[first:last]
        at = last
    return "\n".join(parts + [_PARTS] * (at < len(lines))) + "\n"


def _beginnings(shown: Iterable[str]) -> Iterator[str]:
    """The first words of each part that is shown: of lines that are not indented below the one before."""
    above = None
    for line in shown:
        if line == _PARTS:
            above = None
        elif above is None or _indent(line) <= _indent(above):
            above = line
            first = re.match(r" *\S+(?: +[A-Za-z_]+)?", line)
            yield first[0] if first else line


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip())


def main() -> int:
    """Write anew what is stale, and name it; 1 if something must be mended by hand."""
    by_hand = 0
    for page in sys.argv[1:] or PAGES:
        text = (ROOT / page).read_text(encoding="utf-8")
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
            prepare(Path(folder))
            for line, shown in typed(page) if any(one.shown for one in typed(page)) else []:
                said = run(line)[1]
                if shown is None or as_shown(shown).fullmatch(said.rstrip("\n") + "\n"):
                    continue
                try:
                    text = text.replace(f"$ {line}\n{shown}", f"$ {line}\n{same_parts(shown, said)}")
                    print(f"{page}: written anew: {line}")
                except ValueError as error:
                    print(f"{page}: mend by hand: {line}: {error}")
                    by_hand = 1
        (ROOT / page).write_text(text, encoding="utf-8")
    return by_hand


if __name__ == "__main__":
    sys.exit(main())
