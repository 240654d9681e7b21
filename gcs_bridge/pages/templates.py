"""The pages' templates, and what all of them use."""

from __future__ import annotations

from functools import cache
from importlib import resources

import jinja2

from gcs_bridge.errors import one_line
from gcs_bridge.report.rows import counted, in_bytes, in_seconds
from gcs_bridge.report.verdicts import LABELS

__all__ = ["asset", "template"]


def asset(name: str) -> str:
    """A file of the pages' own: style, script, template."""
    return (resources.files("gcs_bridge.pages") / "assets" / name).read_text(encoding="utf-8")


@cache
def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(asset),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "label": LABELS.__getitem__,
        "flat": one_line,
        "bytes": in_bytes,
        "seconds": in_seconds,
        "number": counted,
    }
    return environment


def template(name: str) -> jinja2.Template:
    """A page to be filled in; what is filled in is text, whatever stands in it."""
    return _environment().get_template(name)
