"""The page of one attitude for reading: plain columns, at most 100 wide, from the page's dict and nothing else."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from gcs_bridge.calculator.frames import FRAMES, Frame

__all__ = ["lines"]
_Page = Mapping[str, Any]
_WIDTH = 100
_LABEL = 26
_COLUMN = 14
_DIGITS = {"deg": 6, "deg/s": 6, "m/s²": 6}  # of other numbers: 9


def lines(page: _Page, *, fixes: bool = False) -> Iterator[str]:
    """The page's lines; with `fixes`, what to do about each common mistake."""
    given = FRAMES[page["input"]["frame"]]
    yield from _summary(page)
    yield ""
    yield from _forms(page, given, whole=True)
    for frame in FRAMES.values():
        if frame is not given:
            yield ""
            yield from _forms(page, frame, whole=False)
    yield ""
    yield from _euler(page, given)
    if page["rates"] is not None:
        yield ""
        yield from _turning(page["rates"], given)
    if page["accelerometer"] is not None:
        yield ""
        yield from _pushed(page["accelerometer"], given)
    yield ""
    yield from _near_misses(page["near_misses"], fixes=fixes)


def _summary(page: _Page) -> Iterator[str]:
    given = page["input"]
    option = "--" + given["form"].replace("_", "-")
    numbers = " ".join(f"{value:.12g}" for value in given["values"])
    yield _told("given", " ".join(filter(None, (option, given["sequence"], numbers, "--frame", given["frame"]))))
    for note in given["notes"]:
        yield _told("note", note)
    for part, where in page["pointing"].items():
        yield _told(part.replace("_", " "), where)
    heading_deg = round(page["heading_deg"], 1) % 360.0
    yield _told("heading, tilt", f"{heading_deg:.1f}° clockwise from north, {page['tilt_deg']:.1f}° from level")
    thrust = page["hover_thrust_n_per_kg"]
    said = (
        "impossible: the rotors push sideways"
        if thrust is None
        else f"{thrust:.2f} N per kg, m g / cos tilt"
        if thrust > 0.0
        else "impossible: upside down, the rotors push towards the ground"
    )
    yield _told("thrust to hover", said)


def _told(label: str, said: str) -> str:
    return f"{label:<{_LABEL}}{said}"


def _forms(page: _Page, frame: Frame, *, whole: bool) -> Iterator[str]:
    """The attitude in one frame convention, or the forms of it that are met most."""
    forms = page["frames"][frame.name]
    name = frame.name
    yield f"{name}: body {', '.join(frame.body_axes)} in the world {', '.join(frame.world_axes)}"
    yield f"  {frame.rpy_means}"
    yield _row("quaternion w x y z", forms[f"q_{name}_wxyz"])
    if whole:
        yield _row("  the same, negated", forms[f"q_{name}_wxyz_negated"])
    yield _row("quaternion x y z w", forms[f"q_{name}_xyzw"])
    yield _row("roll, pitch, yaw, deg", forms[f"rpy_{name}_deg"])
    if whole:
        yield _row("  rad", forms[f"rpy_{name}_rad"])
    if forms[f"rpy_{name}_near_gimbal_lock"]:
        yield _told("  GIMBAL LOCK", _locked(*forms[f"rpy_{name}_deg"]))
    if whole:
        yield _row("rotation vector, deg", forms[f"rotvec_{name}_deg"])
        yield _row("  rad", forms[f"rotvec_{name}_rad"])
        yield _row("axis", forms[f"axis_{name}"])
        yield _row("  angle, deg", [forms[f"angle_{name}_deg"]])
    yield _told(
        f"matrix: v_{frame.world} = R v_{frame.body}", "".join(f"{axis:>{_COLUMN}}" for axis in frame.body_axes)
    )
    for axis, line in zip(frame.world_axes, forms[f"R_{name}"], strict=True):
        yield _row(f"  {axis}", line)
    if whole:
        factors = forms[f"R_{name}_factors"]
        yield f"  R = {' '.join(factors)}"
        for three in zip(*factors.values(), strict=True):
            yield "".join("    " + "".join(_fixed(number, 4, 9) for number in line) for line in three)
    yield _row(f"down in {frame.body}", forms[f"down_{frame.body}"])
    yield _row("accelerometer, rest, m/s²", forms[f"accelerometer_at_rest_{frame.body}_m_s2"])


