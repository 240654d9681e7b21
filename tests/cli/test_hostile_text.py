"""What comes from the air may be made for the terminal that shows it: no sign of it gets through, whatever shows it."""

import json
import unicodedata
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_bridge.cli import main
from tests.helpers.craft import Change, Craft, State, rotvec
from tests.helpers.viewer_tools import Drawn
from tests.helpers.wire import tlog

# Each with a word by which it is taken for a reason of the estimator's reset, and told of as such.
TEXTS = (
    b"yaw \x1b[2J\x1b]0;a title\x07\x1b[31m",  # clears the screen, names the window, goes on in red
    b"yaw \xc2\x9b31m \xc2\x90q\xc2\x9c",  # the same by C1 controls, as UTF-8
    b"yaw \x9b31m \xff\xfe",  # by their bytes alone
    "yaw \u202ella no\u2066 \u200f".encode(),  # writes from right to left
    b"yaw\r\nALARM of somebody else\n\x0b\x0c\x85",  # goes on in a line of its own
    "yaw \u2028one more\u2029 \ufeff\u200b\U000e0041".encode(),  # the same by signs that nobody sees
    b"yaw \x08\x08\x08\x7f\x0e",  # takes back what stood before
)
HARMLESS = "yaw Höhe 30° 航向"
NAMES = (b"\x1b[2JX", b"A\nB\tC", "\u202eP".encode(), b"\xc2\x9b1mY", b"ABCDEFGHIJKLMN\x1bc", b"\xff\x9b")


def forbidden(text: str) -> set[str]:
    """Signs that are not for showing: controls, formats such as the direction of writing, line and page ends."""
    return {sign for sign in text if unicodedata.category(sign) in {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}}


def strings(value: Any) -> Iterator[str]:
    """All of them in what JSON or a table holds."""
    match value:
        case str():
            yield value
        case dict():
            for name, inner in value.items():
                yield from (name, *strings(inner))
        case list():
            for inner in value:
                yield from strings(inner)


def statustext(text: bytes) -> Any:
    return mavlink.MAVLink_statustext_message(4, text)


def param_value(name: bytes, value: float) -> Any:
    return mavlink.MAVLink_param_value_message(name, value, 9, 1, 0)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A vehicle that says all of that, whose estimator is reset, and whose quaternion then has an error."""

    def leap(t_s: float, state: State) -> State:
        return state._replace(rotation=rotvec(0, 0, 20) * state.rotation) if t_s >= 5 else state

    def faulty(t_s: float, state: State) -> State:
        state = leap(t_s, state)
        return state._replace(rotation=rotvec(0, 0, 30) * state.rotation) if t_s >= 8 else state

    change: Change = leap
    texts = [*TEXTS, HARMLESS.encode()]
    also = [(4.3 + place / 20, statustext(text)) for place, text in enumerate(texts)]
    also += [(1 + place / 20, param_value(name, place)) for place, name in enumerate(NAMES)]
    path = tmp_path_factory.mktemp("hostile") / "flight.tlog"
    path.write_bytes(tlog(Craft(euler=change, quaternion=faulty, also=also).records(14)))
    return path


@pytest.mark.slow
def test_what_is_printed(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The report as text: lines and nothing else; what can be shown is."""
    assert main(["check", str(recording)]) == 1
    shown = capsys.readouterr().out
    assert forbidden(shown.replace("\n", "")) == set()
    said = " ".join(shown.split())
    assert HARMLESS in said
    assert r"yaw \x1b[2J\x1b]0;a title\x07\x1b[31m" in said


def test_reports_and_events(recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As JSON too, where whoever prints a string would print it."""
    events = tmp_path / "events.jsonl"
    assert main(["check", str(recording), "--format", "json", "--events", str(events)]) == 1
    report = json.loads(capsys.readouterr().out)
    told = [json.loads(line) for line in events.read_text().splitlines()]
    for found in (report, told):
        assert set().union(*map(forbidden, strings(found))) == set()
    (reset,) = [event for event in told if event["event"] == "estimator_reset"]
    assert HARMLESS in reset["explained_by"]
    assert len(reset["explained_by"]) == len(TEXTS) + 1


@pytest.mark.slow
def test_evidence(recording: Path, tmp_path: Path) -> None:
    """Tables and summary, beside the frames themselves, which are kept as they came."""
    assert main(["check", str(recording), "--evidence", str(tmp_path), "-q"]) == 1
    tables = {path.stem: pq.read_table(path) for path in tmp_path.rglob("*.parquet")}
    shown = [text for table in tables.values() for text in strings(table.to_pylist())]
    assert set().union(*map(forbidden, shown)) == set()
    assert {HARMLESS, r"yaw ALARM of somebody else"} <= {text.split(" \\")[0].removesuffix(" �") for text in shown}
    assert r"\x1b[2JX" in shown
    for page in tmp_path.rglob("*.md"):
        assert forbidden(page.read_text().replace("\n", "")) == set()
    assert any(pa.types.is_binary(field.type) for field in tables["frames"].schema)


@pytest.mark.slow
def test_the_viewer(recording: Path, tmp_path: Path) -> None:
    """Every line of its log."""
    path = tmp_path / "flight.rrd"
    assert main(["replay", str(recording), "--viewer", f"save:{path}"]) == 0
    texts = [text for (text,) in Drawn(path).rows("/vehicle/1.1/events", "TextLog:text")[1]]
    assert len(texts) > 3
    assert set().union(*map(forbidden, texts)) == set()
