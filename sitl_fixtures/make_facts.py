"""Write what each recording must show, as `<name>.facts.json` beside it.

The facts come from an independent oracle and never from the code under test: pymavlink's reader and parser (dialect
`all`) decide which frames are there, SciPy's Rotation and Slerp decide how far two attitudes are apart. What only
people can know (where a recording comes from, which judgement is right) is read from `provenance.toml`.

    python make_facts.py                       # all recordings of this folder
    python make_facts.py a_copter_square.tlog  # one of them
    python make_facts.py --check               # rewrite nothing, exit 1 if a fact file differs from its recording
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import json
import math
import os
import sys
import tomllib
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

# SciPy has no types of its own; "unused-ignore" because stubs, or a mypy override, may be there.
from scipy.spatial.transform import Rotation, Slerp  # type: ignore[import-untyped,unused-ignore]

Floats = NDArray[np.float64]
Json = dict[str, Any]

HERE = Path(__file__).resolve().parent
ATTITUDE, QUATERNION = "ATTITUDE", "ATTITUDE_QUATERNION"
COUNTED = ("HEARTBEAT", ATTITUDE, QUATERNION, "RAW_IMU", "SCALED_IMU", "HIGHRES_IMU", "AHRS2")
PARAMETERS = {
    *("AHRS_TRIM_X", "AHRS_TRIM_Y", "AHRS_TRIM_Z"),
    *("PTCH_TRIM_DEG", "TRIM_PITCH_CD", "FLIGHT_OPTIONS"),
    *("Q_ENABLE", "Q_TRIM_PITCH", "Q_TAILSIT_ENABLE"),
}
AUTOPILOT_INVALID, TYPE_GCS = 8, 6
AUTOPILOT_NAMES = {"ardupilotmega": "ardupilot"}
IFLAG_SIGNED = 0x01
REBOOT_MS = 10_000  # a boot clock that falls by more is a reboot, by less reordering
MAX_GAP_MS = 1_000
SILENCE_MS = 2_000
IDENTITY_LIMIT_DEG = 0.5
SUSTAINED_S = 1.0
STEPS_LISTED = 6
RESET_DEG = 2.2


@dataclass
class Stream:
    """One attitude message of one vehicle in one boot, in order of boot time, each time once."""

    t_ms: NDArray[np.int64]
    rotation: Rotation
    rates_rad_s: Floats


@dataclass
class Vehicle:
    autopilot: int
    type: int
    counts: Counter[str] = field(default_factory=Counter)
    rows: dict[str, list[tuple[float, ...]]] = field(default_factory=lambda: {ATTITUDE: [], QUATERNION: []})
    boot: int = 0
    newest_ms: int | None = None
    seen: set[bytes] = field(default_factory=set)
    duplicates: int = 0
    repeated_times: int = 0
    invalid: int = 0
    clocks_s: dict[str, list[float]] = field(default_factory=dict)
    modes: list[list[int | None]] = field(default_factory=list)
    parameters: dict[str, list[list[float | None]]] = field(default_factory=dict)
    offset_ms: list[tuple[int, int]] = field(default_factory=list)

    def add_attitude(self, name: str, message: Any) -> None:
        frame = bytes(message.get_msgbuf())
        t_ms = int(message.time_boot_ms)
        if self.newest_ms is not None and t_ms < self.newest_ms - REBOOT_MS:
            self.boot += 1
            self.newest_ms = t_ms
            self.seen.clear()
        if frame in self.seen:
            self.duplicates += 1
            return
        self.seen.add(frame)
        self.newest_ms = t_ms if self.newest_ms is None else max(self.newest_ms, t_ms)
        if name == ATTITUDE:
            angles = [message.yaw, message.pitch, message.roll]
        else:
            angles = [message.q2, message.q3, message.q4, message.q1]  # SciPy's order: scalar last
            if math.hypot(*(message.repr_offset_q or [0.0])) >= 0.5:
                self.offset_ms.append((self.boot, t_ms))
        row = [*angles, message.rollspeed, message.pitchspeed, message.yawspeed]
        if not all(map(math.isfinite, row)) or (name == QUATERNION and not any(angles)):
            self.invalid += 1
            return
        self.rows[name].append((self.boot, t_ms, *row))

    def add_clock(self, name: str, message: Any) -> None:
        t_s = message.time_boot_ms * 1e-3 if hasattr(message, "time_boot_ms") else message.time_usec * 1e-6
        self.clocks_s.setdefault(name, []).append(t_s)

    def add_parameter(self, message: Any) -> None:
        history = self.parameters.setdefault(message.param_id, [])
        if not history or history[-1][1] != message.param_value:
            history.append([self.newest_ms, message.param_value])

    def add_mode(self, message: Any) -> None:
        if not self.modes or self.modes[-1][1] != message.custom_mode:
            self.modes.append([self.newest_ms, message.custom_mode])


def read(path: Path) -> tuple[Json, dict[tuple[int, int], Vehicle], Any]:
    """Everything that pymavlink's reader finds in a recording: totals, vehicles, and pymavlink's dialect module."""
    os.environ["MAVLINK20"] = "1"
    # Loaded by name because pymavlink ships without types: everything from it is Any, and only here.
    mavutil: Any = importlib.import_module("pymavlink.mavutil")
    messages = []
    log: Any = mavutil.mavlink_connection(str(path), dialect="all", robust_parsing=True)
    while (message := log.recv_msg()) is not None:
        messages.append(message)
    log.close()

    totals: Json = {"bad_data": 0, "unknown_ids": 0, "frames": 0, "signed": 0, "mavlink1": 0}
    names: Counter[str] = Counter()
    vehicles: dict[tuple[int, int], Vehicle] = {}
    known = []
    for message in messages:
        name = message.get_type()
        if name == "BAD_DATA":
            totals["bad_data"] += 1
        elif name.startswith("UNKNOWN_"):
            totals["unknown_ids"] += 1
        else:
            frame = message.get_msgbuf()
            totals["frames"] += 1
            totals["signed"] += frame[0] == 0xFD and bool(frame[2] & IFLAG_SIGNED)
            totals["mavlink1"] += frame[0] == 0xFE
            names[name] += 1
            known.append((name, message))
            if name == "HEARTBEAT" and message.autopilot != AUTOPILOT_INVALID and message.type != TYPE_GCS:
                key = (message.get_srcSystem(), message.get_srcComponent())
                vehicles.setdefault(key, Vehicle(message.autopilot, message.type))
    totals["messages"] = dict(names)

    for name, message in known:
        vehicle = vehicles.get((message.get_srcSystem(), message.get_srcComponent()))
        if vehicle is None:
            continue
        vehicle.counts[name] += 1
        if name in (ATTITUDE, QUATERNION):
            vehicle.add_attitude(name, message)
        if name in COUNTED and (hasattr(message, "time_boot_ms") or hasattr(message, "time_usec")):
            vehicle.add_clock(name, message)
        if name == "HEARTBEAT":
            vehicle.add_mode(message)
        if name == "PARAM_VALUE" and message.param_id in PARAMETERS:
            vehicle.add_parameter(message)
    return totals, vehicles, mavutil.mavlink


def stream_of(vehicle: Vehicle, name: str, boot: int) -> Stream | None:
    rows = np.array([row[1:] for row in vehicle.rows[name] if row[0] == boot], dtype=np.float64)
    if not len(rows):
        return None
    times, first = np.unique(rows[:, 0].astype(np.int64), return_index=True)
    vehicle.repeated_times += len(rows) - len(times)
    rows = rows[first]
    rotation = Rotation.from_euler("ZYX", rows[:, 1:4]) if name == ATTITUDE else Rotation.from_quat(rows[:, 1:5])
    return Stream(times, rotation, rows[:, -3:])


def angle_deg(a: Rotation, b: Rotation) -> Floats:
    angles: Floats = np.degrees(np.atleast_1d((a.inv() * b).magnitude()))
    return angles


def same_instant(euler: Stream, quaternion: Stream) -> tuple[NDArray[np.int64], Floats]:
    times, i, j = np.intersect1d(euler.t_ms, quaternion.t_ms, assume_unique=True, return_indices=True)
    if not len(times):
        return times, np.empty(0)
    return times, angle_deg(euler.rotation[i], quaternion.rotation[j])


def slerp_aligned(fast: Stream, slow: Stream) -> Floats:
    """Angles at the slow stream's times, the fast one interpolated; no wider gap than MAX_GAP_MS."""
    if len(fast.t_ms) < 2:
        return np.empty(0)
    inside = slow.t_ms[(slow.t_ms >= fast.t_ms[0]) & (slow.t_ms <= fast.t_ms[-1])]
    above = np.searchsorted(fast.t_ms, inside)  # fast.t_ms[above - 1] < t <= fast.t_ms[above]
    gap_ms = np.where(fast.t_ms[above] == inside, 0, fast.t_ms[above] - fast.t_ms[above - 1])
    inside = inside[gap_ms <= MAX_GAP_MS]
    if not len(inside):
        return np.empty(0)
    interpolated = Slerp(fast.t_ms, fast.rotation)(inside)
    return angle_deg(interpolated, slow.rotation[np.searchsorted(slow.t_ms, inside)])


