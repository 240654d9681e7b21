"""The MCAP file as Foxglove's own packages read it, and its messages by the schemas that Foxglove publishes."""

import json
import shutil
import subprocess
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from gcs_bridge.cli import main
from tests.exporting.test_export import messages
from tests.helpers.paths import FIXTURES

PACKAGES = "@mcap/core @mcap/nodejs @mcap/support @foxglove/schemas"
READER = Path(__file__).with_name("read_mcap.cjs")


@cache
def node() -> str:
    """The interpreter; skips where it, or the packages, are not there."""
    found = shutil.which("node")
    if found is None or subprocess.run([found, str(READER)], capture_output=True, check=False).returncode:
        pytest.skip(f"Foxglove's packages: npm install --prefix DIR {PACKAGES}, and NODE_PATH=DIR/node_modules")
    return found


@pytest.mark.slow
def test_foxglove_reads_every_message_and_knows_its_schemas(tmp_path: Path) -> None:
    """Each record's form and checksum, each message by the index and in order, each transform and log as published."""
    path = tmp_path / "flight.mcap"
    flight = FIXTURES / "k7a_gyro_bias_both.tlog"
    asked = [node(), str(READER), str(path)]
    assert main(["export", str(flight), "--format", "mcap", "--frame", "enu_flu", "--output", str(path), "-q"]) == 0
    read: dict[str, Any] = json.loads(subprocess.run(asked, capture_output=True, check=True).stdout)
    found = read["messages"]
    assert read["whole"]
    assert read["streamed"] == len(found) > 1000
    assert Counter(one["topic"] for one in found) == Counter(topic for topic, *_ in messages(path))
    times_ns = [int(one["t_ns"]) for one in found]
    assert times_ns == sorted(times_ns)
    judges = {name: jsonschema.Draft202012Validator(schema) for name, schema in read["schemas"].items()}
    judged = Counter[str]()
    for one in found:
        if one["schema"].startswith("foxglove."):
            judges[one["schema"]].validate(one["said"])
            judged[one["schema"]] += 1
    assert min(judged["foxglove.FrameTransform"], judged["foxglove.Log"]) > 2
