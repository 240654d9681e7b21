"""`gcs-bridge doctor` in this process: what it told, and what it ended with."""

import contextlib
import io
import json
from pathlib import Path
from typing import Any, NamedTuple

from gcs_bridge.cli import main

Json = dict[str, Any]


class Examined(NamedTuple):
    code: int
    told: Json

    @property
    def codes(self) -> list[str]:
        return [one["code"] for one in self.told["advice"]]

    def advice(self, code: str) -> Json:
        """The one advice of that code."""
        (one,) = [one for one in self.told["advice"] if one["code"] == code]
        return dict(one)

    def vehicle(self, sysid: int = 1) -> Json:
        (one,) = [one for one in self.told["vehicles"] if one["sysid"] == sysid]
        return dict(one)


def said(*arguments: str | Path) -> tuple[int, str, str]:
    """Exit code, standard output and standard error."""
    out, err = io.BytesIO(), io.StringIO()
    wrapped = io.TextIOWrapper(out, encoding="utf-8", write_through=True)
    with contextlib.redirect_stdout(wrapped), contextlib.redirect_stderr(err):
        code = main(["doctor", *map(str, arguments)])
    return code, out.getvalue().decode(), err.getvalue()


def examined(*arguments: str | Path) -> Examined:
    """By its JSON."""
    code, out, _ = said(*arguments, "--format", "json")
    return Examined(code, json.loads(out))
