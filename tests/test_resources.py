"""Shipped data: found in a wheel and in a checkout."""

import re
import tomllib
from pathlib import Path

import pytest

from gcs_bridge import resources
from gcs_bridge.errors import UsageError
from tests.helpers.paths import ROOT


def wheel_and_checkout(folder: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    """An empty place that the module takes for its own, and the places of its data."""
    package = folder / "gcs_bridge"
    monkeypatch.setattr(resources, "_PACKAGE", package)
    return package / "_data" / "config", folder / "config"


def test_shipped_data_are_here() -> None:
    """The config folder and the demo recording are found by whatever means the package is installed."""
    assert (resources.config_folder() / "default.toml").is_file()
    assert resources.demo_recording().stat().st_size > 100_000


def test_demo_is_the_fixture() -> None:
    """The demo recording is the fixture, byte for byte: a wheel carries it under another name."""
    assert resources.demo_recording().read_bytes() == (ROOT / "sitl_fixtures" / "a_copter_square.tlog").read_bytes()


def test_headless_is_all_but_the_viewer() -> None:
    """What a machine installs that only judges follows what the package asks for."""
    asked = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    lines = (resources.config_folder() / "headless.txt").read_text().splitlines()
    assert [line for line in lines if not line.startswith("#")] == [one for one in asked if "rerun" not in one]


def test_the_page_of_licences_names_all_that_is_asked_for() -> None:
    """`tools/licences.py` writes it anew where something is missing."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    asked = [*project["dependencies"], *extras["cluster"], *extras["remote"]]
    page = (ROOT / "docs" / "licences.md").read_text()
    assert [name for one in asked if f"| {(name := re.split('[^a-z0-9-]', one)[0])} |" not in page] == []


def test_a_wheel_uses_its_own_copy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Data inside the package win over a folder beside it, which in site-packages is somebody else's."""
    in_wheel, beside = wheel_and_checkout(tmp_path, monkeypatch)
    beside.mkdir(parents=True)
    assert resources.config_folder() == beside
    in_wheel.mkdir(parents=True)
    assert resources.config_folder() == in_wheel


def test_missing_data_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An incomplete installation says so in one line."""
    wheel_and_checkout(tmp_path, monkeypatch)
    with pytest.raises(UsageError, match="config is missing from this installation"):
        resources.config_folder()
