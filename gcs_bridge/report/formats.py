"""The formats of a report."""

from __future__ import annotations

from collections.abc import Callable

from gcs_bridge.report import Report

__all__ = ["FORMATS"]

# By name: a function of the report and of how much detail is wanted, from −1 to 1.
FORMATS: dict[str, Callable[[Report, int], str]] = {
    "text": lambda report, detail: report.to_text(detail=detail),
    "json": lambda report, _: report.to_json(),
}
