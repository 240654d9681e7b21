"""Pages that follow from the code say what it says now, and leave nothing out."""

import json
import re

import pytest
import yaml

from gcs_bridge import Monitor
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from gcs_bridge.settings import Settings
from tests.helpers.paths import FIXTURES, ROOT
from tools.reference import TABLES, written
from tools.site_pages import PAGES, blocks


@pytest.mark.parametrize("page", TABLES)
def test_tables_are_as_the_code_has_them(page: str) -> None:
    """`python -m tools.reference` has nothing to write: options, limits, keys and events are those of today."""
    assert (ROOT / "docs" / page).read_text(encoding="utf-8") == written(page)


def test_every_limit_stands_on_the_page() -> None:
    """Each key of each section has its row, with its value in the unit of settings files."""
    page = (ROOT / "docs" / "checks.md").read_text(encoding="utf-8").split("\n## Every limit\n")[1]
    sections = dict(re.findall(r"^### \[(\w+)\]\n(.*?)(?=^### |\Z)", page, re.MULTILINE | re.DOTALL))
    assert list(sections) == list(Settings.__struct_fields__)
    for name, text in sections.items():
        keys = [key.replace("_rad", "_deg") for key in getattr(Settings(), name).__struct_fields__]
        assert re.findall(r"^\| `(\w+)` \| `[^`]+` \| \S", text, re.MULTILINE) == keys


@pytest.mark.slow
def test_the_diagnosis_that_is_shown_is_the_one_that_is_made() -> None:
    """The JSON on the page of the convention doctor is what its two commands print, to the digits that are shown."""
    (shown,) = blocks("docs/diagnosis.md", "json")
    recording = (FIXTURES / "a_copter_square.tlog").read_bytes()
    monitor = Monitor()
    monitor.feed_recording(inject(recording, [parse_fault("quaternion_conjugate")], from_s=60.0))
    (vehicle,) = monitor.close().to_dict()["files"][0]["vehicles"]
    said = next(alarm["diagnosis"] for alarm in vehicle["alarms"] if alarm["check"] == "euler_quaternion")
    for key, value in json.loads(f"{{{shown.text}}}")["diagnosis"].items():
        assert said[key] == (pytest.approx(value, rel=0.05) if isinstance(value, float) else value), key


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "yaml")])
def test_yaml_on_pages_is_yaml(page: str) -> None:
    """What people copy into their CI or Grafana can be read."""
    for block in blocks(page, "yaml"):
        assert all(isinstance(document, dict | list) for document in yaml.safe_load_all(block.text)), block.line