def steps_against_rates(stream: Stream) -> list[Json]:
    """Steps that the stream's own rates deny, by the limit of the specification of the checks.

    `isolated` steps have no such step before or after them: what an estimator's reset looks like.
    """
    if len(stream.t_ms) < 2:
        return []
    h_s = np.diff(stream.t_ms) * 1e-3
    turn = (stream.rotation[:-1].inv() * stream.rotation[1:]).as_rotvec(degrees=True)
    w_deg_s = np.degrees(stream.rates_rad_s)
    kin = np.linalg.norm(turn - h_s[:, None] * (w_deg_s[:-1] + w_deg_s[1:]) / 2, axis=1)
    speed = np.linalg.norm(w_deg_s, axis=1)
    largest = np.maximum(speed[:-1], speed[1:])
    change = np.linalg.norm(np.diff(w_deg_s, axis=0), axis=1)
    limit = RESET_DEG + 0.002 * largest + 1.5 * h_s * (0.5 * change + 0.1 * largest)
    denied = (kin > limit) & (h_s <= MAX_GAP_MS * 1e-3)
    padded = np.pad(denied, 1)
    isolated = denied & ~padded[:-2] & ~padded[2:]
    return [
        {
            "from_boot_ms": int(stream.t_ms[i]),
            "to_boot_ms": int(stream.t_ms[i + 1]),
            "step_deg": float(np.linalg.norm(turn[i])),
            "unexplained_deg": float(kin[i]),
            "isolated": bool(isolated[i]),
        }
        for i in np.flatnonzero(denied)
    ]


