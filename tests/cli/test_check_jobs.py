"""`gcs-bridge check` of several recordings at a time: what it writes is what it writes one after the other."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from gcs_bridge.cli import check_run, main
from gcs_bridge.cli.check_run import jobs_for
from gcs_bridge.evidence import place as place_module
from gcs_bridge.evidence.place import Place
from tests.helpers.paths import FIXTURES

FLIGHTS = ("k8_stream_stops", "d_tailsitter_tumble", "k7a_gyro_bias_both")  # the first takes longer than the second


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    """Three recordings, two of them with alarms, and between them one that cannot be used."""
    folder = tmp_path / "logs"
    folder.mkdir()
    for number, name in enumerate(FLIGHTS):
        shutil.copy(FIXTURES / f"{name}.tlog", folder / f"{number}.tlog")
    (folder / "0b.tlog").write_text("no telemetry" * 100)
    return folder


def checked(capfd: pytest.CaptureFixture[str], *arguments: Any) -> tuple[int, str, str]:
    """Exit code, standard output and standard error; output by descriptor, as other processes write there too."""
    code = main(["check", *map(str, arguments)])
    out, err = capfd.readouterr()
    return code, out, err


def contents(folder: Path) -> dict[str, bytes]:
    """All files below a folder but the viewer's, in which the time of writing stands."""
    files = (path for path in folder.rglob("*") if path.is_file() and path.suffix != ".rrd")
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


@pytest.mark.slow
def test_report_and_events_are_the_same(logs: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """In the order of the files, with the bad one in its place; the code is that of the worst."""
    one, several = (checked(capfd, logs, "--jobs", jobs, "--format", "json", "--events", "-") for jobs in (1, 2))
    assert one == several
    assert several[0] == 3
    assert "0b.tlog" in several[2]


@pytest.mark.slow
@pytest.mark.sweep
def test_all_outputs_are_the_same(logs: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Each format, pages and evidence, with a baseline that knows some of the alarms."""
    baseline = tmp_path / "before.json"
    checked(capfd, logs / "0.tlog", "--output", baseline)
    written: list[dict[str, bytes]] = []
    for jobs in (1, 2):
        out = tmp_path / "out"
        out.mkdir()
        outputs = [arg for name in ("r.json", "r.html", "r.xml", "r.md", "r.txt") for arg in ("--output", out / name)]
        kept = ["--evidence", out / "evidence", "--events", out / "events.jsonl", "--baseline", baseline]
        told = checked(capfd, logs, "--jobs", jobs, *outputs, *kept)
        written.append(contents(out) | {"told": repr(told).encode()})
        shutil.rmtree(out)
    assert written[0] == written[1]
    assert any(name.endswith("alarm.parquet") or "evidence/0/" in name for name in written[1])


@pytest.mark.slow
@pytest.mark.sweep
def test_a_process_that_dies_costs_its_recording(
    logs: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The others are judged."""
    from tests.helpers.worked import die_at

    monkeypatch.setattr(check_run, "_judged_there", die_at)
    code, out, err = checked(capfd, logs, "--jobs", "2", "--format", "json")
    assert code == 3
    assert [Path(entry["path"]).name for entry in json.loads(out)["files"]] == ["0.tlog", "2.tlog"]
    assert "1.tlog: not judged: its worker process was ended by SIGKILL" in err


def test_few_and_small_files_are_judged_here(tmp_path: Path) -> None:
    """A process takes 0.4 s to begin: it must have more to do. What is asked for is done."""
    small, large = tmp_path / "small.tlog", tmp_path / "large.tlog"
    small.write_bytes(bytes(1000))
    with large.open("wb") as file:
        file.truncate(400_000_000)
    assert jobs_for([small] * 5, None) == 1
    assert jobs_for([large], None) == jobs_for([large], 8) == 1
    assert jobs_for([small] * 5, 3) == 3
    assert jobs_for([large, Path("-")], 2) == 1  # nobody else can read standard input


@pytest.mark.parametrize("most", [500, 250, 120])
def test_evidence_has_the_room_that_it_has_alone(most: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Recordings with 60 alarms each: of a run so many are kept, whatever is judged at the same time."""
    monkeypatch.setattr(place_module, "_MOST_OF_ALL", most)
    recordings = [tmp_path / f"{number}.tlog" for number in range(6)]

    def kept(at_a_time: int) -> list[int]:
        place, counts = Place(tmp_path / "evidence", recordings), list[int]()
        out: list[int] = []
        for recording in recordings:
            while (folder := place.folder(recording, len(out))) is None or len(out) == at_a_time:
                place.taken(out.pop(0))
            counts.append(min(folder._room, 60))
            out.append(counts[-1])
        return counts

    assert kept(1) == kept(2) == kept(4)
