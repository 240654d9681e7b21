"""What the pages tell people to type: it runs, and says what the page shows; or the reason not to run it is here."""

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import click
import pytest

from gcs_bridge.cli import main
from gcs_bridge.cli.app import COMMANDS, command
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from tests.helpers.paths import FIXTURES, ROOT
from tests.helpers.site_pages import PAGES, Command, all_commands, as_shown, blocks, commands, inline_code

FLIGHT = inject((FIXTURES / "c_copter_4hz.tlog").read_bytes(), [parse_fault("yaw_offset:25")], from_s=5.0, to_s=10.0)

NOT_RUN = {
    r"pip install": "makes an environment of a package index: .ci/run does, by the README's own line",
    r"^\.venv/bin/pytest|^(\.venv/bin/)?sphinx-build": "is how these tests are run; test_built.py builds the site",
    r"^gcs-bridge (listen|demo)\b": "waits on a link until it is stopped: tests/cli/test_listen.py, test_demo.py",
    r"^gcs-bridge doctor (udpin|tcp|/dev)": "waits on a link for ten seconds: tests/inspection/",
    r"^curl ": "asks a program that listens: tests/metrics/",
    r"^rerun ": "opens a window: tests/viewer/test_importer.py runs the importer",
    r"^python -m benchmarks\b": "takes minutes",
    r"^python (make_facts|trim)\.py": "of sitl_fixtures/, on uncut recordings; .ci/run checks the facts",
}
"""By pattern: why a command is not run here. What is gcs-bridge's own is read by its command line all the same."""

EMPTY: dict[str, object] = {"schema": "gcs-bridge/report/1", "version": "0", "verdict": "no_compare", "files": []}
"""The report before there was any recording."""

INLINE = ("README.md", "docs/jobs.md")
"""Pages whose commands stand in a table."""

EVERYDAY = ("docs/quick-start.md",)
"""The others are slow."""


def why_not(line: str) -> str | None:
    return next((reason for pattern, reason in NOT_RUN.items() if re.search(pattern, line)), None)


def words(line: str) -> list[str]:
    """The words of a command, without what only stands for more of them."""
    return [word for word in shlex.split(line, comments=True) if word != "…"]


def understood(line: str) -> None:
    """Fail unless gcs-bridge's own command line takes these words."""
    _, name, *rest = words(line)
    if name.startswith("-") or name == "COMMAND":
        return
    assert name in COMMANDS, line
    found = command.get_command(click.Context(command), name)
    assert found is not None
    try:
        found.make_context(name, rest)
    except click.MissingParameter:
        pass  # a sentence may name some of its words
    except click.exceptions.Exit:
        pass  # --help and --list end here


