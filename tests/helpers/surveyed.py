"""Surveys without processes of their own, and datasets of rows made by hand."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from gcs_bridge.executors.base import Executor
from gcs_bridge.executors.here import Here
from gcs_bridge.settings import Settings
from gcs_bridge.survey.dataset import Dataset
from gcs_bridge.survey.found import find
from gcs_bridge.survey.parts import TABLES
from gcs_bridge.survey.run import Ran, survey
from gcs_bridge.survey.task import Asked, Pages, Result

DIGEST = "0123456789ab"


class Unwatched:
    """Nobody looks on."""

    def planned(self, files: int, size: int) -> None:
        pass

    def done(self, ran: Ran, size: int) -> None:
        pass


def surveyed(
    paths: Iterable[Any], folder: Path, *, digest: str = DIGEST, version: str = "1", pages: bool = False
) -> Ran:
    """Survey some paths into a folder, in this process."""
    with Dataset(folder, version, digest) as dataset:
        return surveyed_into(dataset, paths, pages=pages)


def surveyed_into(
    dataset: Dataset, paths: Iterable[Any], *, pages: bool = False, executor: Executor | None = None
) -> Ran:
    """The same into a dataset that is open, in this process or by an executor."""
    asked = Asked(
        settings=Settings(),
        judged_by={},
        settings_digest=DIGEST,
        pages=Pages(folder=str(dataset.folder), token=dataset.token, every=False) if pages else None,
    )
    return survey(find(map(str, paths)), dataset, asked, executor or Here(), Unwatched())


def rows(folder: Path, table: str) -> list[dict[str, Any]]:
    """All rows of a table, as pyarrow reads its parts."""
    found: list[dict[str, Any]] = []
    for part in sorted((folder / table).glob("*.parquet")):
        found += pq.read_table(part).to_pylist()
    return found


def handmade(
    content: str,
    recording: dict[str, Any],
    checks: Iterable[dict[str, Any]] = (),
    alarms: Iterable[dict[str, Any]] = (),
) -> Result:
    """What a worker would give back, of the values that are given; all others are unknown."""
    known_by = {"content": content, "path": f"{content}.tlog", "folder": "logs", "start_utc": None}
    given = {name: recording[name] for name in known_by if name in recording}
    file = {"stamp": "1", "file_bytes": 1000, "recordings_in_file": 1, "compared": True, "verdict": "agree"}

    def row(table: str, values: dict[str, Any]) -> dict[str, Any]:
        return dict.fromkeys(TABLES[table].names) | known_by | given | values

    return Result(
        recording=row("recordings", {"flight_s": 600.0, "bytes": 1000, "alarms": 0, "warnings": 0} | file | recording),
        checks=[row("checks", check) for check in checks],
        alarms=[row("alarms", alarm) for alarm in alarms],
        bytes=1000,
    )
