"""The report as the comment on a pull request: the verdict, a table of vehicles, and each alarm behind a fold.

Text that comes from files or from the air is escaped: it can neither mark up nor mention anybody.
"""

from __future__ import annotations

import html
import re
from collections.abc import Iterator, Sequence

from gcs_bridge.contract import Alarm
from gcs_bridge.errors import one_line
from gcs_bridge.report import Report, text
from gcs_bridge.report.baseline import Known
from gcs_bridge.report.rows import in_percent, in_seconds
from gcs_bridge.report.schema import File, Vehicle
from gcs_bridge.report.verdicts import LABELS, UNJUDGED

__all__ = ["comment"]

_SIGNS = {"agree": "✅", "explained": "✅", "warning": "⚠️", "alarm": "❌", "no_compare": "❔", "inop": "❔"}
_REFERENCE = re.compile(r"(?:[@#]|\bgh-)(?=\w)|\bwww(?=\.)", re.IGNORECASE)
_MARKUP = re.compile(r"([\\`*_\[\]|~$])")
_MOST_SIGNS = 60_000  # GitHub takes comments of up to 65,536
_MARK = "<!-- gcs-bridge check -->"  # by which a later comment finds the one that it takes the place of


def comment(report: Report, *, known: Known, refused: Sequence[str]) -> str:
    """The comment: at most 60,000 characters, and what is left out is said."""
    head = [_MARK, f"### {_SIGNS[report.verdict]} Attitude: {LABELS[report.verdict]}", ""]
    if report.files:
        head += ["| recording | vehicle | verdict | both forms compared | what |", "| --- | --- | --- | --- | --- |"]
    rows = [row for entry in report.files for row in _rows(entry, known)]
    folds = ["".join(_fold(entry, vehicle, alarm, known)) for entry, vehicle, alarm in _alarms(report.files)]
    told = [f"- ❌ {_escaped(line)}" for line in refused]
    lines, left = [*head], _MOST_SIGNS - sum(map(len, head))
    for part, word in ((rows, "vehicles"), (["", *told] if told else [], "sources"), (["", *folds], "alarms")):
        for i, line in enumerate(part):
            left -= len(line) + 1
            if left < 0:
                lines += ["", f"{len(part) - i} more {word} are left out: `check --format json` has all."]
                return "\n".join(lines) + "\n"
            lines.append(line)
    return "\n".join(lines).rstrip() + "\n"


def _rows(entry: File, known: Known) -> Iterator[str]:
    path = _escaped(entry.path)
    if not entry.vehicles:
        yield f"| {path} | – | {_verdict(entry.verdict)} | – | {_escaped(text.summary(entry))} |"
    for vehicle in entry.vehicles:
        check = next((one for one in vehicle.checks if one.name == "euler_quaternion"), None)
        judged = check is not None and check.verdict not in UNJUDGED
        share = in_percent(check.coverage) if check is not None and judged else "no"
        name = f"{vehicle.sysid},{vehicle.compid} {vehicle.autopilot} {vehicle.type}"
        what = _escaped(_what(entry, vehicle, known))
        yield f"| {path} | {_escaped(name)} | {_verdict(vehicle.verdict)} | {share} | {what} |"


def _verdict(verdict: str) -> str:
    return f"{_SIGNS[verdict]} {LABELS[verdict]}"


def _what(entry: File, vehicle: Vehicle, known: Known) -> str:
    """What was raised; else what explains differences, or why nothing could be compared."""
    if vehicle.alarms:
        new = sum((entry.path, alarm.id) not in known.alarms for alarm in vehicle.alarms)
        as_before = len(vehicle.alarms) - new
        said = [f"{new} raised"] * bool(new) + [f"{as_before} as in the baseline"] * bool(as_before)
        checks = ", ".join(dict.fromkeys(alarm.check for alarm in vehicle.alarms))
        return f"{', '.join(said)}: {checks}"
    causes = dict.fromkeys(cause.cause for check in vehicle.checks for cause in check.explained_by)
    if causes:
        return f"explained by {', '.join(causes)}"
    commands = [f"in {where}: {command}" for where, command in text.requests(vehicle)]
    if commands:
        return "; ".join(commands)
    check = next((one for one in vehicle.checks if one.name == "euler_quaternion"), None)
    return check.reason if check is not None and check.verdict in UNJUDGED else ""


def _alarms(files: Sequence[File]) -> Iterator[tuple[File, Vehicle, Alarm]]:
    for entry in files:
        for vehicle in entry.vehicles:
            for alarm in vehicle.alarms:
                yield entry, vehicle, alarm


def _fold(entry: File, vehicle: Vehicle, alarm: Alarm, known: Known) -> Iterator[str]:
    cause = "" if alarm.diagnosis is None else f", {alarm.diagnosis.cause}"
    before = " (as in the baseline)" if (entry.path, alarm.id) in known.alarms else ""
    when = in_seconds(alarm.raised_boot_s)
    yield f"<details><summary>{_SIGNS[alarm.severity]} {LABELS[alarm.severity]} "
    yield _plain(f"{entry.path}, vehicle {vehicle.sysid},{vehicle.compid}: {alarm.check} at {when}{cause}{before}")
    yield f"</summary>\n\n{_escaped(text.alarm_line(alarm))}\n\n</details>\n"


def _escaped(said: str) -> str:
    r"""Text as it is, in Markdown: what would mark up, link or mention is taken for what it looks like.

    >>> _escaped("a|b_c <script> http://x")
    'a\\|b\\_c &lt;script&gt; http&#58;//x'
    """
    return _MARKUP.sub(r"\\\1", _plain(said)).replace("://", "&#58;//")


def _plain(said: str) -> str:
    """Text as it is, in HTML. A sign without width stands in @name, #12 and www.: nothing is mentioned or linked."""
    return html.escape(_REFERENCE.sub("\\g<0>\N{WORD JOINER}", one_line(said)), quote=False)
