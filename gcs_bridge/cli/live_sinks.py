"""The sinks that a live command can be asked for: each a line of a table, and an option of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from gcs_bridge.errors import UsageError
from gcs_bridge.sinks.base import Plan
from gcs_bridge.sinks.event_lines import EventLines
from gcs_bridge.sinks.tlog import TlogRecorder
from gcs_bridge.viewer.base import FORMS
from gcs_bridge.viewer.open import plan_viewer

__all__ = ["LIVE_SINKS", "SinkOption", "plan_sinks"]


@dataclass(frozen=True)
class SinkOption:
    """A sink's option: how its value is written, its help, and what the value means; None: no sink."""

    metavar: str
    help: str
    plan: Callable[[str], Plan | None]
    default: str | None = None


# By the option's name; the help lists them in this order.
LIVE_SINKS = {
    "viewer": SinkOption("WHICH", f"{FORMS}.  [auto]", plan_viewer, default="auto"),
    "record": SinkOption("FILE.tlog", "Append every frame.", TlogRecorder.plan),
    "events": SinkOption("FILE|-", "Append events as JSON lines; - is standard output.", EventLines.plan),
}


def plan_sinks(asked: Mapping[str, str]) -> list[Plan]:
    """The sinks that the options' values ask for, none opened yet; the viewer is the last: files must not wait for it.

    Raises UsageError for a value that is wrong, and for two sinks that would write one file.
    """
    plans = {name: plan for name, option in LIVE_SINKS.items() if name in asked and (plan := option.plan(asked[name]))}
    written: dict[object, str] = {}
    for name, plan in plans.items():
        if plan.writes is not None:
            other = written.setdefault(plan.writes.resolve(), name)
            if other != name:
                raise UsageError(f"--{other} and --{name} cannot both write {asked[other]}")
    return list(plans.values())[::-1]