def common_resets(euler: list[Json], quaternion: list[Json]) -> list[Json]:
    """Isolated steps against the rates in both streams at overlapping times, as the quaternion shows them.

    A small step against large rates is an oscillation that the samples are too slow for, and no reset.
    """
    return [
        {key: step[key] for key in ("from_boot_ms", "to_boot_ms", "step_deg")}
        for step in quaternion
        if step["isolated"]
        and step["step_deg"] > RESET_DEG
        and any(
            other["isolated"]
            and other["from_boot_ms"] < step["to_boot_ms"]
            and step["from_boot_ms"] < other["to_boot_ms"]
            for other in euler
        )
    ]


def longest_exceedance_s(times_ms: NDArray[np.int64], angles_deg: Floats) -> float:
    """Longest unbroken stretch of pairs above the identity limit, gaps above MAX_GAP_MS breaking it."""
    longest = 0
    start: int | None = None
    for k in range(len(times_ms)):
        if start is not None and times_ms[k] - times_ms[k - 1] > MAX_GAP_MS:
            start = None
        if angles_deg[k] <= IDENTITY_LIMIT_DEG:
            start = None
            continue
        start = int(times_ms[k]) if start is None else start
        longest = max(longest, int(times_ms[k]) - start)
    return longest * 1e-3


def summary_deg(angles: Floats) -> Json:
    if not len(angles):
        return {"count": 0, "median": None, "p99": None, "max": None}
    median, p99 = np.percentile(angles, [50, 99])
    return {"count": len(angles), "median": float(median), "p99": float(p99), "max": float(angles.max())}


def enum_name(mavlink: Any, enum: str, value: int) -> str:
    entry = mavlink.enums[enum].get(value)
    return "unknown" if entry is None else str(entry.name).removeprefix(enum + "_").lower()


def typical_interval_s(times_s: list[float]) -> float | None:
    steps = np.diff(np.array(times_s))
    steps = steps[steps > 0]  # several instances of one sensor share a stamp
    return float(np.median(steps)) if len(steps) else None


