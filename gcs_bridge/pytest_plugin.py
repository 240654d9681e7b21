"""A fixture for other projects' pytest: simulation runs whose recordings must agree in attitude.

    def test_the_mission(gcs_bridge):
        fly()
        gcs_bridge.assert_attitude_agrees("flight.tlog")

It is there once gcs-bridge is installed. What it needs is loaded with the first recording.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from gcs_bridge.report import Report
    from gcs_bridge.settings import FailOn

__all__ = ["AttitudeAssertions", "gcs_bridge"]


class AttitudeAssertions:
    """What the fixture `gcs_bridge` offers."""

    def check(self, *paths: str | os.PathLike[str], **asked: Any) -> Report:
        """Judge recordings; `asked` as `gcs_bridge.check` takes it. SourceError for what cannot be read."""
        from gcs_bridge import check
        from gcs_bridge.report import Report

        return Report.of(entry for path in paths for entry in check(os.fspath(path), **asked).files)

    def assert_attitude_agrees(
        self,
        *paths: str | os.PathLike[str],
        fail_on: FailOn = "alarm",
        baseline: str | os.PathLike[str] | None = None,
        **asked: Any,
    ) -> Report:
        """Fail the test where `gcs-bridge check` would not end with 0, and say why; return the report.

        An alarm fails (a warning too, with fail_on="warning"), and so does an attitude that could be compared with
        nothing. What is in `baseline`, an earlier JSON report, fails nothing. `asked`: sysid, from_s, to_s, profile and
        what else `gcs_bridge.check` takes.
        """
        __tracebackhide__ = True
        from gcs_bridge.report.baseline import NOTHING_KNOWN, known_from, read_baseline

        if not paths:
            raise TypeError("assert_attitude_agrees: name a recording; of none, nothing can be asserted")
        report = self.check(*paths, **asked)
        known = NOTHING_KNOWN if baseline is None else known_from(report.files, read_baseline(Path(baseline)))
        if report.exit_code(fail_on, known):
            pytest.fail(report.to_text(), pytrace=False)
        return report


@pytest.fixture(scope="session")
def gcs_bridge() -> AttitudeAssertions:
    """Judges the attitudes of recordings: `gcs_bridge.assert_attitude_agrees("flight.tlog")`."""
    return AttitudeAssertions()
