"""`gcs-bridge attitude`: one attitude in every form and frame, and what common mistakes would show of it."""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import click

from gcs_bridge.errors import UsageError

__all__ = ["attitude"]

_Command = Callable[..., int]

# Each form's option and its numbers, in their order; that of an Euler form takes the sequence.
FORMS = {
    "--rpy-deg": ("ROLL", "PITCH", "YAW"),
    "--rpy-rad": ("ROLL", "PITCH", "YAW"),
    "--quaternion": ("W", "X", "Y", "Z"),
    "--quaternion-xyzw": ("X", "Y", "Z", "W"),
    "--matrix": tuple(f"R{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3)),
    "--rotvec-deg": ("X", "Y", "Z"),
    "--rotvec-rad": ("X", "Y", "Z"),
    "--axis-angle-deg": ("X", "Y", "Z", "ANGLE"),
    "--axis-angle-rad": ("X", "Y", "Z", "ANGLE"),
    "--euler-deg": ("A", "B", "C"),
    "--euler-rad": ("A", "B", "C"),
}
_MEANING = {
    "--matrix": "9 numbers, row by row: takes body axes to the world.",
    "--euler-deg": "A B C in the order of any of the 24 SEQUENCEs: ZYX intrinsic, zyx extrinsic.",
}
_SHORT = {"--rotvec-rad": "--rotvec"}
_LARGEST = 1e9  # the digits of a larger angle are gone


def _form_options(command: _Command) -> _Command:
    for option, names in reversed(FORMS.items()):
        takes: dict[str, Any] = {"metavar": "SEQUENCE"} if option.startswith("--euler") else {"is_flag": True}
        meaning = _MEANING.get(option) or " ".join(names)
        command = click.option(option, *filter(None, [_SHORT.get(option)]), help=meaning, **takes)(command)
    return command


@click.command(
    # Else a negative number is an option: what is really one is found among the values.
    context_settings={"ignore_unknown_options": True},
)
@click.argument("values", nargs=-1, metavar="VALUE...")
@_form_options
@click.option(
    "--frame",
    type=click.Choice(["ned_frd", "enu_flu", "enu_rfu"]),
    default="ned_frd",
    help="World and body that the VALUEs are given in, and the forms shown first.  [ned_frd]",
)
@click.option("--rates-deg", nargs=3, metavar="P Q R", help="Body rates, deg/s: also show how the attitude changes.")
@click.option("--accelerometer", nargs=3, metavar="X Y Z", help="Its reading, m/s²: also show what it means.")
@click.option("--format", "form", type=click.Choice(["text", "json"]), default="text", help="Of the page.  [text]")
@click.option("-v", "--verbose", is_flag=True, help="With what to do about each near-miss.")
def attitude(
    values: tuple[str, ...],
    frame: str,
    rates_deg: tuple[str, ...] | None,
    accelerometer: tuple[str, ...] | None,
    form: str,
    verbose: bool,
    **forms: Any,
) -> int:
    """Show one attitude in every form and frame, and what each common mistake would make of it.

    VALUEs are numbers with spaces or commas between them; brackets may stay: --quaternion "[0.7, 0, 0, -0.7]".
    Exactly one option says which form they are; 9 numbers alone are a matrix. The other frames are always shown too.

    \b
    Exit codes: 0 good, 2 usage: what is given is no attitude.
    """
    numbers = _numbers(values)
    option = _the_form([option for option in FORMS if forms[_name(option)]], len(numbers))
    if len(numbers) != len(FORMS[option]):
        raise UsageError(f"{_usage(option)} takes {len(FORMS[option])} numbers: {len(numbers)} given")
    rates = None if rates_deg is None else _three("--rates-deg", rates_deg)
    force = None if accelerometer is None else _three("--accelerometer", accelerometer)

    from gcs_bridge.calculator.page import attitude_page
    from gcs_bridge.calculator.parse import given  # the heavy part, after most of what may be refused
    from gcs_bridge.calculator.text import lines
    from gcs_bridge.files import write_stdout

    sequence = forms[_name(option)] if option.startswith("--euler") else None
    page = attitude_page(
        given(_name(option), numbers, frame=frame, sequence=sequence), rates_deg_s=rates, accelerometer_m_s2=force
    )
    text = (
        json.dumps(page, indent=2, ensure_ascii=False, allow_nan=False)
        if form == "json"
        else "\n".join(lines(page, fixes=verbose))
    )
    write_stdout(text + "\n")
    return 0


def _name(option: str) -> str:
    return option.removeprefix("--").replace("-", "_")


def _the_form(chosen: Sequence[str], count: int) -> str:
    """The one form that was chosen, or the only one of so many numbers."""
    if len(chosen) == 1:
        return chosen[0]
    if chosen:
        raise UsageError(f"one attitude in one form: {' and '.join(chosen)} cannot both be meant")
    fitting = [option for option, names in FORMS.items() if len(names) == count]
    if len(fitting) == 1:
        return fitting[0]
    if not count:
        raise UsageError("no attitude is given: name its form and its numbers, as --rpy-deg 10 20 30")
    if not fitting:
        raise UsageError(f"{count} numbers are no attitude: 3, 4 or 9 are, as --rpy-deg 10 20 30")
    raise UsageError(f"{count} numbers may mean several things; say which: {', '.join(map(_usage, fitting))}")


def _usage(option: str) -> str:
    return f"{option} {'SEQUENCE ' if option.startswith('--euler') else ''}{' '.join(FORMS[option])}"


def _three(option: str, texts: Iterable[str]) -> tuple[float, float, float]:
    numbers = _numbers(texts)
    if len(numbers) != 3:
        raise UsageError(f"{option} takes 3 numbers: {len(numbers)} given")
    x, y, z = numbers
    return x, y, z


# What surrounds numbers in code: array([…]), {…}, commas.
_AROUND = re.compile(r"[A-Za-z_][\w.]*\(|[][(){},;]")


def _numbers(texts: Iterable[str]) -> list[float]:
    """The numbers in what was typed; UsageError for anything else."""
    return [_number(word) for word in _AROUND.sub(" ", " ".join(texts)).split()]


def _number(word: str) -> float:
    try:
        number = float(word.replace("−", "-"))  # the minus sign of printed pages
    except ValueError:
        if word.startswith("-"):
            raise UsageError(_no_option(word)) from None
        raise UsageError(f"{word!r} is no number") from None
    if not abs(number) < _LARGEST:
        raise UsageError(f"{word} is no part of an attitude: numbers must be finite, and below {_LARGEST:g}")
    return number


def _no_option(word: str) -> str:
    known = [option for parameter in attitude.params for option in parameter.opts if option.startswith("--")]
    near = difflib.get_close_matches(word, known, n=1)
    return f"no such option: {word}" + (f"; did you mean {near[0]}?" if near else " (see 'gcs-bridge attitude --help')")
