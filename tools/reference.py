"""Writes the tables of the documentation that follow from the code: commands and options, limits, report, events.

python -m tools.reference           # writes them; a second run changes nothing
python -m tools.reference --check   # exit 1 if a page is not what would be written
"""

from __future__ import annotations

import json
import re
import sys
import tomllib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, Literal

import click

from gcs_bridge.cli.app import COMMANDS, command
from gcs_bridge.resources import config_folder, json_schema
from tools.inject_tables import as_markdown

DOCS = Path(__file__).parents[1] / "docs"


def _code(text: str) -> str:
    """As code within a cell of a table."""
    return f"`{text}`".replace("|", r"\|")


def _plain(text: str) -> str:
    """As prose within a cell: what Markdown would read is spelled out."""
    return re.sub(r"([*<|])", r"\\\1", " ".join(text.split()))


# --- commands --------------------------------------------------------------------------------------------------------


_HELP = "Show this message and exit."


def commands() -> str:
    """Each command: what it does, how it is called, its options, as its own help says."""
    parts = []
    for name in COMMANDS:
        one = command.get_command(click.Context(command), name)
        assert one is not None, name
        context = click.Context(one, info_name=f"gcs-bridge {name}")
        usage = " ".join(one.get_usage(context).removeprefix("Usage: ").split())
        records = [option.get_help_record(context) for option in one.get_params(context)]
        rows = [(_code(of), _plain(said)) for of, said in filter(None, records) if of.startswith("-") and said != _HELP]
        options = as_markdown(iter([("option", "meaning"), *rows]))
        parts.append(f"## {name}\n\n```text\n{usage}\n```\n\n{_paragraphs(one.help or '')}\n\n{options}")
    return "\n".join(parts)


def _paragraphs(text: str) -> str:
    """A command's own words; what is set in lines there stays in lines."""
    paragraphs = re.split(r"\n\s*\n", "\n".join(line.strip() for line in text.strip().splitlines()))
    return "\n\n".join(
        f"```text\n{one.removeprefix(chr(8)).strip()}\n```" if one.startswith("\b") else _plain(one)
        for one in paragraphs
    )


# --- limits ----------------------------------------------------------------------------------------------------------


def limits() -> str:
    """Each section of the settings: its keys, built-in values, units and reasons, as `config/example.toml` has them.

    A test of the settings holds that file and the code together.
    """
    text = (config_folder() / "example.toml").read_text(encoding="utf-8")
    values = tomllib.loads(text)
    parts = []
    for section in re.split(r"^(?=\[\w+\]$)", text, flags=re.MULTILINE)[1:]:
        name = section[1 : section.index("]")]
        head, rows = _section(section.splitlines()[1:], values[name])
        table = as_markdown(iter([("key", "built in", "unit, meaning and reason"), *rows]))
        parts.append(f"### [{name}]\n\n" + (f"{_plain(head)}\n\n" if head else "") + table)
    return "\n".join(parts)


def _section(lines: Iterable[str], values: dict[str, object]) -> tuple[str, list[tuple[str, str, str]]]:
    """What is said of the section, and a row a key: comments stand above what they are about."""
    head, said, rows = "", "", []
    for line in lines:
        key = line.partition(" = ")[0]
        if line.startswith("#"):
            said += line[1:]
        elif key in values:
            rows.append((_code(key), _code(line.partition(" = ")[2]), _plain(said)))
            said = ""
        elif said:
            head, said = said, ""
    return head, rows


# --- the JSON of reports and events ----------------------------------------------------------------------------------


def report() -> str:
    """Each part of the report with its keys, from the whole to its parts."""
    parts = _definitions("report")
    return "\n".join(
        f"### {name}\n\n{_plain(part['description'])}\n\n{as_markdown(_keys(part))}"
        for name, part in sorted(parts.items(), key=lambda item: list(_reached(parts, "Report")).index(item[0]))
    )