def _locked(roll_deg: float, pitch_deg: float, yaw_deg: float) -> str:
    """What is left of the angles at a pole (M5)."""
    sign, left = ("-", yaw_deg - roll_deg) if pitch_deg > 0 else ("+", yaw_deg + roll_deg)
    return f"pitch is at ±90 deg: of the other two only yaw {sign} roll = {left:.4f} deg means anything"


def _euler(page: _Page, frame: Frame) -> Iterator[str]:
    """All 24 sequences, an extrinsic one beside its intrinsic one."""
    angles: Mapping[str, Sequence[float]] = page["frames"][frame.name][f"euler_{frame.name}_deg"]
    locked = page["frames"][frame.name][f"euler_{frame.name}_near_gimbal_lock"]

    def cell(sequence: str) -> str:
        mark = "*" if sequence in locked else " "
        return f"  {sequence}{mark}" + "".join(_fixed(angle, 6, 13) for angle in angles[sequence])

    yield f"Euler angles, deg, {frame.name}: intrinsic (upper case), and extrinsic (lower case) of the same axes"
    for sequence in filter(str.isupper, angles):
        yield cell(sequence) + "  " + cell(sequence.lower())
    if locked:
        yield "  * near its gimbal lock: only the sum or the difference of the outer angles means anything"


def _turning(rates: _Page, frame: Frame) -> Iterator[str]:
    name = frame.name
    yield f"turning, {name}"
    yield _row(f"rates in {frame.body}, deg/s", rates[f"w_{frame.body}_deg_s"])
    yield _row(f"  in {frame.world}, deg/s", rates[f"w_{frame.world}_deg_s"])
    yield _row("roll pitch yaw rate, deg/s", rates[f"rpy_rate_{name}_deg_s"])
    yield _row("quaternion rate, 1/s", rates[f"q_rate_{name}_wxyz_per_s"])
    yield _row("after 1 s: w x y z", rates[f"q_after_1_s_{name}_wxyz"])
    yield _row("  roll, pitch, yaw, deg", rates[f"rpy_after_1_s_{name}_deg"])


def _pushed(force: _Page, frame: Frame) -> Iterator[str]:
    yield "accelerometer"
    yield _row(f"reading in {frame.body}, m/s²", force[f"f_{frame.body}_m_s2"])
    yield _row(f"acceleration in {frame.world}, m/s²", force[f"a_{frame.world}_m_s2"])
    yield _row("  ahead, right, down, m/s²", force["a_level_forward_right_down_m_s2"])
    yield _row("at rest, tilt wrong by, deg", [force["tilt_error_if_at_rest_deg"]])


def _near_misses(rows: Sequence[_Page], *, fixes: bool) -> Iterator[str]:
    yield "near-misses: what a common mistake would show instead (ned_frd, deg), and how far that is off"
    heads = ("roll", "pitch", "yaw", "angle", "tilt", "heading")
    yield f"  {'mistake':<28}" + "".join(f"{head:>{11 if i < 3 else 10}}" for i, head in enumerate(heads))
    for row in rows:
        name = row["cause"] + (", reversed" if row["reverse"] else "")
        off = "   cannot be told at this attitude"
        if row["distinguishable"]:
            off = "".join(_fixed(row[key], 2, 10) for key in ("angle_deg", "tilt_deg", "heading_deg"))
        yield f"  {name:<28}" + "".join(_fixed(angle, 3, 11) for angle in row["rpy_ned_frd_deg"]) + off
        if fixes and not row["reverse"]:
            yield from textwrap.wrap(row["fix"], _WIDTH, initial_indent="    ", subsequent_indent="    ")
    yield "  reversed: right numbers, taken for those of that mistake"


def _row(label: str, numbers: Sequence[float | None] | None) -> str:
    digits = _DIGITS.get(label.rpartition(", ")[2], 9)
    if numbers is None:
        return _told(label, f"{'undefined':>{_COLUMN}}")
    return _told(label, "".join(_fixed(number, digits, _COLUMN) for number in numbers))


def _fixed(number: float | None, digits: int, width: int) -> str:
    if number is None:
        return f"{'undefined':>{width}}"
    return f"{round(number, digits) + 0.0:{width}.{digits}f}"  # + 0.0: no negative zero
