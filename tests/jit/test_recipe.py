"""Machine code is found again where it is still right, and nowhere else."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import FunctionType
from typing import Any, cast

import numpy as np
import pytest

from gcs_bridge.jit import recipe
from gcs_bridge.jit.declared import ArrayOf, Scalar

SOURCE = """
import numpy as np
import types
limits = types.SimpleNamespace()
TABLE = np.arange(4)
LIMIT = 3
LAYOUT = np.dtype([("a", "i8"), ("b", "i8")])
constants = types.ModuleType("mine.constants")
constants.LARGEST = 7.0

def deep(x):
    return x + LIMIT + constants.LARGEST

def where(x):
    return x

def scalar_where(x):
    return x * 2

def made(by):
    def inner(x):
        return x * by
    return inner

scaled = made(2)

def helper(x, more=1):
    return deep(x) + where(x) + TABLE[0] + more + scaled(x)

def kernel(x):
    '''Says what it does.'''
    return helper(x) + sum([y for y in (1, 2)])
"""


def digest_of(source: str, **more: Any) -> str:
    recipe._globals_of.cache_clear()
    recipe._told.cache_clear()
    module: dict[str, Any] = {"__name__": "mine.kernels"}
    exec(source, module)
    plain = (module["deep"], module["helper"], module["scaled"], module["kernel"])
    stand_ins = {one: recipe.StandIn(one) for one in plain}
    stand_ins[module["where"]] = recipe.StandIn(module["scalar_where"], is_inlined=more.get("inlined", False))
    given = {"types": (Scalar(int),), "processor": "this one", **more}
    return recipe.recipe_of(cast(FunctionType, module["kernel"]), given["types"], stand_ins, given["processor"])


def test_the_same_source_has_the_same_recipe() -> None:
    """Also in another process: nothing in it is an address."""
    assert digest_of(SOURCE) == digest_of(SOURCE)
    assert digest_of(SOURCE) == digest_of(SOURCE.replace("\nTABLE", "\n# said of it\nTABLE"))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("LIMIT = 3", "LIMIT = 4"),
        ("np.arange(4)", "np.arange(1, 5)"),
        ("np.arange(4)", "np.arange(4.0)"),
        ("np.arange(4)", "np.arange(4).reshape(2, 2)"),
        ("LARGEST = 7.0", "LARGEST = 8.0"),
        ("return x + LIMIT", "return x - LIMIT"),
        ("return x * 2", "return x * 3"),
        ("made(2)", "made(3)"),
        ("more=1", "more=2"),
        ("y for y", "-y for y"),
    ],
    ids=lambda text: text.strip(),
)
def test_whatever_the_code_depends_on_is_in_it(old: str, new: str) -> None:
    """Constants, code and defaults of the kernel, of all that it calls, and of what is called instead."""
    assert old in SOURCE
    assert digest_of(SOURCE.replace(old, new)) != digest_of(SOURCE)


def test_what_python_alone_calls_is_not_in_it() -> None:
    """Kernels call a stand-in: what it stands in for may change."""
    assert digest_of(SOURCE.replace("def where(x):\n    return x", "def where(x):\n    return -x")) == digest_of(SOURCE)


@pytest.mark.parametrize(
    "change",
    [
        lambda patch: {"types": (Scalar(float),)},
        lambda patch: {"types": (ArrayOf(np.dtype("f8"), 1),)},
        lambda patch: {"inlined": True},
        lambda patch: {"processor": "another one"},
        lambda patch: patch.setattr(np, "__version__", "9.0") or {},
        lambda patch: patch.setattr(sys, "version", "4.0") or {},
        lambda patch: patch.setattr(recipe, "_version_file", lambda package: f"a new {package}") or {},
        lambda patch: patch.setenv("NUMBA_OPT", "0") or {},
        lambda patch: patch.setattr(Path, "read_text", lambda *_: "another compiler") or {},
    ],
)  # fmt: skip
def test_so_are_types_processor_and_who_compiles(
    change: Callable[[pytest.MonkeyPatch], dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An update of Python, numpy, numba or this program compiles anew; so does another machine with the same home."""
    before = digest_of(SOURCE)
    more = change(monkeypatch)
    recipe._surroundings.cache_clear()
    after = digest_of(SOURCE, **more)
    monkeypatch.undo()
    recipe._surroundings.cache_clear()
    assert before != after
    assert before == digest_of(SOURCE)


def test_numba_and_llvmlite_tell_their_version_without_being_loaded() -> None:
    """By a file of theirs that says more than the absence of the package."""
    for package in ("numba", "llvmlite"):
        assert "version" in recipe._version_file(package)
    assert recipe._version_file("no_such_package") == "no no_such_package"
