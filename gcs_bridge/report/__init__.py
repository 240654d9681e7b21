"""One or more judged recordings → a report: its verdict, its exit code, JSON and text.

A report only puts together what the recordings' judges found; it measures nothing itself.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from gcs_bridge._version import __version__
from gcs_bridge.contract import plain
from gcs_bridge.report import text
from gcs_bridge.report.baseline import NOTHING_KNOWN, Known
from gcs_bridge.report.schema import File, Verdict
from gcs_bridge.report.verdicts import EXIT_CODES, SCHEMA, compared, fails, sends_attitude, worst_verdict
from gcs_bridge.settings import FailOn

__all__ = ["Report", "all_compared", "worst_exit_code"]


class Report(msgspec.Struct, frozen=True, kw_only=True):
    """The judgement of some recordings or links. Unknown is null, never 0."""

    schema: Literal["gcs-bridge/report/1"]
    version: Annotated[str, Meta(description="of gcs-bridge")]
    verdict: Annotated[Verdict, Meta(description="the worst of the files'; no_compare without a file")]
    files: tuple[File, ...]

    @classmethod
    def of(cls, files: Iterable[File]) -> Report:
        """Put together what the judges found."""
        files = tuple(files)
        verdict = worst_verdict(entry.verdict for entry in files)
        return cls(schema=SCHEMA, version=__version__, verdict=verdict, files=files)

    def to_dict(self) -> dict[str, Any]:
        """The JSON report as plain Python values; what is unknown is None."""
        return dict(plain(self))

    def to_json(self) -> str:
        """The report as one indented JSON object."""
        return msgspec.json.format(msgspec.json.encode(self), indent=2).decode() + "\n"

    def to_text(self, *, detail: int = 0) -> str:
        """The report for reading; `detail` -1 gives the last lines alone, 1 every number."""
        return "\n".join(text.lines(self.files, detail=detail)) + "\n"

    def exit_code(self, fail_on: FailOn = "alarm", known: Known = NOTHING_KNOWN) -> int:
        """0 good, 1 an alarm (or a warning, if that is to fail), 4 an attitude that nothing was compared with.

        What is known from a baseline is good.
        """
        if fail_on == "never":
            return 0
        return worst_exit_code(
            1 if _has_failed(entry, fail_on, known) else 0 if all_compared(entry, known) else 4 for entry in self.files
        )


def worst_exit_code(codes: Iterable[int]) -> int:
    """The worst of several recordings' exit codes, 0 if there are none."""
    return min(codes, key=EXIT_CODES.index, default=0)


def _has_failed(entry: File, fail_on: FailOn, known: Known) -> bool:
    """Whether anything that is to fail was raised, and was not before."""
    failing = [alarm.id for vehicle in entry.vehicles for alarm in vehicle.alarms if fails(alarm.severity, fail_on)]
    as_before = bool(failing) and all((entry.path, of) in known.alarms for of in failing)
    return fails(entry.verdict, fail_on) and not as_before


def all_compared(entry: File, known: Known = NOTHING_KNOWN) -> bool:
    """Whether there is an attitude, and each vehicle's was judged by something; or neither was so before."""
    flying = [vehicle for vehicle in entry.vehicles if sends_attitude(vehicle)]
    if not flying:
        return entry.path in known.empty
    return all(compared(one) or (entry.path, one.sysid, one.compid) in known.uncompared for one in flying)
