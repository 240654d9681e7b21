"""`action.yml`, its steps run one by one as a runner does: no runner is at hand, as one needs containers.

What stands in for GitHub: expressions are filled in here, and `gh` is a script that writes down how it was called.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import yaml
from junitparser import JUnitXml

from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from tests.helpers.paths import FIXTURES, ROOT

pytestmark = pytest.mark.slow

ACTION = yaml.safe_load((ROOT / "action.yml").read_text())
FLIGHT = (FIXTURES / "c_copter_4hz.tlog").read_bytes()


class Ran(NamedTuple):
    code: int
    output: str
    summary: str
    gh: list[str]


def run(folder: Path, comments: str = "", event: str = "pull_request", *, refused: bool = False, **inputs: str) -> Ran:
    """All steps but the installation, in a folder; GitHub may refuse what is asked of it."""
    place, calls = folder / "temp", folder / "gh.txt"
    (place / "gcs-bridge" / "bin").mkdir(parents=True, exist_ok=True)
    command = place / "gcs-bridge" / "bin" / "gcs-bridge"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m gcs_bridge "$@"\n')
    (folder / "bin").mkdir(exist_ok=True)
    gh = folder / "bin" / "gh"
    gh.write_text(
        f'#!/bin/sh\necho "$@" >> "{calls}"\ncase "$*" in *--jq*) echo "{comments}";; esac\nexit {refused:d}\n'
    )
    for one in (command, gh):
        one.chmod(0o755)
    given = {name: str(of.get("default", "")) for name, of in ACTION["inputs"].items()} | inputs
    known = {f"inputs.{name}": value for name, value in given.items()} | {
        "runner.temp": str(place),
        "github.action_path": str(ROOT),
        "github.event_name": event,
        "github.event.pull_request.number": "7",
        "steps.check.outputs.exit-code": "",
    }
    files = {name: folder / name.lower() for name in ("GITHUB_OUTPUT", "GITHUB_STEP_SUMMARY")}
    environment = {
        **os.environ,
        **{name: str(path) for name, path in files.items()},
        "PATH": f"{folder / 'bin'}:{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "GITHUB_REPOSITORY": "me/drone",
    }
    output, code = "", 0
    for step in ACTION["runs"]["steps"]:
        if step["name"].startswith("Install") or not holds(step.get("if"), known):
            continue
        env = {name: filled(value, known) for name, value in step["env"].items()}
        ended = subprocess.run(
            ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"]],
            check=False,
            cwd=folder,
            env=environment | env,
            capture_output=True,
            text=True,
        )
        output, code = output + ended.stdout + ended.stderr, ended.returncode
        if files["GITHUB_OUTPUT"].exists():
            told = dict(line.split("=", 1) for line in files["GITHUB_OUTPUT"].read_text().splitlines())
            known |= {f"steps.check.outputs.{name}": value for name, value in told.items()}
        if code:
            break
    summary = files["GITHUB_STEP_SUMMARY"]
    return Ran(
        code,
        output,
        summary.read_text() if summary.exists() else "",
        calls.read_text().splitlines() if calls.exists() else [],
    )


def filled(value: str, known: dict[str, str]) -> str:
    return re.sub(r"\$\{\{ *([\w.-]+) *\}\}", lambda one: known[one[1]], str(value))


def holds(condition: str | None, known: dict[str, Any]) -> bool:
    """The one kind of condition that is used: `a == 'b'`, joined by &&."""
    for part in (condition or "").split(" && "):
        name, _, value = part.partition(" == ")
        if part and known[name] != value.strip("'"):
            return False
    return True


@pytest.fixture
def faulty(tmp_path: Path) -> Path:
    """A folder with two recordings, one of which has a mistake in it."""
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "good.tlog").write_bytes(FLIGHT)
    (tmp_path / "logs" / "bad one.tlog").write_bytes(inject(FLIGHT, [parse_fault("yaw_offset:30")]))
    return tmp_path


def test_no_input_is_part_of_a_script() -> None:
    """What users give comes by the environment: a file's name cannot act."""
    for step in ACTION["runs"]["steps"]:
        assert "${{" not in step["run"]


def test_a_run_that_agrees_passes(faulty: Path) -> None:
    """Without a comment where none is asked for; the summary has it."""
    ran = run(faulty, recordings="logs/good.tlog")
    assert ran.code == 0, ran.output
    assert "✅ Attitude: AGREE" in ran.summary
    assert ran.gh == []


def test_an_alarm_fails_the_job_and_is_commented(faulty: Path) -> None:
    """All three reports lie there; the first comment is made, a later run writes the same one anew."""
    ran = run(faulty, recordings="\n  logs\n", comment="true")
    assert ran.code == 1, ran.output
    reports = faulty / "attitude-reports"
    assert json.loads((reports / "report.json").read_text())["verdict"] == "alarm"
    assert JUnitXml.fromfile(str(reports / "report.xml")).failures == 1
    assert "yaw\\_offset" in ran.summary
    assert ran.gh[-1] == "api --silent repos/me/drone/issues/7/comments -F body=@attitude-reports/comment.md"
    again = run(faulty, comments="1234", recordings="logs", comment="true")
    assert "PATCH repos/me/drone/issues/comments/1234" in again.gh[-1]


@pytest.mark.sweep
def test_a_token_that_may_not_comment_changes_no_verdict(faulty: Path) -> None:
    """As on a pull request from a fork: a run that agrees passes, with a warning."""
    ran = run(faulty, refused=True, recordings="logs/good.tlog", comment="true")
    assert ran.code == 0, ran.output
    assert "::warning::no comment" in ran.output
    assert run(faulty, refused=True, recordings="logs", comment="true").code == 1


def test_only_what_is_new_fails(faulty: Path) -> None:
    """The report of one run is the baseline of the next."""
    assert run(faulty, recordings="logs").code == 1
    (faulty / "attitude-reports" / "report.json").rename(faulty / "before.json")
    ran = run(faulty, recordings="logs/bad one.tlog\nlogs/good.tlog", baseline="before.json")
    assert ran.code == 0, ran.output
    assert "1 as in the baseline" in ran.summary


def test_a_recording_that_is_missing_fails(faulty: Path) -> None:
    """With its line on the page."""
    ran = run(faulty, recordings="logs/good.tlog\nlogs/gone.tlog")
    assert ran.code == 3
    assert "gone.tlog: cannot be read" in ran.summary
