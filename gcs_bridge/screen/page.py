"""The whole view at any size: which parts there is room for, and where they stand."""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from gcs_bridge.judging.snapshot import Snapshot, VehicleNow
from gcs_bridge.screen.alerts import LOOKS, Alert, AlertKey, Level, id_of, who
from gcs_bridge.screen.canvas import CHOSEN, DEGREE, Canvas, Region, Role
from gcs_bridge.screen.fleet import TABLE_WIDTH, chip_rows, draw_chips, draw_table
from gcs_bridge.screen.history import History, disagreement_of
from gcs_bridge.screen.horizon import draw_heading, draw_horizon
from gcs_bridge.screen.keys import HELP, HINTS
from gcs_bridge.screen.memory import Memory
from gcs_bridge.screen.numbers import (
    CHECKS_WIDTH,
    NUMBERS_WIDTH,
    brief_attitude,
    draw_checks,
    draw_numbers,
    heading_deg,
    measured,
)
from gcs_bridge.screen.plot import draw_plot
from gcs_bridge.telemetry.identity import VehicleId

__all__ = ["Scene", "draw_page"]

_WIDE = 120  # characters, from which on all vehicles have a table beside the chosen one
_LEAST_HORIZON = 16
_GAP = 1


@dataclass(frozen=True, kw_only=True)
class Scene:
    """All that a page is drawn from."""

    title: str
    clock: str
    snapshot: Snapshot
    alerts: Sequence[Alert]  # what calls for attention most first
    chosen: VehicleId | None
    chosen_alert: AlertKey | None
    memory: Memory
    histories: Mapping[VehicleId, History]
    message: str = ""  # the answer to the last key
    rings: bool = False
    shows_help: bool = False

    @property
    def vehicle(self) -> VehicleNow | None:
        """The chosen vehicle."""
        return next((one for one in self.snapshot.vehicles if id_of(one) == self.chosen), None)


class _Part(NamedTuple):
    """A part of the page: how many rows it needs at least and can use at most, and how it is drawn."""

    least: int
    most: int
    draw: Callable[[Region, Scene], None]


def draw_page(canvas: Canvas, scene: Scene) -> None:
    """Draw everything that there is room for."""
    whole = canvas.whole
    if scene.shows_help:
        _draw_title(whole.part(0, 0, whole.width, 1), scene)
        notes = [f"Told: {line.text}" for line in scene.memory.lines if line.is_note]
        wrapped = [part for note in notes for part in textwrap.wrap(note, max(whole.width - 2, 8))]
        for y, line in enumerate((*HELP, *wrapped), 2):
            whole.put_cut(1, y, line)
        return
    several = len(scene.snapshot.vehicles) > 1
    body = whole
    if several and whole.width >= _WIDE:
        body = whole.part(0, 1, whole.width - TABLE_WIDTH - _GAP, whole.height - 2)
        table = whole.part(whole.width - TABLE_WIDTH, 1, TABLE_WIDTH, whole.height - 2)
        draw_table(table, scene.snapshot.vehicles, scene.alerts, scene.chosen, scene.memory.lost)
        _draw_title(whole.part(0, 0, whole.width, 1), scene)
        _draw_keys(whole.part(0, whole.height - 1, whole.width, 1), scene)
        _draw_parts(body, _parts(scene, body, framed=True), scene)
        return
    _draw_parts(body, _parts(scene, body, framed=False), scene)


