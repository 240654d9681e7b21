"""The sinks that a live command can be asked for: each a line of a table, and an option of its own."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from gcs_bridge.errors import UsageError
from gcs_bridge.sinks.base import Plan
from gcs_bridge.sinks.event_lines import EventLines
from gcs_bridge.sinks.tlog import TlogRecorder
from gcs_bridge.viewer.base import FORMS
from gcs_bridge.viewer.open import plan_viewer

__all__ = ["LIVE_SINKS", "SinkLimit", "SinkOption", "plan_sinks"]


@dataclass(frozen=True)
class SinkLimit:
    """A number above 0 that a sink can be given beside its value: the parameter of its `plan`, its unit, its help."""

    parameter: str
    metavar: str
    help: str


@dataclass(frozen=True)
class SinkOption:
    """A sink's option: how its value is written, its help, and what the value means; None: no sink.

    `limits` are further options of it, each by its ending: `--record-max-mb`.
    """

    metavar: str
    help: str
    plan: Callable[..., Plan | None]
    default: str | None = None
    limits: Mapping[str, SinkLimit] = field(default_factory=dict)


# By the option's name; the help lists them in this order.
LIVE_SINKS = {
    "viewer": SinkOption("WHICH", f"{FORMS}.  [auto]", plan_viewer, default="auto"),
    "record": SinkOption(
        "FILE.tlog",
        "Append every frame; of several links each in a file of its own, named after it.",
        TlogRecorder.plan,
        limits={
            "max-mb": SinkLimit("max_mb", "MB", "Go on in another file, as FILE_part002.tlog, before one is larger."),
            "max-minutes": SinkLimit("max_minutes", "MIN", "The same, when one is as old."),
        },
    ),
    "events": SinkOption("FILE|-", "Append events as JSON lines; - is standard output.", EventLines.plan),
}


def plan_sinks(asked: Mapping[str, str], limits: Mapping[str, Mapping[str, float]] | None = None) -> list[Plan]:
    """The sinks that the options' values ask for, none opened yet; the viewer is the last: files must not wait for it.

    `limits`: those that are given, by the sink's name and then by their own. Raises UsageError for a value that is
    wrong, and for two sinks that would write one file.
    """
    limits = limits or {}
    plans = {
        name: plan
        for name, option in LIVE_SINKS.items()
        if (more := _limits(name, option, limits.get(name, {}), given=name in asked)) is not None
        and (plan := option.plan(asked[name], **more))
    }
    written: dict[object, str] = {}
    for name, plan in plans.items():
        if plan.writes is not None:
            other = written.setdefault(plan.writes.resolve(), name)
            if other != name:
                raise UsageError(f"--{other} and --{name} cannot both write {asked[other]}")
    return list(plans.values())[::-1]


def _limits(name: str, option: SinkOption, limits: Mapping[str, float], *, given: bool) -> dict[str, float] | None:
    """The parameters that a sink's limits mean; None: the sink is not asked for."""
    for ending, value in limits.items():
        if not given:
            raise UsageError(f"--{name}-{ending} is for --{name}, which is missing")
        if not (math.isfinite(value) and value > 0):
            raise UsageError(f"--{name}-{ending} {value:g}: must be above 0")
    return {option.limits[ending].parameter: value for ending, value in limits.items()} if given else None
