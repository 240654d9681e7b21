"""What the pages tell people to type: it runs, and says what the page shows; or the reason not to run it is here."""

import platform
import re
import sys
from pathlib import Path

import click
import pytest

from gcs_bridge.cli.app import COMMANDS, command
from tests.helpers.paths import ROOT
from tools.captures import NOT_RUN, TABLES, prepare, run, same_parts, typed, words
from tools.site_pages import PAGES, all_commands, as_shown, inline_code

EVERYDAY = ("docs/quick-start.md",)
SWEPT = ("docs/inject.md", "docs/jobs.md", "docs/wrong-attitude.md")
"""Those whose commands take longest; all others are slow."""

SHOWN_BY = (sys.platform, platform.machine()) == ("linux", "x86_64")
"""Whether this is a machine as the pages' outputs are of: elsewhere the last digit of noise may be another."""


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


@pytest.mark.skipif(sys.platform == "win32", reason="pages speak to the shells of Linux and macOS")
@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=[pytest.mark.slow] * (page not in EVERYDAY) + [pytest.mark.sweep] * (page in SWEPT))
        for page in PAGES
        if typed(page)
    ],
)
def test_a_page_s_commands_run_and_say_what_it_shows(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Typed one after the other. An alarm is no failure; a traceback, a usage error or another output is."""
    prepare(tmp_path)
    monkeypatch.chdir(tmp_path)
    for line, shown in typed(page):
        code, said = run(line)
        assert code in (0, 1, 4), (line, said)
        if shown is not None and SHOWN_BY:
            now = said.rstrip("\n") + "\n"
            stale = f"{page} shows of `{line}`:\n{shown}\nnow:\n{said}\npython -m tools.captures writes it anew"
            assert as_shown(shown).fullmatch(now), stale


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
    inline = [code for page in TABLES for code in inline_code(page)]
    assert any(re.search(pattern, line) for line in [*inline, *(one.line for _, one in all_commands())])


def test_an_output_is_shown_anew_in_the_same_parts() -> None:
    """What `tools.captures` writes: the entries that were shown, as they are now, and `…` for what lies between."""
    said = "1 file\n  vehicle\n      ALARM  pairs from 3 s\n             more of it\n      ALARM  rates\n\nALARM f\n"
    assert same_parts("…\n      ALARM  pairs from 2 s\n…\n", said) == (
        "…\n      ALARM  pairs from 3 s\n             more of it\n…\n"
    )
    assert same_parts("all of it\n", said) == said
    with pytest.raises(ValueError, match="nothing begins with 'WARNING"):
        same_parts("…\n      WARNING  pairs\n…\n", said)
