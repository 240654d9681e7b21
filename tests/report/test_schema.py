"""The JSON Schemas: what is shipped is what the structs say, and every report and event of the fixtures keeps to it."""

import json
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, Literal

import jsonschema
import msgspec
import pytest

import gcs_bridge
from gcs_bridge import contract, events
from gcs_bridge.events import AlarmEvent, AnyEvent, Event
from gcs_bridge.report import Report
from gcs_bridge.resources import json_schema
from tests.helpers.everyday import one_in
from tests.helpers.paths import FIXTURES, ROOT

RECORDINGS = sorted(FIXTURES.glob("*.tlog*"))


@cache
def validator(of: Literal["report", "event"]) -> jsonschema.Draft202012Validator:
    schema = json.loads(json_schema(of).read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


@pytest.mark.parametrize("recording", one_in(9, RECORDINGS), ids=lambda path: path.name)
def test_reports_and_events_keep_to_the_schema(recording: Path) -> None:
    """By jsonschema, and by decoding into the structs and back: no key is missing, none is there beside."""
    monitor, data = gcs_bridge.Monitor(), recording.read_bytes()
    found = monitor.feed_recording(data) if recording.suffix == ".tlog" else monitor.feed(data, -1)
    found += monitor.finish()
    report = monitor.close()
    text = report.to_json()
    validator("report").validate(json.loads(text))
    assert msgspec.json.decode(text, type=Report).to_json() == text
    assert json.loads(text) == report.to_dict()
    assert found
    for event in found:
        validator("event").validate(event)
        line = msgspec.json.encode(event)
        assert msgspec.json.encode(msgspec.json.decode(line, type=AnyEvent)) == line
        assert "link" not in event


def test_what_is_shipped_is_what_the_structs_say() -> None:
    """A field that is added, or said to mean something else, is in the schema. If not: run `python tools/schema.py`."""
    command = [sys.executable, str(ROOT / "tools" / "schema.py"), "--check"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT, env={"PYTHONPATH": str(ROOT)})
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def kinds(of: type[Event]) -> Iterator[type[Event]]:
    for kind in of.__subclasses__():
        yield from kinds(kind)
        if kind.__struct_config__.tag != kind.__name__:  # it has a name of its own: others are bases
            yield kind


def test_every_kind_of_event_is_in_the_union_and_in_the_schema() -> None:
    """None is forgotten where lines are decoded, and each tells what it means."""
    assert set(kinds(Event)) == set(AnyEvent.__args__)
    described = validator("event").schema["$defs"]
    assert all(described[kind.__name__]["description"] for kind in kinds(Event))


def test_an_alarm_is_told_as_it_is_reported() -> None:
    """The fields of an alarm's event, behind its head, are those of the report's alarm, in the same order."""
    head = events.Event.__struct_fields__
    told = [name for name in AlarmEvent.__struct_fields__ if name not in head]
    assert told == [name for name in contract.Alarm.__struct_fields__ if name not in head]
    for name in told:
        assert AlarmEvent.__annotations__[name] == contract.Alarm.__annotations__[name]


@pytest.mark.parametrize(
    "spoilt",
    [
        {"verdict": "good"},
        {"files": None},
        {"schema": "gcs-bridge/report/2"},
    ],
)
def test_what_is_no_report_is_refused(spoilt: dict[str, Any]) -> None:
    """A verdict that is none, a part that is missing, another schema."""
    good = Report.of([]).to_dict()
    validator("report").validate(good)
    with pytest.raises(jsonschema.ValidationError):
        validator("report").validate(good | spoilt)
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(good | spoilt, Report)