def run_here(line: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """The command in this process: exit code, and what it says; on standard error where nothing else."""
    _, *rest = words(line)
    if rest[0] == "replay" and "--viewer" not in rest:
        rest += ["--viewer", "none"]  # else it is shown until somebody closes it
    capsys.readouterr()
    code = main(rest)
    said = capsys.readouterr()
    return code, said.out or said.err


def run_by_shell(line: str, folder: Path) -> tuple[int, str]:
    """What only a shell understands, with a `gcs-bridge` on its path that is this one."""
    programs = folder / "programs"
    programs.mkdir(exist_ok=True)
    (programs / "gcs-bridge").write_text(f'#!/bin/sh\nexec "{sys.executable}" -m gcs_bridge "$@"\n')
    (programs / "gcs-bridge").chmod(0o755)
    paths = {"PATH": f"{programs}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}
    ended = subprocess.run(
        ["bash", "-c", line], cwd=folder, env={**os.environ, **paths}, capture_output=True, text=True, check=False
    )
    return ended.returncode, ended.stdout or ended.stderr


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where somebody stands who types along: beside the recordings of a checkout and some of their own."""
    for name in ("sitl_fixtures", "config"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "one.tlog").write_bytes(FLIGHT)
    for name in ("flight.tlog", "before.tlog", "after.tlog"):
        (tmp_path / name).write_bytes(FLIGHT)
    (tmp_path / "key").write_bytes(bytes(range(32)))
    (tmp_path / "key").chmod(0o600)
    (tmp_path / "before.json").write_text(json.dumps(EMPTY))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def typed(page: str) -> list[Command]:
    """What the page has people type, in its order: those of its tables last, but for those of a table before."""
    found = [one for block in blocks(page, "console", "sh") for one in commands(block)]
    if page in INLINE:
        before = [code for other in INLINE[: INLINE.index(page)] for code in inline_code(other)]
        found += [
            Command(code, None) for code in inline_code(page) if code.startswith("gcs-bridge ") and code not in before
        ]
    return [one for one in found if why_not(one.line) is None and not re.search("COMMAND|…", one.line)]


@pytest.mark.parametrize(
    "page", [pytest.param(page, marks=[] if page in EVERYDAY else [pytest.mark.slow]) for page in PAGES if typed(page)]
)
def test_a_page_s_commands_run_and_say_what_it_shows(
    page: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Typed one after the other. An alarm is no failure; a traceback, a usage error or another output is."""
    for line, shown in typed(page):
        simple = line.startswith("gcs-bridge ") and not re.search(r"[|;&<>\n]", line)
        code, said = run_here(line, capsys) if simple else run_by_shell(line, folder)
        assert code in (0, 1, 4), (line, said)
        if shown is not None:
            assert as_shown(shown).fullmatch(said.rstrip("\n") + "\n"), (
                f"{page} shows of `{line}`:\n{shown}\nnow:\n{said}"
            )


def test_what_is_not_run_is_understood_all_the_same() -> None:
    """Options and arguments of commands that wait on links, open windows or stand in the midst of a sentence."""
    sentences = [code for page in PAGES for code in inline_code(page) if code.startswith("gcs-bridge ")]
    lines = {one.line for _, one in all_commands() if one.line.startswith("gcs-bridge ")}
    for line in sorted({*sentences, *lines}):
        if "|" not in line:
            understood(line)


OF_OTHERS = {
    "--application-id --recording-id --entity-path-prefix --static --time_sequence": "rerun's, for importers",
    "--master": "MAVProxy's",
    "--all --sweeps": "of tools/pictures.py, and of the tests",
    "--troubles --begin --write --only --environments": "of benchmarks",
}
"""Options that pages name and that are no command's of gcs-bridge."""


def test_options_in_sentences_are_there() -> None:
    """What a page calls an option is one, of some command."""
    every = [command.get_command(click.Context(command), name) for name in COMMANDS]
    known = {option for one in every if one is not None for parameter in one.params for option in parameter.opts}
    others = {option for line in OF_OTHERS for option in line.split()}
    named = {code.split()[0].rstrip(",") for page in PAGES for code in inline_code(page) if re.match(r"--[a-z]", code)}
    assert {option.partition("=")[0] for option in named} - known - others - {"--help", "--version"} == set()


def test_benchmarks_that_pages_name_are_there_with_their_options() -> None:
    """They take too long to be run: the module is there, and so is each option, in its own words."""
    named = {
        words(one.line)[2:] and tuple(words(one.line)[2:]) for _, one in all_commands() if "-m benchmarks" in one.line
    }
    assert len(named) > 5
    for module, *options in named:
        path = ROOT / module.replace(".", "/")
        files = sorted(path.glob("*.py")) if path.is_dir() else [path.with_suffix(".py")]
        source = "".join(file.read_text(encoding="utf-8") for file in files)
        for option in options:
            assert not option.startswith("--") or f'"{option}"' in source, (module, option)


@pytest.mark.parametrize("pattern", NOT_RUN)
def test_each_reason_not_to_run_is_needed(pattern: str) -> None:
    """A reason that no command of any page has any more is taken off the list."""
    inline = [code for page in INLINE for code in inline_code(page)]
    assert any(re.search(pattern, line) for line in [*inline, *(one.line for _, one in all_commands())])
