"""CONVENTIONS.md: its examples run, its rules are all there, and the docstrings agree with it."""

import doctest
import re

import pytest

from gcs_bridge import attitude
from tests.helpers.paths import ROOT

PAGE = ROOT / "CONVENTIONS.md"
TEXT = PAGE.read_text(encoding="utf-8")
RULES = {int(number): row for number, row in re.findall(r"^\| M(\d+) (\|.*)$", TEXT, re.MULTILINE)}


def examples() -> list[doctest.DocTest]:
    """The page's code blocks, named after the heading above them, with their own line numbers."""
    found = []
    for block in re.finditer(r"^```pycon\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL):
        before = TEXT[: block.start(1)]
        heading = re.findall(r"^#+ (.*)$", before, re.MULTILINE)[-1]
        found.append(doctest.DocTestParser().get_doctest(block[1], {}, heading, str(PAGE), before.count("\n")))
    return found


SHARED, *EXAMPLES = examples()


def functions_in(row: str) -> set[str]:
    return set(re.findall(r"`(\w+)`", row.rsplit("|", 2)[1]))


def cited_in(docstring: str) -> set[int]:
    ranges = [range(int(a), int(b) + 1) for a, b in re.findall(r"\bM(\d+) to M(\d+)\b", docstring)]
    return {int(number) for number in re.findall(r"\bM(\d+)\b", docstring)}.union(*ranges)


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.name)
def test_every_example_runs_alone_behind_the_shared_lines(example: doctest.DocTest) -> None:
    """A reader who pastes the shared lines and one example sees what the page shows, without a warning."""
    session: dict[str, object] = {}
    runner = doctest.DocTestRunner()
    for part in (SHARED, example):
        part.globs = session
        report: list[str] = []
        assert runner.run(part, out=report.append, clear_globs=False).failed == 0, "".join(report)


def test_every_pitfall_has_its_symptom_its_arithmetic_its_origin_and_a_way_out() -> None:
    """No pitfall is told without what it looks like, a number worked by hand, where it comes from and its mending."""
    pitfalls = TEXT.split("\n## Pitfalls\n")[1].split("\n## ")[0].split("\n### ")[1:]
    assert len(pitfalls) == 14
    for pitfall in pitfalls:
        assert re.findall(r"^- \*\*(.*?):\*\*", pitfall, re.MULTILINE) == ["Shows", "By hand", "Comes from"], pitfall
        assert re.search(r"^>>> .*# the ways? out", pitfall, re.MULTILINE), pitfall


def test_the_symptoms_lead_to_every_pitfall() -> None:
    """Each pitfall can be found from what one sees, and no link of the page leads nowhere."""
    anchors = {
        re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-"): level
        for level, heading in re.findall(r"^(#+) (.*)$", TEXT, re.MULTILINE)
    }
    links = set(re.findall(r"\]\(#([^)]*)\)", TEXT))
    assert links == {anchor for anchor, level in anchors.items() if level == "###"}


def test_rules_1_to_24_are_all_there() -> None:
    """The numbers that docstrings cite can be looked up."""
    assert sorted(RULES) == list(range(1, 25))


def test_every_exported_name_is_on_the_page_and_none_that_is_not_exported() -> None:
    """Whoever reads the page has met the whole of `gcs_bridge.attitude`, and nothing that is gone."""
    listed = set().union(*map(functions_in, RULES.values()))
    less_common = re.findall(r"`(\w+)[(`]", TEXT.split("\n## Less common names\n")[1])
    assert listed.union(less_common) >= set(attitude.__all__)
    assert listed <= set(attitude.__all__)


@pytest.mark.parametrize("name", sorted(set().union(*map(functions_in, RULES.values()))))
def test_docstrings_cite_the_rules_that_the_page_gives(name: str) -> None:
    """From a rule to its functions and from a function to its rules one comes by the same numbers."""
    listed = {number for number, row in RULES.items() if name in functions_in(row)}
    assert listed <= cited_in(getattr(attitude, name).__doc__)
