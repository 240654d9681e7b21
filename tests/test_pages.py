"""What the pages show in Python runs as it stands."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs_bridge import Monitor
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from tests.helpers.paths import FIXTURES, ROOT
from tools.site_pages import PAGES, blocks

RECORDING = FIXTURES / "c_copter_4hz.tlog"
FAULTY = inject(RECORDING.read_bytes(), [parse_fault("yaw_offset:25")], from_s=5.0, to_s=10.0)


def python_blocks(page: str, heading: str) -> list[str]:
    section = re.split(r"^## ", (ROOT / page).read_text(encoding="utf-8"), flags=re.MULTILINE)
    (found,) = [text for text in section if text.startswith(heading + "\n")]
    return re.findall(r"^```python\n(.*?)^```$", found, re.MULTILINE | re.DOTALL)


@pytest.fixture
def link() -> Iterator[tuple[bytes, int]]:
    """The faulty recording's frames as a link would bring them, some at a time."""
    frames: list[tuple[bytes, int]] = []
    monitor = Monitor(on_frames=lambda _link, came: frames.extend((data, t_rx_us) for t_rx_us, data in came))
    monitor.feed_recording(FAULTY)
    pieces = [frames[at : at + 50] for at in range(0, len(frames), 50)]
    return iter([(b"".join(data for data, _ in piece), piece[-1][1]) for piece in pieces])


RUN = [
    ("docs/python.md", "Recordings", "euler_quaternion 25.0"),
    ("docs/python.md", "Bytes as they come", "alarm_raised euler_quaternion"),
    ("docs/python.md", "The math alone", "85.9"),  # 1.5 rad
    ("docs/evidence.md", "While a link is live", "1.1-euler_quaternion-0-1 "),
    ("docs/export.md", "In Python", "ATTITUDE 1 "),
]
NOT_RUN = {
    ("docs/ci.md", "pytest"): "is a test of somebody's own simulation: tests/test_pytest_plugin.py runs the fixture",
    ("docs/evidence.md", "The tables"): "needs pandas, which this project does not",
}


def test_no_python_of_any_page_is_left_out() -> None:
    """Each block is run here, or says why not."""
    known = [*((page, heading) for page, heading, _ in RUN), *NOT_RUN]
    of_pages = {page: sum(len(python_blocks(page, heading)) for at, heading in known if at == page) for page in PAGES}
    assert of_pages == {page: len(blocks(page, "python")) for page in PAGES}


@pytest.mark.slow
@pytest.mark.parametrize(("page", "heading", "said"), RUN)
def test_a_pages_python_runs(
    page: str,
    heading: str,
    said: str,
    link: Iterator[tuple[bytes, int]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Whoever pastes the lines, with a recording and a link of their own, sees them work."""
    monkeypatch.chdir(tmp_path)
    Path("flight.tlog").write_bytes(FAULTY)
    names: dict[str, object] = {"link": link}
    lines = python_blocks(page, heading)
    assert lines
    for block in lines:
        exec(block, names)
    assert said in capsys.readouterr().out
    assert (next(link, None) is None) == any(re.search(r"\blink\b", block) for block in lines)