def vehicle_facts(vehicle: Vehicle, mavlink: Any) -> Json:
    boots: list[Json] = []
    times: list[NDArray[np.int64]] = []
    angles: list[Floats] = []
    slerped: list[Floats] = []
    exceedance_s = 0.0
    span_s = 0.0
    interpolated = None
    typical = {name: typical_interval_s(vehicle.clocks_s.get(name, [])) for name in COUNTED}
    euler_s, quaternion_s = typical[ATTITUDE], typical[QUATERNION]
    if euler_s is not None and quaternion_s is not None:
        # The faster stream is interpolated; at equal rates (within 5 %) that is ATTITUDE.
        interpolated = ATTITUDE if quaternion_s >= 0.95 * euler_s else QUATERNION
    for boot in range(vehicle.boot + 1):
        streams = {name: stream_of(vehicle, name, boot) for name in (ATTITUDE, QUATERNION)}
        present = {name: stream for name, stream in streams.items() if stream is not None}
        if not present:
            continue
        first = min(int(stream.t_ms[0]) for stream in present.values())
        last = max(int(stream.t_ms[-1]) for stream in present.values())
        span_s += (last - first) * 1e-3
        facts: Json = {"first_boot_ms": first, "last_boot_ms": last, "steps_against_rates": {}, "silences": []}
        steps: dict[str, list[Json]] = {ATTITUDE: [], QUATERNION: []}
        for name, stream in present.items():
            steps[name] = steps_against_rates(stream)
            facts["steps_against_rates"][name] = {"count": len(steps[name]), "first": steps[name][:STEPS_LISTED]}
            for i in np.flatnonzero(np.diff(stream.t_ms) > SILENCE_MS):
                silence = {"from_boot_ms": int(stream.t_ms[i]), "to_boot_ms": int(stream.t_ms[i + 1])}
                facts["silences"].append({"message": name} | silence)
        facts["resets"] = common_resets(steps[ATTITUDE], steps[QUATERNION])
        boots.append(facts)
        euler, quaternion = streams[ATTITUDE], streams[QUATERNION]
        if euler is None or quaternion is None:
            continue
        instant, angle = same_instant(euler, quaternion)
        times.append(instant)
        angles.append(angle)
        exceedance_s = max(exceedance_s, longest_exceedance_s(instant, angle))
        fast, slow = (euler, quaternion) if interpolated == ATTITUDE else (quaternion, euler)
        slerped.append(slerp_aligned(fast, slow))

    pairs = np.concatenate(angles) if angles else np.empty(0)
    over = pairs > IDENTITY_LIMIT_DEG
    rates: Json = {}
    for name in COUNTED:
        if vehicle.counts[name]:
            interval_s = typical[name]
            rates[name] = {
                "mean": vehicle.counts[name] / span_s if span_s else None,
                "typical": None if interval_s is None else 1 / interval_s,
            }
    offset_boot_ms = [t_ms for _, t_ms in vehicle.offset_ms]
    return {
        "autopilot": autopilot_name(mavlink, vehicle.autopilot),
        "type": enum_name(mavlink, "MAV_TYPE", vehicle.type),
        "messages": {name: vehicle.counts[name] for name in COUNTED},
        "rates_hz": rates,
        "boot_count": len(boots),
        "boots": boots,
        "duplicates": vehicle.duplicates,
        "repeated_times": vehicle.repeated_times,
        "invalid": vehicle.invalid,
        "same_instant": summary_deg(pairs)
        | {"over_limit_share": float(over.mean()) if len(pairs) else None, "over_limit_longest_s": exceedance_s},
        "slerp": summary_deg(np.concatenate(slerped) if slerped else np.empty(0)) | {"interpolated": interpolated},
        "modes": vehicle.modes,
        "parameters": vehicle.parameters,
        "repr_offset_q": {
            "count": len(offset_boot_ms),
            "first_boot_ms": offset_boot_ms[0] if offset_boot_ms else None,
            "last_boot_ms": offset_boot_ms[-1] if offset_boot_ms else None,
        },
    }


def autopilot_name(mavlink: Any, value: int) -> str:
    name = enum_name(mavlink, "MAV_AUTOPILOT", value)
    return AUTOPILOT_NAMES.get(name, name)


def rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [rounded(item) for item in value]
    if isinstance(value, float):
        return float(f"{value:.6g}") if abs(value) >= 1e-12 else 0.0
    return value


