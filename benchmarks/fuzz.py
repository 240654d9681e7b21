"""Hostile input to a `Monitor`: noise, and real frames falsified with right checksums, from a seed.

    python -m benchmarks.fuzz --minutes 60

Each round has a seed of its own, which names what was found: two Monitors hear the same flight of a real autopilot, and
one of them all the rest beside it,

- of *strangers*: what other systems send on the same link. The true vehicle must be judged as without them;
- *forged*: the same under the vehicle's own address, with receive times that jump. It may be judged as it will be.

Nothing may raise, no feed may take long, memory may not grow. `tests/judging/test_hostile.py` runs a fixed number.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import resource
import struct
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import all as mavlink
from pymavlink.generator.mavcrc import x25crc

from gcs_bridge import Monitor
from gcs_bridge.mavlink.scanner import RawFrame
from tests.helpers.live_links import fixture, judgement

VEHICLE = (1, 1)
_FLIGHTS = ("a_copter_square", "d_plane_pitchtrim3", "p_px4_quad_square", "g_signed", "g_mavlink1", "k4_quadplane")
_SPECIAL_FLOATS = (math.nan, math.inf, -math.inf, 0.0, -0.0, 1e38, -1e38, 1e-45, 3.15, 572.9, 1.0)
_SPECIAL_BYTES = (b"\0", b"\xff", b"\x7f", b"\x80", b"\xfd", b"\xfe", b"\0\0\xc0\x7f", b"\0\0\x80\x7f", b"\0\0\x80\xff")
_TIMES_MS = (0, 1, 2**31 - 1, 2**31, 2**32 - 1, 2**32 - 2)
_TIMES_US = (0, 1, 2**31, 2**32, 10**15, 1_700_000_000_000_000, 2**53, 2**63 - 1, 2**63, 2**64 - 1)
_PARAMETERS = (
    "AHRS_TRIM_X",
    "AHRS_TRIM_Y",
    "PTCH_TRIM_DEG",
    "TRIM_PITCH_CD",
    "FLIGHT_OPTIONS",
    "Q_ENABLE",
    "SENS_BOARD_Y_OFF",
)
_TEXTS = (
    b"\x1b[2J\x1b]0;x\x07",
    b"\r\n\0\x9b31m",
    b"EKF3 lane switch 1",
    b"EKF2 IMU0 yaw aligned",
    b"\xff\xfe" * 25,
    b"%s%n{}",
)
_RECEIVE_JUMPS_US = (0, 1, -1, 10**6, -(10**6), 3600 * 10**6, -3600 * 10**6, 10**12, -(10**12))
_STRANGERS = 24  # systems; how many there may be is another matter (a forged address is cheap)
SLOW_S = 2.0  # on a processor: a feed that takes longer holds up a live link


class Hostile:
    """Makes datagrams, one after the other, from a seed."""

    def __init__(self, seed: int, *, system: int | None) -> None:
        """As `system`; None: as any other than the true vehicle's."""
        self._dice = random.Random(seed)
        self._system = system
        self._real = [frame.data for name in _FLIGHTS for frame in fixture(name, to_s=20)]
        self._ids = [*mavlink.mavlink_map]
        self._used = [0, 2, 22, 26, 27, 30, 31, 32, 65, 105, 116, 129, 163, 178, 193, 230, 245, 253, 331]
        self._makers: tuple[tuple[int, Callable[[], bytes]], ...] = (
            (6, self._noise),
            (1, self._huge),
            (8, self._damaged),
            (40, self._mutated),
            (20, self._telling),
            (5, self._several),
        )

    def datagram(self) -> bytes:
        """The next one, whatever it is."""
        weights, makers = zip(*self._makers, strict=True)
        made: bytes = self._dice.choices(makers, weights)[0]()
        return made

    def _noise(self) -> bytes:
        dice = self._dice
        begin = dice.choice((b"", b"\xfd", b"\xfe", b"\xfd\xff", b"\xfe\xff", b"\xfd\0\0\0"))
        return begin + dice.randbytes(dice.choice((0, 1, 7, 8, 11, 12, 40, 280, 600)))

    def _huge(self) -> bytes:
        dice = self._dice
        kind = dice.randrange(4)
        if kind == 0:
            return dice.randbytes(65_507)
        if kind == 1:
            return dice.choice((b"\xfd", b"\xfe", b"\0")) * 65_507
        frames = b"".join(dice.choices([self._mutated() for _ in range(40)], k=1500))
        return frames[:65_507] if kind == 2 else (frames[: dice.randrange(20)] + frames)[:65_507]

    def _several(self) -> bytes:
        return b"".join(
            dice() for dice in self._dice.choices((self._noise, self._damaged, self._mutated, self._telling), k=6)
        )

    def _damaged(self) -> bytes:
        """A frame with some wrong bits, cut short, or with something behind it; its checksum is what it was."""
        dice, frame = self._dice, bytearray(self._mutated())
        for _ in range(dice.randrange(1, 4)):
            frame[dice.randrange(len(frame))] ^= 1 << dice.randrange(8)
        return bytes(frame[: dice.choice((len(frame), dice.randrange(len(frame))))]) + dice.randbytes(
            dice.choice((0, 0, 5))
        )

    def _mutated(self) -> bytes:
        """A real frame of another payload, length, or even message, and a right checksum."""
        dice = self._dice
        frame = dice.choice(self._real)
        msgid, opened = _opened(frame)
        payload = bytearray(opened)
        for _ in range(dice.choice((0, 1, 1, 2, 5))):
            what = dice.choice((*_SPECIAL_BYTES, dice.randbytes(dice.choice((1, 2, 4, 8)))))
            at = dice.randrange(len(payload) + 1)
            if dice.random() < 0.8:
                at -= at % min(4, len(what))
            payload[at : at + len(what)] = what
        if dice.random() < 0.1:
            msgid = dice.choice((*self._used, dice.choice(self._ids), dice.randrange(2**24)))
        if dice.random() < 0.1:
            payload = payload[: dice.randrange(len(payload) + 1)] + bytes(dice.choice((0, 0, 30)))
        return self._packed(msgid, bytes(payload[:255]))

    def _telling(self) -> bytes:
        """A message that is used, with the worst that its fields can hold."""
        dice = self._dice
        message = mavlink.mavlink_map[dice.choice(self._used)]
        values = []
        for kind, length in zip(_types(message), message.array_lengths, strict=True):
            values += (
                [self._value(kind) for _ in range(max(length, 1))] if kind != "char" else [self._text(message, length)]
            )
        return self._packed(message.id, message.unpacker.pack(*values))

    def _value(self, kind: str) -> Any:
        dice = self._dice
        if kind in ("float", "double"):
            value = dice.choice((*_SPECIAL_FLOATS, dice.gauss(0, 1), dice.gauss(0, 1e4)))
            return value if kind == "double" else struct.unpack("<f", struct.pack("<f", value))[0]
        bits = int(kind.split("int")[1].partition("_")[0])
        low, high = (0, 2**bits - 1) if kind.startswith("u") else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
        told = {32: _TIMES_MS, 64: _TIMES_US}.get(bits, (0, 1, 3, 12, 50))
        return min(max(dice.choice((low, high, dice.randint(low, high), *told)), low), high)

    def _text(self, message: Any, length: int) -> bytes:
        if message.msgname == "PARAM_VALUE":
            return self._dice.choice((*(name.encode() for name in _PARAMETERS), self._dice.randbytes(16)))[:length]
        return self._dice.choice((*_TEXTS, self._dice.randbytes(length)))[:length]

    def _packed(self, msgid: int, payload: bytes) -> bytes:
        dice = self._dice
        system = self._system if self._system is not None else dice.randrange(2, 2 + _STRANGERS)
        component = VEHICLE[1] if self._system is not None else dice.choice((1, 1, 1, 0, 191, 255))
        if msgid < 256 and dice.random() < 0.2:
            head = bytes((len(payload), dice.randrange(256), system, component, msgid))
            return b"\xfe" + head + payload + _checksum(head + payload, msgid)
        payload = payload.rstrip(b"\0") or payload[:1] if dice.random() < 0.9 else payload
        signed = dice.random() < 0.05
        head = bytes((len(payload), signed, 0, dice.randrange(256), system, component)) + msgid.to_bytes(3, "little")
        return b"\xfd" + head + payload + _checksum(head + payload, msgid) + dice.randbytes(13 * signed)


