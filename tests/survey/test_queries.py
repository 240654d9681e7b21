"""docs/survey.md: each query runs as it stands, and gives what plain Python finds in the same rows."""

import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from contextlib import chdir
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs_bridge.survey.dataset import Dataset
from gcs_bridge.survey.summary import Run, summarised
from tests.helpers.everyday import one_in
from tests.helpers.paths import ROOT
from tests.helpers.surveyed import handmade

duckdb = pytest.importorskip("duckdb", reason="the test extra installs it")

TEXT = (ROOT / "docs" / "survey.md").read_text(encoding="utf-8")
QUERIES = dict(re.findall(r"^([^\n]+):\n\n```sql\n(.*?)```", TEXT, re.MULTILINE | re.DOTALL))
DAY_US = 86_400_000_000
START_US = round(datetime(2026, 11, 1, tzinfo=UTC).timestamp() * 1e6)
BIAS_Z = [0.10, 0.12, 0.11, 0.15, 0.13]  # of five flights of vehicle a, a day after another
TRIMS = [3.0, 3.0, None, 4.5, 3.2]
ALARMS = [("a1", "yaw_offset"), ("a1", "yaw_offset"), ("a3", "yaw_offset"), ("b0", "mount_offset"), ("b1", "unknown")]
RUN = Run(judged=0, known=0, copies=0, retried=0, bytes=0, wall_s=0.0, workers=1)


def flights() -> list[tuple[str, dict[str, Any], list[dict[str, Any]], list[dict[str, Any]]]]:
    """Content, recording, checks and alarms of seven flights: five of vehicle a, two of b."""
    made = []
    for number in range(7):
        folder, at = ("a", number) if number < 5 else ("b", number - 5)
        content = f"{folder}{at}"
        alarms = [one for one in ALARMS if one[0] == content]
        recording = {
            "folder": folder,
            "start_utc": START_US + at * DAY_US,
            "flight_s": 600.0 + 100 * number,
            "verdict": "alarm" if alarms else ("agree" if at else "no_compare"),
            "alarms": len(alarms),
            "first_alarm": "euler_quaternion" if alarms else None,
            "first_cause": alarms[0][1] if alarms else None,
        }
        vehicle = {"sysid": 1, "compid": 1, "type": "quadrotor"}
        bias = BIAS_Z[at] if folder == "a" else 0.5
        checks: list[dict[str, Any]] = [
            {"check": "gyro", "verdict": "agree", "unit": "deg/s", "bias_z": bias, "residual_p99": 1.0 + number},
            {
                "check": "euler_quaternion",
                "verdict": "explained" if folder == "a" else "no_compare",
                "reason": f"only {number} pairs could be judged",
                "unit": "deg",
                "pitch_trim_deg": TRIMS[at] if folder == "a" else None,
                "residual_p99": 0.001 * number if folder == "a" else None,
            },
        ]
        raised = [
            {"check": "euler_quaternion", "severity": "alarm", "what": "w", "cause": cause} for _, cause in alarms
        ]
        made.append((content, recording, [vehicle | one for one in checks], [vehicle | one for one in raised]))
    return made


