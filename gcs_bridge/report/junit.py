"""The report for CI's own pages of tests: JUnit's XML, a suite a file, a case for each check of each vehicle.

The same input gives the same bytes: there is no time of day and no host in it. A case is known by its suite and its
name, `sysid.compid.check`.
"""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree

from gcs_bridge.errors import one_line
from gcs_bridge.report import text
from gcs_bridge.report.baseline import Known
from gcs_bridge.report.schema import Check, File, Vehicle
from gcs_bridge.report.verdicts import UNJUDGED, compared, fails, sends_attitude
from gcs_bridge.report.wording import difference
from gcs_bridge.settings import FailOn

__all__ = ["suites"]

_READABLE = "readable"  # the only case of a source that could not be used
_HAS_ATTITUDE = "attitude"  # and of a recording in which none came


def suites(files: Sequence[File], *, fail_on: FailOn, known: Known, refused: Sequence[tuple[str, str]]) -> str:
    """The XML of a report.

    What ends `check` with 1 is a failure, what ends it with 3 or 4 an error; what was so in the baseline is neither.
    A check that could not judge a vehicle is skipped, with the reason: as long as another one judged that vehicle.
    `refused`: path and message of sources that could not be used.
    """
    root = ElementTree.Element("testsuites", name="gcs-bridge check")
    for entry in files:
        _suite(root, entry, fail_on, known)
    for path, line in refused:
        suite = ElementTree.SubElement(root, "testsuite", name=one_line(path))
        _told(_case(suite, path, _READABLE), "error", "source", line.removeprefix(f"{path}: "))
        _count(suite)
    _count(root)
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _suite(root: ElementTree.Element, entry: File, fail_on: FailOn, known: Known) -> None:
    suite = ElementTree.SubElement(root, "testsuite", name=one_line(entry.path))
    for vehicle in entry.vehicles:
        for check in vehicle.checks:
            case = _case(suite, entry.path, f"{vehicle.sysid}.{vehicle.compid}.{check.name}")
            _judge(case, entry, vehicle, check, fail_on, known)
    if not any(map(sends_attitude, entry.vehicles)):
        may = fail_on == "never" or entry.path in known.empty
        why = "no attitude came: there was nothing to compare"
        _told(_case(suite, entry.path, _HAS_ATTITUDE), "skipped" if may else "error", "no_compare", why)
    _count(suite)


def _judge(
    case: ElementTree.Element, entry: File, vehicle: Vehicle, check: Check, fail_on: FailOn, known: Known
) -> None:
    """Say in a case what a check came to."""
    raised = [alarm for alarm in vehicle.alarms if alarm.check == check.name]
    new = [alarm for alarm in raised if (entry.path, alarm.id) not in known.alarms]
    failing = [alarm for alarm in new if fails(alarm.severity, fail_on)]
    if failing:
        worst = next((alarm for alarm in failing if alarm.severity == "alarm"), failing[0])
        _told(case, "failure", worst.severity, difference(worst), *map(text.alarm_line, failing))
    others = [alarm for alarm in raised if alarm not in failing]
    if others:
        said = [f"{'' if alarm in new else 'as in the baseline: '}{text.alarm_line(alarm)}" for alarm in others]
        ElementTree.SubElement(case, "system-out").text = "\n".join(map(one_line, said))
    if raised or check.verdict not in UNJUDGED:
        return
    # No other check judged it either: the one that compares both messages stands for them.
    alone = check.name == "euler_quaternion" and sends_attitude(vehicle) and not compared(vehicle)
    may = fail_on == "never" or (entry.path, vehicle.sysid, vehicle.compid) in known.uncompared
    _told(case, "error" if alone and not may else "skipped", check.verdict, check.reason or check.verdict)


def _case(suite: ElementTree.Element, path: str, name: str) -> ElementTree.Element:
    return ElementTree.SubElement(suite, "testcase", classname=one_line(path), name=name)


def _told(case: ElementTree.Element, tag: str, kind: str, message: str, *lines: str) -> None:
    told = ElementTree.SubElement(case, tag, type=kind, message=one_line(message))
    if lines:
        told.text = "\n".join(map(one_line, lines))


def _count(of: ElementTree.Element) -> None:
    """Say how many cases there are, and what became of them."""
    cases = list(of.iter("testcase"))
    of.set("tests", str(len(cases)))
    for attribute, tag in (("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
        of.set(attribute, str(sum(case.find(tag) is not None for case in cases)))