def _opened(frame: bytes) -> tuple[int, bytes]:
    if frame[0] == 0xFE:
        return frame[5], frame[6 : 6 + frame[1]]
    return int.from_bytes(frame[7:10], "little"), frame[10 : 10 + frame[1]]


def _checksum(data: bytes, msgid: int) -> bytes:
    message = mavlink.mavlink_map.get(msgid)
    extra = bytes((message.crc_extra,)) if message is not None else b"\0"
    checksum: bytes = struct.pack("<H", x25crc(data + extra).crc)
    return checksum


def _types(message: Any) -> list[str]:
    by_name = dict(zip(message.fieldnames, message.fieldtypes, strict=True))
    return [by_name[name] for name in message.ordered_fieldnames]


@dataclass
class Round:
    """What one round came to."""

    seed: int
    cases: int = 0
    slowest_s: float = 0.0
    judged: list[dict[str, Any]] = field(default_factory=list)
    wanted: list[dict[str, Any]] = field(default_factory=list)

    @property
    def as_before(self) -> bool:
        """Whether the true vehicle was judged as without all the rest."""
        return self.judged == self.wanted


def strangers(seed: int, cases: int, flight: Sequence[RawFrame]) -> Round:
    """Others send on the vehicle's link: `cases` datagrams, between those of its flight."""
    hostile, dice = Hostile(seed, system=None), random.Random(seed)
    done = Round(seed)
    alone, beside = Monitor(), Monitor()
    for monitor in (alone, beside):
        monitor.open_link(0, datagrams=True)
    each = cases / len(flight)
    for frame in flight:
        alone.feed(frame.data, frame.t_rx_us)
        _feed(beside, frame.data, frame.t_rx_us, done)
        for _ in range(int(each) + (dice.random() < each % 1)):
            _feed(beside, hostile.datagram(), frame.t_rx_us, done)
            done.cases += 1
    done.wanted, done.judged = (_of_vehicle(monitor) for monitor in (alone, beside))
    return done


