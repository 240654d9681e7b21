"""What the examples in docstrings show is what comes out."""

import doctest
import importlib

import pytest

from tests.helpers.paths import ROOT

# By their text: to import a module for the sake of looking for examples that it has not would take seconds.
MODULES = [
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in sorted(ROOT.glob("gcs_bridge/**/*.py"))
    if ">>>" in path.read_text(encoding="utf-8")
]


@pytest.mark.parametrize("name", MODULES)
def test_each_example_gives_what_it_shows(name: str) -> None:
    """Of every module of the package; what failed is printed."""
    failed, tried = doctest.testmod(importlib.import_module(name))
    assert tried > 0
    assert failed == 0
