"""CONTRIBUTING.md names what there is: every package has its row, and no file, module or name on the page is gone."""

import re
from functools import cache
from itertools import chain

import pytest

from tests.helpers.paths import ROOT

PACKAGE = ROOT / "gcs_bridge"
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
ROWS = dict(re.findall(r"^\| `(\w+)/` \| (.*?) \|", TEXT, re.MULTILINE))
RECIPES = re.findall(r"^\*\*(A.*?)\.\*\* (.*?)(?=\n\n|\Z)", TEXT.split("\n## Recipes\n")[1], re.MULTILINE | re.DOTALL)


def test_every_package_has_its_row() -> None:
    """A newcomer finds each package on the map, and none that is gone."""
    assert sorted(ROWS) == sorted(path.parent.name for path in PACKAGE.glob("*/__init__.py"))


@pytest.mark.parametrize("package", ROWS)
def test_the_modules_of_a_row_exist(package: str) -> None:
    """What a row sends its reader to is there: `name, name: what is in it`."""
    before_colons = (
        segment.partition(":")[0] for segment in ROWS[package].replace("*", "").split(" · ") if ":" in segment
    )
    named = set(chain.from_iterable(re.split(", | and ", part) for part in before_colons))
    there = {path.stem for path in (PACKAGE / package).glob("*.py")}
    assert {name for name in named if name.isidentifier()} <= there


def test_files_of_the_recipes_exist() -> None:
    """Every path on the page leads somewhere, save those that a recipe asks to be added."""
    paths = {path for path in re.findall(r"`([\w/]+/[\w./]*\.\w+|\w+\.py)`", TEXT) if "NAME" not in path}
    assert len(paths) > 12
    assert {path for path in paths if not any((root / path).exists() for root in (ROOT, PACKAGE))} == set()


@cache
def words_of_the_code() -> set[str]:
    paths = [*PACKAGE.rglob("*.py"), *ROOT.glob("tests/**/*.py")]
    return {word for path in paths for word in re.findall(r"\w+", path.read_text(encoding="utf-8"))}


@pytest.mark.parametrize(("title", "recipe"), RECIPES, ids=lambda text: text[:40])
def test_a_recipe_names_a_line_and_a_test(title: str, recipe: str) -> None:
    """A recipe ends nowhere else than in a test to copy, and the names that it lists things in are in the code."""
    assert re.search(r"`tests/[\w/]+\.py`", recipe), title
    names = [
        name for name in re.findall(r"`([A-Za-z_.]+)`", recipe) if not name.endswith((".py", ".toml", ".tlog", ".md"))
    ]
    assert [name for name in names if name.rpartition(".")[2] not in words_of_the_code()] == [], title


def test_modules_are_small() -> None:
    """At most 400 lines, but for the scan's kernel, which is one piece."""
    long = [path for path in (ROOT / "gcs_bridge").rglob("*.py") if len(path.read_text().splitlines()) > 400]
    assert [path.relative_to(ROOT).as_posix() for path in long] == ["gcs_bridge/mavlink/scan.py"]