def _parts(scene: Scene, body: Region, *, framed: bool) -> list[tuple[int, _Part]]:
    """The parts from top to bottom, each with its rank: the lower, the sooner it has its rows.

    `framed`: title and keys stand elsewhere.
    """
    chips = 0 if framed else min(chip_rows(scene.snapshot.vehicles, body.width), 4)
    alerts, about = len(scene.alerts), 6 if _about(scene) else 0
    is_small, is_large = body.height < 12 or body.width < NUMBERS_WIDTH, body.height >= 30
    attitude = _Part(1, 1, _draw_brief) if is_small else _Part(9, max(10, body.height * 2 // 5), _draw_attitude)
    plotted = _Part(4, 12 if is_large else 6, _draw_disagreement)
    parts = [
        (6, _Part(chips, chips, _draw_fleet)),
        (3, _Part(1, 1, _draw_vehicle)),
        (2, attitude),
        (5, plotted if body.height >= 16 else _Part(1, 1, _draw_disagreement)),
        (1, _Part(min(max(alerts, 1), 3), max(alerts, 1), _draw_alerts)),
        (7, _Part(2 if about and body.height >= 20 else 0, about, _draw_about)),
        (8, _Part(4 if is_large else 0, body.height, _draw_log)),
    ]
    if framed:
        return parts
    return [(0, _Part(1, 1, _draw_title)), *parts, (4, _Part(1 if body.height > 5 else 0, 1, _draw_keys))]


def _draw_parts(body: Region, ranked: Sequence[tuple[int, _Part]], scene: Scene) -> None:
    """Give each part its least rows, by rank, then all others what is left, and draw them."""
    left = body.height
    rows = [0] * len(ranked)
    order = sorted(range(len(ranked)), key=lambda place: ranked[place][0])
    for place in order:
        rows[place] = min(ranked[place][1].least, left)
        left -= rows[place]
    for place in order:
        more = min(ranked[place][1].most - rows[place], left)
        rows[place] += more
        left -= more
    y = 0
    for (_, part), height in zip(ranked, rows, strict=True):
        if height:
            part.draw(body.part(0, y, body.width, height), scene)
        y += height


def _draw_title(region: Region, scene: Scene) -> None:
    region.put(0, 0, " " * region.width, Role.TITLE)
    counts = Counter(alert.level for alert in scene.alerts if not alert.is_shelved)
    x = region.width
    if region.width >= 60:
        x -= len(scene.clock) + 1
        region.put(x, 0, scene.clock, Role.TITLE)
    for level in (Level.CAUTION, Level.WARNING):
        if counts[level]:
            look = LOOKS[level]
            is_new = any(alert.is_new for alert in scene.alerts if alert.level is level and not alert.is_shelved)
            said = f" {look.sign} {counts[level]} {look.word if region.width >= 40 else look.short} "
            x -= len(said) + 1
            region.put(x, 0, said, look.role if is_new else look.seen)
    if down := sum(not link.is_open for link in scene.snapshot.links):
        said = f" {down} LINK{'S' if down > 1 else ''} DOWN "
        x -= len(said) + 1
        region.put(x, 0, said, Role.CAUTION)
    region.part(0, 0, max(x - 1, 0), 1).put_cut(1, 0, f"gcs-bridge  {scene.title}", Role.TITLE)


def _draw_keys(region: Region, scene: Scene) -> None:
    x = region.put_cut(1, 0, scene.message or HINTS, Role.STRONG if scene.message else Role.FAINT)
    bell = f"  b bell {'on' if scene.rings else 'off'}"
    if not scene.message and x + len(bell) <= region.width:
        region.put(x, 0, bell, Role.FAINT)


def _draw_fleet(region: Region, scene: Scene) -> None:
    draw_chips(region, scene.snapshot.vehicles, scene.alerts, scene.chosen, scene.memory.lost)


def _draw_vehicle(region: Region, scene: Scene) -> None:
    vehicle = scene.vehicle
    if vehicle is None:
        region.put_cut(1, 0, _waits(scene), Role.ADVISORY)
        return
    x = region.put(1, 0, who(id_of(vehicle)), Role.STRONG)
    x = region.put(x + 1, 0, f"{vehicle.autopilot} {vehicle.type}")
    age = "" if vehicle.age_s is None else f"age {vehicle.age_s:.1f} s"
    share = vehicle.lost / max(vehicle.lost + vehicle.received, 1)
    rates = "  ".join(
        f"{short} {vehicle.streams[name].rate_hz or 0:.3g} Hz"
        for name, short in (("ATTITUDE", "Euler"), ("ATTITUDE_QUATERNION", "quat"))
        if name in vehicle.streams
    )
    said = [age, f"loss {100 * share:.2g} %", rates, "" if vehicle.boot is None else f"boot {vehicle.boot}"]
    region.put_cut(x + 2, 0, "  ".join(filter(None, said)), Role.FAINT)


def _waits(scene: Scene) -> str:
    frames = sum(link.frames for link in scene.snapshot.links)
    came = sum(link.bytes for link in scene.snapshot.links)
    if frames:
        return f"no vehicle yet: {frames} frames, none of them a vehicle's"
    return f"no vehicle yet: {came} bytes, no frame in them" if came else "waiting: nothing was received yet"


def _draw_brief(region: Region, scene: Scene) -> None:
    if scene.vehicle is not None:
        region.put_cut(0, 0, brief_attitude(scene.vehicle), Role.STRONG)


def _draw_attitude(region: Region, scene: Scene) -> None:
    """The horizon, the numbers, and where there is room the checks: beside them, else below."""
    vehicle = scene.vehicle
    if vehicle is None:
        return
    checks_beside = region.width >= NUMBERS_WIDTH + CHECKS_WIDTH + 2 * _GAP + 2 * _LEAST_HORIZON
    horizon_width = region.width - NUMBERS_WIDTH - _GAP - (CHECKS_WIDTH + _GAP if checks_beside else 0)
    x = 0
    if horizon_width >= _LEAST_HORIZON:
        _draw_world(region.part(0, 0, horizon_width, region.height), vehicle)
        x = horizon_width + _GAP
    draw_numbers(region.part(x, 0, NUMBERS_WIDTH, region.height), vehicle)
    if checks_beside:
        draw_checks(region.part(x + NUMBERS_WIDTH + _GAP, 0, CHECKS_WIDTH, region.height), vehicle)
    else:
        draw_checks(region.part(x, 9, NUMBERS_WIDTH, region.height - 9), vehicle)


def _draw_world(region: Region, vehicle: VehicleNow) -> None:
    """The horizon of the quaternion, or of the Euler angles where no quaternion comes; none where neither is alive."""
    both = vehicle.attitude_quaternion, vehicle.attitude
    usable = [one for one in both if one is not None and one.alive and one.valid]
    if not usable:
        text = " NO ATTITUDE " if not any(both) else " ATTITUDE SILENT " if _silent(vehicle) else " ATTITUDE BAD "
        region.put((region.width - len(text)) // 2, region.height // 2, text, Role.ADVISORY)
        return
    shown = usable[0]
    heading = heading_deg(shown)
    if heading is not None:
        draw_heading(region.part(0, 0, region.width, 1), heading)
    draw_horizon(region.part(0, 1, region.width, region.height - 1), shown.q_nb)


def _silent(vehicle: VehicleNow) -> bool:
    return not any(one is not None and one.alive for one in (vehicle.attitude, vehicle.attitude_quaternion))


def _draw_disagreement(region: Region, scene: Scene) -> None:
    """How far the two attitudes lie apart now, and below it over time."""
    vehicle = scene.vehicle
    if vehicle is None:
        return
    now = disagreement_of(vehicle)
    if now is None or now.value is None or now.limit is None:
        region.put_cut(0, 0, "apart: not compared yet", Role.ADVISORY)
    else:
        is_above = now.value > now.limit
        precise = f"apart {now.value:.3f}{DEGREE} of limit {now.limit:.3f}{DEGREE}"
        x = region.put(0, 0, precise if region.width >= 40 else measured(now), Role.STRONG)
        x = region.put(x + 1, 0, "ABOVE" if is_above else "within", Role.WARNING_SEEN if is_above else Role.GOOD)
        span = "  one bar a second, the latest at the right" if region.height > 1 else ""
        region.put_cut(x, 0, span, Role.FAINT)
    history = scene.histories.get(id_of(vehicle))
    if history is not None:
        draw_plot(region.part(0, 1, region.width, region.height - 1), history.last(region.width))


def _draw_alerts(region: Region, scene: Scene) -> None:
    """What calls for attention, of every vehicle; what is chosen is always among it."""
    if not scene.alerts:
        if scene.snapshot.vehicles:
            region.put_cut(0, 0, "no alarm, of no vehicle", Role.GOOD)
        return
    places = [alert.key for alert in scene.alerts]
    chosen = places.index(scene.chosen_alert) if scene.chosen_alert in places else 0
    first = max(chosen - region.height + 1, 0)
    for y, alert in enumerate(scene.alerts[first : first + region.height]):
        _draw_alert(region.part(0, y, region.width, 1), alert, is_chosen=alert.key == scene.chosen_alert)
    if (more := len(scene.alerts) - first - region.height) > 0:
        region.put_right(region.width, region.height - 1, f" {more} more", Role.FAINT)


def _draw_alert(region: Region, alert: Alert, *, is_chosen: bool) -> None:
    look = LOOKS[alert.level]
    if is_chosen:
        region.put(0, 0, CHOSEN, Role.STRONG)
    x = region.put(1, 0, f"{look.sign} {look.word:<8}", alert.role)
    x = region.put(x + 1, 0, f"{who(alert.key.vehicle):<5}", Role.STRONG if is_chosen else Role.PLAIN)
    x = region.put(x + 1, 0, alert.text, Role.STRONG if is_chosen else Role.PLAIN)
    if alert.alarm is not None:
        x = region.put(x + 2, 0, measured(alert.alarm))
    room = region.width - x - 2
    if alert.state:
        role = Role.STRONG if alert.is_new and not alert.is_shelved else Role.FAINT
        region.put(max(x + 2, region.width - max(len(alert.state), 17)), 0, alert.state[: max(room, 0)], role)


def _about(scene: Scene) -> list[str]:
    """What the chosen alarm says, and what to do about it."""
    alert = next((one for one in scene.alerts if one.key == scene.chosen_alert), None)
    return [] if alert is None or alert.alarm is None else scene.memory.about(alert.alarm.id)


def _draw_about(region: Region, scene: Scene) -> None:
    lines = [line for text in _about(scene) for line in textwrap.wrap(text, max(region.width - 4, 8))]
    for y, line in enumerate(lines[: region.height]):
        region.put_cut(3, y, line)


def _draw_log(region: Region, scene: Scene) -> None:
    """What was told of late, the latest at the bottom."""
    latest = list(scene.memory.lines)[-region.height :]
    for y, line in enumerate(latest, region.height - len(latest)):
        role = Role.STRONG if line.is_alarm else Role.ADVISORY if line.is_note else Role.FAINT
        region.put_cut(1, y, line.text, role)