def forged(seed: int, cases: int, flight: Sequence[RawFrame]) -> Round:
    """The vehicle's own address, as datagrams, as a stream and as a recording; and receive times that jump."""
    hostile, dice = Hostile(seed, system=VEHICLE[0]), random.Random(seed)
    done = Round(seed)
    monitor = Monitor(on_frames=lambda _link, _frames: None)
    monitor.open_link(0, datagrams=True)
    monitor.open_link(1)
    t_rx_us = flight[0].t_rx_us
    for case in range(cases):
        t_rx_us = max(t_rx_us + dice.choice((*(20_000,) * 200, *_RECEIVE_JUMPS_US)), -1)
        link = dice.randrange(2)
        data = flight[case % len(flight)].data if dice.random() < 0.3 else hostile.datagram()
        if dice.random() < 0.02:
            monitor.feed_recording(max(t_rx_us, 0).to_bytes(8, "big") + data)
        elif link and dice.random() < 0.2:
            for piece in (data[: len(data) // 3], data[len(data) // 3 :]):
                _feed(monitor, piece, t_rx_us, done, link)
        else:
            _feed(monitor, data, t_rx_us, done, link)
        if dice.random() < 0.01:
            monitor.advance(t_rx_us)
        if dice.random() < 0.002:
            json.dumps(monitor.snapshot().to_dict(), allow_nan=False)
        done.cases += 1
    json.dumps(monitor.close().to_dict(), allow_nan=False)
    return done


def _feed(monitor: Monitor, data: bytes, t_rx_us: int, done: Round, link: int = 0) -> None:
    began_s = time.thread_time()
    events = monitor.feed(data, t_rx_us, link)
    done.slowest_s = max(done.slowest_s, time.thread_time() - began_s)
    if events:
        json.dumps(events, allow_nan=False)


def _of_vehicle(monitor: Monitor) -> list[dict[str, Any]]:
    return [one for one in judgement(monitor.close().files[0]) if one["key"] == VEHICLE]


def flights() -> list[tuple[RawFrame, ...]]:
    """What the true vehicle flies: healthy, and with a fault, each of some seconds."""
    return [
        fixture("a_copter_square", from_s=70, to_s=80),
        fixture("a_copter_square", from_s=75, to_s=84, fault="yaw_offset:25"),
        fixture("p_px4_quad_square", to_s=10),
        fixture("d_plane_pitchtrim3", to_s=12),
    ]


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fuzz", description="Hostile input to a Monitor.")
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument("--cases", type=int, default=4000, help="a round  [4000]")
    parser.add_argument("--seed", type=int, default=0, help="of the first round  [0]")
    asked = parser.parse_args()
    ends_s = time.monotonic() + 60 * asked.minutes
    told_s = time.monotonic()
    found, cases, slowest_s, seed = 0, 0, 0.0, asked.seed
    of = flights()
    while time.monotonic() < ends_s:
        for run in (strangers, forged):
            try:
                done = run(seed, asked.cases, of[seed % len(of)])
            except Exception as error:  # noqa: BLE001  # whatever it is, it is what is looked for
                found += 1
                print(f"seed {seed}, {run.__name__}: {type(error).__name__}: {error}", flush=True)
                continue
            cases += done.cases
            slowest_s = max(slowest_s, done.slowest_s)
            if not done.as_before:
                found += 1
                print(f"seed {seed}, {run.__name__}: the true vehicle was judged otherwise", flush=True)
            if done.slowest_s > SLOW_S:
                found += 1
                print(f"seed {seed}, {run.__name__}: a feed took {done.slowest_s:.1f} s", flush=True)
        seed += 1
        if time.monotonic() - told_s > 60 or seed == asked.seed + 1:
            told_s = time.monotonic()
            peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
            print(f"{cases:,} cases, slowest feed {1000 * slowest_s:.0f} ms, peak {peak_mb:.0f} MB", flush=True)
    print(f"{cases:,} cases in {asked.minutes:g} min, seeds {asked.seed} to {seed - 1}: {found} found")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
