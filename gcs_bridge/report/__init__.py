"""One or more judged recordings → a report: its verdict, its exit code, JSON and text.

A report only puts together what the recordings' judges found; it measures nothing itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import msgspec

from gcs_bridge._version import __version__
from gcs_bridge.report import text
from gcs_bridge.report.verdicts import EXIT_CODES, SCHEMA, compared, sends_attitude, worst_verdict
from gcs_bridge.settings import FailOn

__all__ = ["Report", "worst_exit_code"]


@dataclass(frozen=True, slots=True)
class Report:
    """The judgement of some recordings; `files` are entries as in the JSON contract."""

    files: tuple[dict[str, Any], ...]

    def __post_init__(self) -> None:
        # Cleaned once, here, so that JSON and text cannot tell different stories.
        object.__setattr__(self, "files", tuple(_plain(entry) for entry in self.files))

    @property
    def verdict(self) -> str:
        """The worst of the files' verdicts; without a file nothing was compared."""
        return worst_verdict(entry["verdict"] for entry in self.files)

    def to_dict(self) -> dict[str, Any]:
        """The JSON report as plain Python values; what is unknown is None."""
        return {"schema": SCHEMA, "version": __version__, "verdict": self.verdict, "files": _plain(self.files)}

    def to_json(self) -> str:
        """The report as one indented JSON object."""
        return msgspec.json.format(msgspec.json.encode(self.to_dict()), indent=2).decode() + "\n"

    def to_text(self, *, detail: int = 0) -> str:
        """The report for reading; `detail` -1 gives the last lines alone, 1 every number."""
        return "\n".join(text.lines(self.to_dict(), detail=detail)) + "\n"

    def exit_code(self, fail_on: FailOn = "alarm") -> int:
        """0 good, 1 an alarm (or a warning, if that is to fail), 4 an attitude that nothing was compared with."""
        if fail_on == "never":
            return 0
        failing = {"alarm"} if fail_on == "alarm" else {"alarm", "warning"}
        return worst_exit_code(
            1 if entry["verdict"] in failing else 0 if _all_compared(entry["vehicles"]) else 4 for entry in self.files
        )


def worst_exit_code(codes: Iterable[int]) -> int:
    """The worst of several recordings' exit codes, 0 if there are none."""
    return min(codes, key=EXIT_CODES.index, default=0)


def _all_compared(vehicles: Iterable[Mapping[str, Any]]) -> bool:
    """Whether there is an attitude, and each vehicle's was judged by something."""
    flying = [vehicle for vehicle in vehicles if sends_attitude(vehicle)]
    return bool(flying) and all(compared(vehicle) for vehicle in flying)


def _plain(value: Any) -> Any:
    """A copy in JSON's own types: arrays become lists, NaN and infinity None, undecodable file names readable."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):  # numpy's scalars and arrays, without importing numpy
        return _plain(value.tolist())
    if isinstance(value, float):
        return value if value - value == 0 else None
    if isinstance(value, str):
        return value.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
    return value
