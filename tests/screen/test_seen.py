"""The view in a real terminal, tmux: what is on the screen is what was sent, and what was typed happens.

The captures in tests/data/screen are such screens of vehicles that sway, kept to be looked at; what holds for every
screen is asked of them too.
"""

import contextlib
import re
import socket
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.helpers import wire
from tests.helpers.live_links import free_port
from tests.helpers.paths import ROOT
from tests.helpers.tmux import GCS_BRIDGE, Tmux, has_tmux

KEPT = ROOT / "tests" / "data" / "screen"
GROUND = {"░": 1.0, **{sign: (place + 1) / 8 for place, sign in enumerate("▁▂▃▄▅▆▇█")}}  # how much of a place is it
NUMBER = r"([+-]\d+\.\d+)"
Row = tuple[float, ...]


class Seen(NamedTuple):
    """What a screen says of the chosen vehicle: of both messages angles, deg, and quaternions; the horizon's slope."""

    rpy: list[Row]
    wxyz: list[Row]
    rates: list[Row]
    slope: float  # rows of ground more, from one column to the next

    @classmethod
    def of(cls, screen: str) -> "Seen":
        lines = screen.splitlines()
        head = next(row for row, line in enumerate(lines) if "degrees" in line)
        foot = next(row for row, line in enumerate(lines) if line.startswith("apart"))
        left = lines[head].index("degrees")  # of the numbers; what lies before them is the horizon
        numbers = [tuple(map(float, re.findall(NUMBER, line[left : left + 44]))) for line in lines[head : head + 9]]
        columns = [*range(left // 2 - 6), *range(left // 2 + 6, left - 1)]  # beside craft and marks
        horizon = [line.ljust(left) for line in lines[head + 1 : foot]]
        ground = [sum(GROUND.get(line[column], 0.0) for line in horizon) for column in columns]
        return cls(numbers[1:3], numbers[4:6], numbers[7:9], float(np.polyfit(columns, ground, 1)[0]))

    def check(self) -> None:
        """Both forms say one thing each, and the horizon falls to the left where the right wing is down."""
        for rpy, q in zip(self.rpy, self.wxyz, strict=True):
            turned = Rotation.from_euler("ZYX", rpy[::-1], degrees=True)
            shown = Rotation.from_quat(np.roll(q, -1))
            assert np.degrees((turned.inv() * shown).magnitude()) < 0.03  # as many digits are shown
        roll = self.rpy[1][0]
        if 3 < abs(roll) < 60:
            assert np.sign(self.slope) == np.sign(roll)


class Fleet:
    """Vehicles as good as still, each with its own attitude; of those in `faulty` the quaternion is turned."""

    def __init__(self, attitudes: Sequence[tuple[float, float, float]]) -> None:
        self.port = free_port()
        self.faulty: set[int] = set()
        self._rotations = [Rotation.from_euler("ZYX", rpy[::-1], degrees=True) for rpy in attitudes]
        self._ends = threading.Event()

    def _messages(self, sysid: int, ms: int) -> Iterator[bytes]:
        # Not for ever the very same numbers, which would be a frozen stream.
        rotation = self._rotations[sysid - 1] * Rotation.from_euler("X", 0.001 * (ms // 100 % 2), degrees=True)
        if ms % 1000 == 0:
            yield wire.heartbeat(sysid=sysid)
        yield wire.attitude(ms, rotation.as_euler("ZYX")[::-1], sysid=sysid)
        if sysid in self.faulty:
            rotation = Rotation.from_euler("Z", 25, degrees=True) * rotation
        yield wire.attitude_quaternion(ms, wire.wxyz(rotation), sysid=sysid)

    def _send(self) -> None:
        began_s = time.monotonic()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for ms in range(10_000, 10_000_000, 100):
                if self._ends.wait(max(began_s + (ms - 10_000) / 1000 - time.monotonic(), 0)):
                    return
                for sysid in range(1, len(self._rotations) + 1):
                    for frame in self._messages(sysid, ms):
                        with contextlib.suppress(ConnectionError):
                            sender.sendto(frame, ("127.0.0.1", self.port))

    @contextlib.contextmanager
    def flying(self) -> Iterator["Fleet"]:
        thread = threading.Thread(target=self._send, daemon=True)
        thread.start()
        try:
            yield self
        finally:
            self._ends.set()
            thread.join()

    def listen(self, options: str = "") -> str:
        return f"{GCS_BRIDGE} listen udpin:127.0.0.1:{self.port} --viewer none {options}"


@pytest.mark.parametrize("path", sorted(KEPT.glob("*.txt")), ids=lambda path: path.stem)
def test_kept_captures(path: Path) -> None:
    """Their numbers are one rotation each, and the horizon lies as they say; no row is too long."""
    width, height = map(int, path.stem.split("_")[0].split("x"))
    lines = path.read_text(encoding="utf-8").splitlines()
    assert len(lines) <= height
    assert max(map(len, lines)) <= width
    if width >= 80:
        Seen.of("\n".join(lines)).check()


@has_tmux
@pytest.mark.slow
def test_one_vehicle_at_80_by_24(tmp_path: Path) -> None:
    """What was sent is shown; an alarm is raised, acknowledged, shelved; resized, stopped, gone on with, and ended."""
    fleet = Fleet([(30.0, -5.0, 100.0)])
    with Tmux() as terminal, fleet.flying():
        terminal.type(f"stty -a > {tmp_path}/before; clear")
        terminal.type(fleet.listen("--bell"))
        seen = Seen.of(terminal.wait_for("no alarm, of no vehicle", "apart 0.000°", "within"))
        assert seen.rpy == [(30.0, -5.0, 100.0)] * 2
        expected = wire.wxyz(Rotation.from_euler("ZYX", [100, -5, 30], degrees=True)).round(4)
        assert seen.wxyz == [tuple(expected.tolist())] * 2
        assert seen.rates == [(0.0, 0.0, 0.0)] * 2
        seen.check()
        assert seen.slope == pytest.approx(0.5 * np.tan(np.radians(30)), rel=0.2)  # a column is half a row wide

        fleet.faulty.add(1)
        raised = terminal.wait_for("▲ WARNING  1,1", "NOT ACK'D", "ABOVE", "since ")
        assert "apart 25.000°" in raised
        assert "25.00/0.5" in raised
        assert Seen.of(raised).rpy == [(30.0, -5.0, 100.0), (30.0, -5.0, 125.0)]
        assert "█" in raised
        terminal.press("a")
        assert "NOT ACK'D" not in terminal.wait_for("acknowledged: 1.1-euler_quaternion-0-1", "  acknowledged")
        terminal.press("s")
        assert "1 WARNING" not in terminal.wait_for("shelved to ")
        terminal.press("u")
        terminal.wait_for("▲ 1 WARNING", "  acknowledged")
        terminal.press("?")
        terminal.wait_for("the terminal's bell on or off")
        terminal.press("?")

        terminal.resize(20, 5)
        terminal.wait_for("R+30.0 P-5.0 Y+125.0"[:20], "WARN")
        terminal.resize(200, 60)
        terminal.wait_for("secondary_estimate", "ALARM euler_quaternion", "yaw_offset")
        terminal.resize(80, 24)
        terminal.wait_for("apart 25.000°")

        terminal.press("C-z")
        terminal.wait_for("Stopped")
        assert "apart" not in terminal.shown()
        terminal.type("fg")
        terminal.wait_for("apart 25.000°", "▲ 1 WARNING")
        terminal.press("C-c")
        assert "apart" not in terminal.wait_for("1 alarm: euler_quaternion at ")
        terminal.type(f"ended=$?; stty -a > {tmp_path}/after; echo code $ended")  # what is waited for comes last
        terminal.wait_for("code 0")
    assert (tmp_path / "after").read_text() == (tmp_path / "before").read_text()


@has_tmux
@pytest.mark.slow
@pytest.mark.sweep
def test_sixteen_vehicles() -> None:
    """Each has its chip, and its row where there is room; keys go to the next one; no colour where none is wanted."""
    attitudes = [(float(-20 + sysid), 2.0, float(10 * sysid)) for sysid in range(1, 17)]
    fleet = Fleet(attitudes)
    with Tmux(NO_COLOR="1") as terminal, fleet.flying():
        terminal.type(fleet.listen())
        first = terminal.wait_for("16,1 ok", "no alarm, of no vehicle")
        assert all(f"{sysid},1 ok" in first for sysid in range(1, 17))
        terminal.press("Right", "Right")
        third = Seen.of(terminal.wait_for("›3,1", "-17.00"))
        assert third.rpy == [(-17.0, 2.0, 30.0)] * 2
        third.check()
        terminal.press("Left", "h", "h")  # round the end
        Seen.of(terminal.wait_for("›16,1", "+160.00")).check()
        fleet.faulty.add(9)
        terminal.wait_for("9,1 WARN", "▲ WARNING  9,1")
        codes = set(re.findall(r"\x1b\[([0-9;]*)m", terminal.shown(codes=True)))
        assert {part for code in codes for part in code.split(";")} <= {"", "0", "1", "2", "7", "39", "49"}  # as it was
        terminal.press("Down")  # the chosen alarm's vehicle is shown
        terminal.wait_for("›9,1 WARN", "-11.00")
        terminal.resize(200, 60)
        table = terminal.wait_for("16 vehicles", "R-4.0 P+2.0 Y+160.0")
        for sysid, (roll, pitch, yaw) in enumerate(attitudes, 1):
            shown_yaw = yaw + 25 if sysid == 9 else yaw
            assert f"R{roll:+.1f} P{pitch:+.1f} Y{shown_yaw:+.1f}" in table
        terminal.press("q")
        terminal.wait_for("16 vehicles, 1 alarm")


@has_tmux
@pytest.mark.slow
def test_plain_lines() -> None:
    """With --plain a terminal gets lines."""
    fleet = Fleet([(0.0, 0.0, 0.0)])
    with Tmux(120, 24) as terminal, fleet.flying():
        terminal.type(fleet.listen("--plain --duration 3"))
        shown = terminal.wait_for("vehicle seen", "ATTITUDE started", "1 vehicle, no alarm")
        assert "←→" not in shown
