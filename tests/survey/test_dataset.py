"""Nothing is judged twice, whatever ends a survey and wherever; what was done stays valid."""

import gzip
import json
import os
import shutil
import zipfile
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from gcs_bridge.errors import UsageError
from gcs_bridge.survey import dataset as dataset_module
from gcs_bridge.survey import parts
from gcs_bridge.survey import run as run_module
from gcs_bridge.survey.dataset import Dataset
from gcs_bridge.survey.task import Result, Task, survey_one
from tests.helpers.everyday import one_in
from tests.helpers.paths import FIXTURES
from tests.helpers.surveyed import DIGEST, handmade, rows, surveyed, surveyed_into

FLIGHT = FIXTURES / "d_tailsitter_tumble.tlog"  # the smallest
DATA = FLIGHT.read_bytes()


@pytest.fixture
def flights(tmp_path: Path) -> Path:
    """Five recordings, each with another byte changed in its last record."""
    folder = tmp_path / "logs"
    folder.mkdir()
    for number in range(5):
        (folder / f"{number}.tlog").write_bytes(DATA[:-1] + bytes([DATA[-1] ^ (number + 1)]))
    return folder


@pytest.fixture
def judged(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Each path that is judged, as often as it is."""
    paths: list[str] = []

    def watched(task: Task) -> Result:
        result = survey_one(task)
        if result.recording is not None:
            paths.append(result.recording["path"])
        return result

    monkeypatch.setattr(run_module, "survey_one", watched)
    return paths


class Killed(BaseException):
    """The process ends here, and does nothing more."""


def test_a_survey_again_judges_nothing(flights: Path, tmp_path: Path, judged: list[str]) -> None:
    """Each file is known by path, size and time of change."""
    first = surveyed([flights], tmp_path / "out")
    again = surveyed([flights], tmp_path / "out")
    assert (first.judged, again.judged, again.known) == (5, 0, 5)
    assert len(judged) == len(rows(tmp_path / "out", "recordings")) == 5
    assert again.codes == first.codes


@pytest.mark.parametrize("at", one_in(2, [1, 4]))
def test_killed_and_gone_on_with(
    at: int, flights: Path, tmp_path: Path, judged: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The folder as a killed process leaves it: what was judged by then is not judged again."""
    out, left = tmp_path / "out", tmp_path / "left"
    add = Dataset.add

    def killed(self: Dataset, result: Result) -> bool:
        added = add(self, result)
        if len(judged) == at:
            shutil.copytree(out, left)
            raise Killed
        return added

    monkeypatch.setattr(Dataset, "add", killed)
    with pytest.raises(Killed):
        surveyed([flights], out)
    monkeypatch.setattr(Dataset, "add", add)
    ran = surveyed([flights], left)
    assert (ran.judged, ran.known) == (5 - at, at)
    assert sorted(judged) == sorted(row["path"] for row in rows(left, "recordings"))


@pytest.mark.slow
def test_killed_in_the_middle_of_a_line(flights: Path, tmp_path: Path, judged: list[str]) -> None:
    """What was written half is judged anew, and nothing else is."""
    out = tmp_path / "out"
    with Dataset(out, "1", DIGEST) as dataset:
        surveyed_into(dataset, sorted(flights.iterdir())[:2])
        (journal,) = (out / "recordings").glob(".journal-*")
        written = journal.read_bytes()
    for part in out.glob("*/part-*"):
        part.unlink()
    journal.write_bytes(written[:-10])
    ran = surveyed([flights], out)
    assert (ran.judged, ran.known) == (4, 1)
    assert len(rows(out, "recordings")) == 5


@pytest.mark.parametrize("table", one_in(4, ["alarms", "checks", "recordings", "none"], swept=False))
def test_killed_between_the_tables(table: str, flights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A part of some tables is there, of others not: in the end there is each row once."""
    out, write = tmp_path / "out", parts.write_part
    surveyed([min(flights.iterdir())], out)  # the part is there, and grows

    def killed(path: Path, *others: Any) -> None:
        if path.parent.name == table:
            raise Killed
        write(path, *others)

    monkeypatch.setattr(dataset_module, "write_part", killed)
    if table == "none":  # all of them are there, and so is the journal still

        def kept(path: Path, **_: Any) -> None:
            if path.exists():
                raise Killed

        monkeypatch.setattr(Path, "unlink", kept)
    with pytest.raises(Killed):
        surveyed([flights], out)
    monkeypatch.undo()
    ran = surveyed([flights], out)
    assert (ran.judged, ran.known) == (0, 5)
    vehicles = {(row["content"], row["sysid"], row["check"]) for row in rows(out, "checks")}
    assert len(vehicles) == len(rows(out, "checks")) == 5 * 9
    assert len({row["content"] for row in rows(out, "recordings")}) == len(rows(out, "recordings")) == 5


def test_parts_fill_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The last part grows from survey to survey; a full one stays as it is."""
    monkeypatch.setattr(dataset_module, "_PART", 4)
    for number in range(3):
        with Dataset(tmp_path, "1", DIGEST) as dataset:
            for one in range(3):
                assert dataset.add(handmade(f"{number}{one}", {}))
    parts = sorted((tmp_path / "recordings").glob("*.parquet"))
    assert [part.name for part in parts] == [f"part-00000{number}.parquet" for number in range(len(parts))]
    assert [pq.read_metadata(part).num_rows for part in parts] == [4, 4, 1]
    assert [row["content"] for row in rows(tmp_path, "recordings")] == [f"{a}{b}" for a in range(3) for b in range(3)]


@pytest.mark.slow
def test_moved_copied_and_touched(flights: Path, tmp_path: Path, judged: list[str]) -> None:
    """They are known by what is in them; a changed byte makes another recording."""
    out = tmp_path / "out"
    surveyed([flights], out)
    (flights / "0.tlog").rename(flights / "moved.tlog")
    shutil.copy(flights / "1.tlog", flights / "copy.tlog")
    os.utime(flights / "2.tlog", ns=(1, 1))
    (flights / "3.tlog").write_bytes(DATA[:-1] + bytes([DATA[-1] ^ 99]))
    ran = surveyed([flights], out)
    assert (ran.judged, ran.known, ran.copies) == (1, 2, 3)
    assert len(judged) == 6


def test_two_copies_in_one_survey(tmp_path: Path) -> None:
    """One row: they are one recording."""
    for name in ("a", "b"):
        shutil.copy(FLIGHT, tmp_path / f"{name}.tlog")
    ran = surveyed([tmp_path], tmp_path / "out")
    assert (ran.judged, ran.copies) == (1, 1)
    assert len(rows(tmp_path / "out", "recordings")) == 1


@pytest.mark.slow
def test_other_settings_judge_anew(flights: Path, tmp_path: Path, judged: list[str]) -> None:
    """What they judged is kept beside it, and is there again when they are asked for again."""
    out, one = tmp_path / "out", sorted(flights.iterdir())[:1]
    surveyed(one, out)
    surveyed(one, out, digest="another")
    assert len(judged) == 2
    (earlier,) = (out / "earlier").iterdir()
    assert len(rows(earlier, "recordings")) == len(rows(out, "recordings")) == 1
    assert surveyed(one, out).known == 1
    assert surveyed(one, out, version="2").judged == 1
    assert len(judged) == 3
    assert sorted(path.name for path in (out / "earlier").iterdir() if rows(path, "recordings")) == [
        "1-0123456789ab",
        "1-another",
    ]


def test_what_is_packed(tmp_path: Path, judged: list[str]) -> None:
    """Each recording in an archive is one of its own, and known again; gzip's content is the file's own."""
    with zipfile.ZipFile(tmp_path / "two.zip", "w") as archive:
        archive.writestr("a.tlog", DATA)
        archive.writestr("b.tlog", DATA[:-1] + b"\0")
        archive.writestr("readme.txt", b"")
    (tmp_path / "c.tlog.gz").write_bytes(gzip.compress(DATA[:-1] + b"\1"))
    ran = surveyed([tmp_path], tmp_path / "out")
    assert ran.judged == 3
    paths = {row["path"] for row in rows(tmp_path / "out", "recordings")}
    assert paths == {f"{tmp_path}/{name}" for name in ("two.zip::a.tlog", "two.zip::b.tlog", "c.tlog.gz")}
    again = surveyed([tmp_path], tmp_path / "out")
    assert (again.judged, again.known) == (0, 2)
    assert len(judged) == 3


@pytest.mark.slow
def test_one_of_an_archive(tmp_path: Path) -> None:
    """What is named of it is judged; the rest is not known by that."""
    with zipfile.ZipFile(tmp_path / "two.zip", "w") as archive:
        archive.writestr("a.tlog", DATA)
        archive.writestr("b.tlog", DATA[:-1] + b"\0")
    assert surveyed([f"{tmp_path}/two.zip::a.tlog"], tmp_path / "out").judged == 1
    assert surveyed([tmp_path / "two.zip"], tmp_path / "out").judged == 1
    assert surveyed([tmp_path / "two.zip"], tmp_path / "out").known == 1


def test_what_is_no_file(tmp_path: Path) -> None:
    """A pipe is not waited for, nor is standard input; names that are no UTF-8 can be told."""
    os.mkfifo(tmp_path / "pipe.tlog")
    strange = os.fsdecode(os.fsencode(tmp_path) + b"/\xff.tlog")
    Path(strange).write_bytes(b"")
    ran = surveyed([tmp_path / "pipe.tlog", "-", strange], tmp_path / "out")
    assert [line.partition(": ")[2][:20] for line in ran.failures] == [
        "standard input is no",
        "a pipe or device, no",
        "the file is empty: c",
    ]
    json.dumps(ran.failures).encode()
    Path(strange).write_bytes(DATA)
    assert surveyed([strange], tmp_path / "out").judged == 1
    assert surveyed([strange], tmp_path / "out").judged == 0


@pytest.mark.slow
def test_failures_are_tried_twice_and_told(flights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Others are judged; the next survey tries it again."""
    (flights / "empty.tlog").touch()
    (flights / "text.tlog").write_text("no telemetry" * 100)
    tried: list[str] = []

    def watched(task: Task) -> Result:
        tried.append(Path(task.path).name)
        if task.path.endswith("0.tlog") and tried.count("0.tlog") == 1:
            return Result(failure="this once")
        return survey_one(task)

    monkeypatch.setattr(run_module, "survey_one", watched)
    ran = surveyed([flights, flights / "gone.tlog"], tmp_path / "out")
    assert (ran.judged, ran.retried) == (5, 4)
    assert [tried.count(name) for name in ("0.tlog", "1.tlog", "empty.tlog", "text.tlog", "gone.tlog")] == [
        2,
        1,
        2,
        2,
        2,
    ]
    assert len(ran.failures) == 3
    assert all(Path(line.partition(": ")[0]).name in {"empty.tlog", "text.tlog", "gone.tlog"} for line in ran.failures)
    assert surveyed([flights], tmp_path / "out").retried == 2


def test_one_survey_writes_at_a_time(tmp_path: Path) -> None:
    """The second is told so."""
    with Dataset(tmp_path, "1", DIGEST), pytest.raises(UsageError, match="another survey"):
        Dataset(tmp_path, "1", DIGEST)


def test_a_folder_that_is_none_of_ours(tmp_path: Path) -> None:
    """Nothing in it is touched."""
    (tmp_path / "survey.json").write_text(json.dumps({"mine": 1}))
    with pytest.raises(UsageError, match="no survey of ours"):
        Dataset(tmp_path, "1", DIGEST)
    assert json.loads((tmp_path / "survey.json").read_text()) == {"mine": 1}
    (tmp_path / "survey.json").unlink()
    (tmp_path / "recordings").mkdir()
    with pytest.raises(UsageError, match="no survey of ours"):
        Dataset(tmp_path, "1", DIGEST)


def test_a_part_that_is_damaged(tmp_path: Path) -> None:
    """It is named, and what to do about it."""
    with Dataset(tmp_path, "1", DIGEST) as dataset:
        dataset.add(handmade("a", {}))
    (tmp_path / "recordings" / "part-000000.parquet").write_bytes(b"PAR1 no more")
    with pytest.raises(UsageError, match=r"part-000000.parquet: cannot be read .*move it away"):
        Dataset(tmp_path, "1", DIGEST)


def test_a_full_disk_keeps_what_was_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One line; of what could not be written nothing is left, and the rest is there."""
    write = os.write

    def full(file: int, data: Any) -> int:
        if b'"content":"b"' in bytes(data):
            write(file, bytes(data)[:20])
            raise OSError(28, "No space left on device")
        return write(file, data)

    monkeypatch.setattr(os, "write", full)
    dataset = Dataset(tmp_path, "1", DIGEST)
    dataset.add(handmade("a", {}))
    with pytest.raises(UsageError, match=r"cannot write .*: No space left on device"):
        dataset.add(handmade("b", {}))
    dataset.__exit__(UsageError)
    monkeypatch.undo()
    assert [row["content"] for row in rows(tmp_path, "recordings")] == ["a"]
    with Dataset(tmp_path, "1", DIGEST) as again:
        assert len(again) == 1