def facts_of(path: Path, provenance: Json) -> Json:
    """All facts of one recording."""
    human = provenance["recordings"][path.stem]
    totals, vehicles, mavlink = read(path)
    data = path.read_bytes()
    found: Json = {}
    alarming: list[str] = []
    for key, vehicle in sorted(vehicles.items()):
        name = f"{key[0]},{key[1]}"
        facts = vehicle_facts(vehicle, mavlink)
        judged = human.get("vehicles", {}).get(name, human)
        facts |= {entry: judged.get(entry) for entry in ("judgement", "euler_quaternion", "cause", "value", "unit")}
        facts["euler_quaternion"] = judged.get("euler_quaternion", judged["judgement"])
        pairs = facts["same_instant"]
        longest_s = pairs["over_limit_longest_s"]
        facts["raw_alarm"] = facts["euler_quaternion"] == "explained" and longest_s >= SUSTAINED_S
        if facts["raw_alarm"]:
            alarming.append(
                f"vehicle {name}: {pairs['over_limit_share']:.1%} of the same-instant pairs are more than"
                f" {IDENTITY_LIMIT_DEG} deg apart, for up to {longest_s:.2f} s without a break (largest"
                f" {pairs['max']:.3g} deg), because of {facts['cause']}"
            )
        found[name] = facts
    if set(human.get("vehicles", {})) - set(found):
        raise SystemExit(f"{path.name}: provenance.toml names a vehicle that is not in the recording")
    common = provenance["common"]
    notes = [note for note in (human.get("note"), *alarming) if note]
    where = human["trim"] | {
        "boot_ms": {
            name: [[boot["first_boot_ms"], boot["last_boot_ms"]] for boot in facts["boots"]]
            for name, facts in found.items()
        }
    }
    facts = {
        "recording": path.name,
        "sha256": hashlib.sha256(data).hexdigest(),
        "bytes": len(data),
        "provenance": {
            "autopilot": human["autopilot"],
            "what_happens": human["what_happens"],
            "recorded_over": common["recorded_over"],
            "ground_station": common["ground_station"],
            "trimmed": where,
            "licence": common["licence"],
        },
        "judgement": human["judgement"],
        "euler_quaternion": human.get("euler_quaternion", human["judgement"]),
        "cause": human.get("cause"),
        "value": human.get("value"),
        "unit": human.get("unit"),
        "value_history": human.get("value_history"),
        "other_alarms": human.get("other_alarms", []),
        "events": human.get("events", []),
        "raw_alarm": bool(alarming),
        "note": "; ".join(notes) or None,
        "vehicles": found,
    } | totals
    return dict(rounded(facts))


def as_text(facts: Json) -> str:
    return json.dumps(facts, indent=1, sort_keys=True, ensure_ascii=False, allow_nan=False) + "\n"


def differences(path: str, old: Any, new: Any) -> list[str]:
    """Where two facts differ; floats may differ in the last digit, as libraries and processors do."""
    if isinstance(old, dict) and isinstance(new, dict):
        keys = sorted(old.keys() | new.keys())
        return [line for key in keys for line in differences(f"{path}/{key}", old.get(key), new.get(key))]
    if isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        return [line for k in range(len(old)) for line in differences(f"{path}/{k}", old[k], new[k])]
    if isinstance(old, float) and isinstance(new, float) and math.isclose(old, new, rel_tol=2e-5, abs_tol=1e-9):
        return []
    return [] if old == new else [f"{path}: file {old!r}, recording {new!r}"]


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Write, or check, the expected facts of the recordings.")
    parser.add_argument("recordings", nargs="*", type=Path, metavar="RECORDING", help="default: all of this folder")
    parser.add_argument(
        "--check", action="store_true", help="write nothing; exit 1 if a fact file is not what it should be"
    )
    arguments = parser.parse_args(argv)
    provenance = tomllib.loads((HERE / "provenance.toml").read_text(encoding="utf-8"))
    everything = not arguments.recordings
    recordings: list[Path] = arguments.recordings or sorted(HERE.glob("*.tlog"))
    wrong = 0
    if everything:
        there = {path.stem for path in recordings}
        files = {path.name.removesuffix(".facts.json") for path in HERE.glob("*.facts.json")}
        for name in sorted(there ^ set(provenance["recordings"])):
            print(f"{name}: only one of recording and provenance.toml has it", file=sys.stderr)
            wrong += 1
        for name in sorted(files - there):
            print(f"{name}: facts without a recording", file=sys.stderr)
            wrong += 1
    for path in recordings:
        if path.stem not in provenance["recordings"]:
            print(f"{path.name}: not in provenance.toml", file=sys.stderr)
            wrong += not everything
            continue
        facts = facts_of(path, provenance)
        target = path.with_name(path.stem + ".facts.json")
        if not arguments.check:
            target.write_text(as_text(facts), encoding="utf-8")
            continue
        old = json.loads(target.read_text(encoding="utf-8")) if target.exists() else {}
        lines = differences("", old, facts)
        wrong += bool(lines)
        for line in lines:
            print(f"{target.name}{line}", file=sys.stderr)
    if arguments.check and not wrong:
        print(f"{len(recordings)} recordings agree with their facts")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
