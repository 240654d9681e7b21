"""What a recording's page says: one file that needs no other, made of the report's entry and the curves."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from gcs_bridge._version import __version__
from gcs_bridge.columns import Floats, Int64s
from gcs_bridge.pages.curves import BootCurves, Curves
from gcs_bridge.pages.moment import drawn
from gcs_bridge.pages.templates import asset, template
from gcs_bridge.report import text
from gcs_bridge.report.rows import in_percent
from gcs_bridge.report.schema import Check, File, Vehicle
from gcs_bridge.report.verdicts import UNJUDGED, worst_verdict
from gcs_bridge.report.wording import difference, quantity

__all__ = ["overview", "page"]

_MOST_BOOTS = 12  # with curves


def page(entry: File, curves: Curves, *, back: str = "") -> str:
    """The page of one recording; `back` is a link to an overview, if there is one."""
    data = [
        {"id": f"{vehicle.sysid}-{vehicle.compid}-{index}", **_plotted(boot), "alarms": _spans(vehicle, index)}
        for vehicle, index, boot in _boots(entry, curves)
    ]
    return template("recording.html").render(
        entry=entry,
        back=back,
        version=__version__,
        summary=text.summary(entry),
        salvage=text.salvage_line(entry.salvage),
        vehicles=[_vehicle(vehicle, entry, curves) for vehicle in entry.vehicles],
        data=_embedded(data),
        script=asset("uPlot.min.js") + asset("page.js"),
        style=asset("uPlot.min.css") + asset("page.css"),
    )


def overview(entries: Sequence[File], links: Sequence[str], refused: Sequence[str]) -> str:
    """The page that leads to others: a line for each recording, and for each source that could not be used."""
    verdict = worst_verdict(entry.verdict for entry in entries)
    rows = [
        {"entry": entry, "link": link, "summary": text.summary(entry)}
        for entry, link in zip(entries, links, strict=True)
    ]
    return template("overview.html").render(
        verdict=verdict, rows=rows, refused=refused, version=__version__, style=asset("page.css")
    )


def _boots(entry: File, curves: Curves) -> list[tuple[Vehicle, int, BootCurves]]:
    """The boots that have curves, as many as are shown."""
    found = [
        (vehicle, boot.index, curves.boots[vehicle.sysid, vehicle.compid, boot.index])
        for vehicle in entry.vehicles
        for boot in vehicle.boots
        if (vehicle.sysid, vehicle.compid, boot.index) in curves.boots
    ]
    return found[:_MOST_BOOTS]


def _vehicle(vehicle: Vehicle, entry: File, curves: Curves) -> dict[str, Any]:
    shown = {(of.sysid, of.compid, index) for of, index, _ in _boots(entry, curves)}
    boots = [boot for boot in vehicle.boots if (vehicle.sysid, vehicle.compid, boot.index) in shown]
    return {
        "of": vehicle,
        "boots": boots,
        "left_out": len(vehicle.boots) - len(boots),
        "checks": [_check(check) for check in vehicle.checks],
        "alarms": [
            {
                "of": alarm,
                "when": text.when_raised(alarm),
                "what": difference(alarm),
                "moment": _moment(curves, alarm.id),
                "value": None if alarm.diagnosis is None else text.value_of(alarm.diagnosis),
            }
            for alarm in vehicle.alarms
        ],
        "resets": [text.reset_line(reset) for reset in vehicle.resets],
        "requests": text.requests(vehicle),
    }


def _moment(curves: Curves, alarm_id: str) -> Any:
    moment = curves.moments.get(alarm_id)
    return None if moment is None else drawn(moment.q_euler, moment.q_quaternion)


def _check(check: Check) -> dict[str, Any]:
    judged = check.verdict not in UNJUDGED
    return {
        "of": check,
        "coverage": in_percent(check.coverage) if judged else "–",
        "median": quantity(check.residual.median, check.unit) if judged and check.pairs else "–",
        "max": quantity(check.residual.max, check.unit) if judged and check.pairs else "–",
        "explained": [text.explained_line(cause) for cause in check.explained_by],
    }


def _spans(vehicle: Vehicle, boot: int) -> list[dict[str, Any]]:
    """When alarms of a boot were on, and warnings, s of boot time; null: to the end. Those that overlap are one."""
    spans: list[dict[str, Any]] = []
    for severity in ("alarm", "warning"):
        raised = [
            (alarm.raised_boot_s, math.inf if alarm.cleared_boot_s is None else alarm.cleared_boot_s)
            for alarm in vehicle.alarms
            if alarm.boot == boot and alarm.severity == severity and alarm.raised_boot_s is not None
        ]
        joined: list[tuple[float, float]] = []
        for start, end in sorted(raised):
            if joined and start <= joined[-1][1]:
                joined[-1] = joined[-1][0], max(end, joined[-1][1])
            else:
                joined.append((start, end))
        spans += [
            {"from": start, "to": None if math.isinf(end) else end, "severity": severity} for start, end in joined
        ]
    return spans


def _plotted(boot: BootCurves) -> dict[str, Any]:
    return {
        "euler": _columns(*boot.euler.rows(), digits=3),
        "quaternion": _columns(*boot.quaternion.rows(), digits=3),
        "pairs": _columns(*boot.pairs.rows(), digits=5),
    }


def _columns(t_us: Int64s, values: Floats, digits: int) -> list[list[float | None]]:
    """Time in s, then each curve; null where there is no value, or none that can be drawn: JSON knows no infinity."""
    columns = [np.round(t_us / 1e6, 3), *np.round(values, digits).T]
    return [[value if math.isfinite(value) else None for value in column.tolist()] for column in columns]


def _embedded(data: Any) -> str:
    """JSON that cannot end the element that it stands in."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