def event_kinds() -> str:
    """What every event has, then each kind with what it has beside."""
    kinds = {
        str(one["properties"]["event"]["enum"][0]): one for one in _definitions("event").values() if _is_event(one)
    }
    common = set.intersection(*(set(one["properties"]) for one in kinds.values()))
    any_kind = next(iter(kinds.values()))
    of_alarms = set(kinds["alarm_pending"]["properties"]) - common
    rows = [("event", "when", "and has")]
    for name, one in kinds.items():
        own = [key for key in one["properties"] if key not in common]
        shown = [_code(key) for key in own if key not in of_alarms or not of_alarms <= set(own)]
        if of_alarms <= set(own):
            shown.insert(0, "what an [alarm](#alarm) has")
        rows.append((_code(name), _plain(one["description"]), " ".join(shown)))
    of_all = {"properties": {key: said for key, said in any_kind["properties"].items() if key in common - {"event"}}}
    return f"{as_markdown(_keys(of_all))}\n{as_markdown(iter(rows))}"


def _definitions(name: Literal["report", "event"]) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(json_schema(name).read_bytes())["$defs"]
    return found


def _is_event(part: dict[str, Any]) -> bool:
    return "event" in part.get("properties", {})


def _reached(parts: dict[str, Any], name: str) -> Iterator[str]:
    """A part, and what it is made of, depth first."""
    yield name
    for key in parts[name]["properties"].values():
        for part in re.findall(r"#/\$defs/(\w+)", json.dumps(key)):
            yield from _reached(parts, part)


def _keys(part: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    yield "key", "is", "meaning"
    for key, said in part["properties"].items():
        yield _code(key), _kind(said), _plain(said.get("description", ""))


def _kind(said: dict[str, Any]) -> str:
    """A JSON Schema's type in a few words."""
    if "$ref" in said:
        name = said["$ref"].rpartition("/")[2]
        return f"[{name}](#{name.lower()})"
    if "enum" in said:
        return " ".join("null" if value is None else _code(str(value)) for value in said["enum"])
    if "anyOf" in said:
        return ", ".join(dict.fromkeys(_kind(one) for one in said["anyOf"]))
    if said.get("type") == "array":
        inside = said.get("items") or next(iter(said.get("prefixItems", [])), None)
        return "list" + (f" of {_kind(inside)}" if inside else "")
    if said.get("type") == "object":
        inside = said.get("additionalProperties")
        return "object" + (f" of {_kind(inside)}" if isinstance(inside, dict) else "")
    return " or ".join([said["type"]] if isinstance(said.get("type"), str) else said.get("type", ["anything"]))


# --- pages -----------------------------------------------------------------------------------------------------------

TABLES: dict[str, tuple[tuple[str, Callable[[], str]], ...]] = {
    "commands.md": (("commands", commands),),
    "checks.md": (("limits", limits),),
    "contract.md": (("report", report), ("events", event_kinds)),
}
"""By page of docs/: its marks, and what stands between each and the next `<!-- end -->`."""


def written(page: str) -> str:
    """The page with its tables made anew."""
    text = (DOCS / page).read_text(encoding="utf-8")
    for mark, make in TABLES[page]:
        before, begin, rest = text.partition(f"<!-- {mark} -->\n\n")
        _, end, behind = rest.partition("<!-- end -->")
        assert end, f"{page} has no place for {mark}"
        text = f"{before}{begin}{make()}\n{end}{behind}"
    return text


def main() -> int:
    """Write the pages, or say whether they are up to date."""
    stale = 0
    for page in TABLES:
        path, text = DOCS / page, written(page)
        if text == path.read_text(encoding="utf-8"):
            continue
        if sys.argv[1:] == ["--check"]:
            print(f"{path} is stale: python -m tools.reference writes it anew", file=sys.stderr)
            stale = 1
        else:
            path.write_text(text, encoding="utf-8")
    return stale


if __name__ == "__main__":
    sys.exit(main())