FLIGHTS = flights()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of these flights in two parts; another version judged a0 and a1 to agree, and nothing else."""
    made: Path = tmp_path_factory.mktemp("survey")
    with Dataset(made / "fleet", "0", "before") as dataset:
        for content, recording, checks, _ in FLIGHTS[:2]:
            dataset.add(handmade(content, recording | {"verdict": "agree"}, checks))
    with pytest.MonkeyPatch.context() as patched, Dataset(made / "fleet", "1", "now") as dataset:
        patched.setattr("gcs_bridge.survey.dataset._PART", 4)
        for content, recording, checks, alarms in FLIGHTS:
            dataset.add(handmade(content, recording, checks, alarms))
    return made


def of_verdicts() -> Iterable[tuple[Any, ...]]:
    hours: dict[str, list[float]] = defaultdict(list)
    for _, recording, _, _ in FLIGHTS:
        hours[recording["verdict"]].append(recording["flight_s"] / 3600)
    return sorted(((name, len(each), sum(each)) for name, each in hours.items()), key=lambda row: (-row[1], row[0]))


def of_worst() -> Iterable[tuple[Any, ...]]:
    found = [
        (
            f"{content}.tlog",
            one["alarms"],
            one["first_alarm"],
            one["first_cause"],
            one["alarms"] * 3600 / one["flight_s"],
        )
        for content, one, _, _ in FLIGHTS
        if one["alarms"]
    ]
    return sorted(found, key=lambda row: -row[-1])


def of_drift() -> Iterable[tuple[Any, ...]]:
    slope = np.polyfit(np.arange(5), BIAS_Z, 1)[0]  # a day
    return [("a", 1, 1, 5, slope * 365)]


def of_limits() -> Iterable[tuple[Any, ...]]:
    trims = np.quantile([0.001 * number for number in range(5)], 0.95)
    return [
        ("euler_quaternion", "quadrotor", "deg", 5, trims),
        ("gyro", "quadrotor", "deg/s", 7, np.quantile(np.arange(1.0, 8.0), 0.95)),
    ]


EXPECTED: dict[str, Callable[[], Iterable[tuple[Any, ...]]]] = {
    "What the fleet came to": of_verdicts,
    "Worst flights, by alarms an hour": of_worst,
    "Which mistakes are behind it, and in how many recordings": lambda: [
        ("yaw_offset", 2, 3),
        ("mount_offset", 1, 1),
    ],
    "What was never compared, and why": lambda: [("euler_quaternion", "only N pairs could be judged", 2)],
    "How the gyro's bias drifts, in deg/s a year, of vehicles with three flights or more": of_drift,
    "Vehicles whose pitch trim was changed": lambda: [("a", 1, 1, 3.0, 4.5)],
    "How healthy data lie below a limit, by kind of vehicle": of_limits,
    "What another version, or other settings, judged otherwise": lambda: [
        ("a0.tlog", "agree", "no_compare"),
        ("a1.tlog", "agree", "alarm"),
    ],
}


def test_every_query_is_tested() -> None:
    """What the page shows is what is here."""
    assert set(QUERIES) == set(EXPECTED)


@pytest.mark.parametrize("title", one_in(3, EXPECTED, swept=False))
def test_a_query(title: str, folder: Path) -> None:
    """Its rows, in its order."""
    with chdir(folder), duckdb.connect() as connection:
        found = connection.sql(QUERIES[title]).fetchall()
    expected = list(EXPECTED[title]())
    assert len(found) == len(expected)
    for row, wanted in zip(found, expected, strict=True):
        assert row == pytest.approx(wanted)


def test_the_summary_says_the_same(folder: Path) -> None:
    """Counts by hand; the drift of vehicle a by a line through its five flights."""
    summary = summarised(folder / "fleet", RUN, [], None)
    counts = Counter(one["verdict"] for _, one, _, _ in FLIGHTS)
    assert summary.verdicts == {name: counts[name] for name in ("alarm", "warning", "no_compare", "agree")}
    assert summary.verdict == "alarm"
    assert [(one.cause, one.recordings, one.alarms) for one in summary.causes] == [
        ("yaw_offset", 2, 3),
        ("mount_offset", 1, 1),
    ]
    assert summary.checks["euler_quaternion"] == {"explained": 5, "no_compare": 2}
    assert [(one.path, one.alarms) for one in summary.worst] == [
        ("a1.tlog", 2),
        ("a3.tlog", 1),
        ("b0.tlog", 1),
        ("b1.tlog", 1),
    ]
    (drift,) = (one for one in summary.drift if one.quantity == "gyro bias z")
    assert (drift.vehicle, drift.flights, drift.unit) == ("a 1,1", 5, "deg/s")
    assert drift.change == pytest.approx(0.009 * 4)  # least squares by hand: Σ(t−2)(b−b̄)/Σ(t−2)² = 0.09/10
    assert drift.median == pytest.approx(0.12)
    assert [one.flights for one in summary.drift if one.quantity == "pitch trim"] == [4]


def test_vehicles_are_named_by_their_paths(folder: Path) -> None:
    """Where folders do not tell them apart: all flights of a fleet are one vehicle's here."""
    summary = summarised(folder / "fleet", RUN, [], re.compile(r"()"))
    assert [one.flights for one in summary.drift if one.quantity == "gyro bias z"] == [7]
