"""Handmade entries of a report, as the contract describes them."""

from typing import Any

import msgspec

from gcs_bridge.contract import readable
from gcs_bridge.report import Report
from gcs_bridge.report.schema import File

CHECKS = [
    *("euler_quaternion", "quaternion_norm", "body_rates", "kinematics", "gyro", "gravity", "mag_heading"),
    *("secondary_estimate", "stream"),
]

SALVAGE: dict[str, Any] = {
    "frames": 30241,
    "bad_crc": 0,
    "repaired_crc": 0,
    "unverified": 0,
    "skipped_bytes": 0,
    "signed": 0,
    "signatures": None,
    "duplicates": 0,
    "bad_times": 0,
    "read_fraction": 1.0,
    "gap_count": 0,
    "gaps": [],
}

ALARM = {
    "id": "1,1/euler_quaternion/0/1",
    "check": "euler_quaternion",
    "severity": "alarm",
    "boot": 0,
    "what": "the two forms differ",
    "is_not": "no fault of the estimate: both forms come from one",
    "raised_boot_s": 12.4,
    "cleared_boot_s": 15.0,
    "raised_utc": "2026-05-01T12:00:12.400Z",
    "unit": "deg",
    "peak": 90.0,
    "axis": "heading",
    "tilt": 0.0,
    "heading": 90.0,
    "rotvec_body": [0.0, 0.0, 90.0],
    "repeats": 0,
    "grouped": None,
    "acknowledged": False,
    "diagnosis": None,
}

PARTS = ("median", "p95", "p99", "max")

DIAGNOSIS = {
    "cause": "yaw_offset",
    "causes": ["yaw_offset"],
    "confidence": "certain",
    "distinguishable": False,
    "candidates": ["yaw_offset", "mount_offset"],
    "side": 31,
    "value": 90.0,
    "unit": "deg",
    "residual": 0.1,
    "next_best": 20.0,
    "fix": "Turn by 5° of tilt to tell.",
}


def stream(count: int = 3000) -> dict[str, Any]:
    return {"count": count, "rate_hz": 25.0, "max_gap_s": 0.08, "lost": 0, "invalid": 0}


def check(name: str = "euler_quaternion", verdict: str = "agree", **changes: Any) -> dict[str, Any]:
    judged = verdict not in ("no_compare", "inop")
    spread = {"median": 1e-6, "p95": 3e-6, "p99": 6e-6, "max": 7e-6} if judged else dict.fromkeys(PARTS)
    return {
        "name": name,
        "verdict": verdict,
        "reason": "judged" if judged else "no ATTITUDE_QUATERNION was received",
        "coverage": 0.9989 if judged else None,
        "pairs": 2953 if judged else 0,
        "same_instant": 2940 if judged else None,
        "unit": "deg",
        "residual": spread,
        "raw": spread,
        "tilt": spread,
        "heading": spread,
        "lag_ms": None,
        "explained_by": [],
        **changes,
    }


def vehicle(verdict: str = "agree", **changes: Any) -> dict[str, Any]:
    return {
        "sysid": 1,
        "compid": 1,
        "autopilot": "ardupilot",
        "type": "quadrotor",
        "verdict": verdict,
        "boots": [{"index": 0, "first_boot_s": 3.1, "last_boot_s": 131.7, "start_utc": None}],
        "streams": {"ATTITUDE": stream(), "ATTITUDE_QUATERNION": stream()},
        "checks": [check(verdict=verdict)],
        "alarms": [ALARM] if verdict == "alarm" else [],
        "resets": [],
        **changes,
    }


def without_quaternion(verdict: str = "no_compare", **changes: Any) -> dict[str, Any]:
    """A vehicle that sent ATTITUDE alone."""
    return vehicle(verdict, **{"streams": {"ATTITUDE": stream()}, **changes})


def entry(*vehicles: dict[str, Any], verdict: str = "agree", path: str = "flight.tlog") -> dict[str, Any]:
    return {"path": path, "bytes": 1_648_395, "verdict": verdict, "salvage": SALVAGE, "vehicles": list(vehicles)}


def file(*vehicles: dict[str, Any], verdict: str = "agree", path: str = "flight.tlog") -> File:
    """The same, as a judge gives it."""
    return msgspec.convert(entry(*vehicles, verdict=verdict, path=readable(path)), File)


def report(*files: dict[str, Any]) -> Report:
    """The report of handmade entries."""
    return Report.of(msgspec.convert(file, File) for file in files)
