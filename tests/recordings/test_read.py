"""Recordings as arrays: the same whatever the pieces and the threads, in room that fits, and not much more of it."""

import dataclasses
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

import gcs_bridge
from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.recordings import source
from gcs_bridge.recordings.read import Recording
from tests.helpers import wire
from tests.helpers.everyday import one_in
from tests.helpers.paths import FIXTURES, ROOT


def columns(recording: Recording) -> dict[tuple[int, int, str, str], tuple[str, bytes]]:
    """Every column's type and bytes, and every text, by vehicle, message and name."""
    found = {}
    for address, vehicle in recording.vehicles.items():
        for message in dataclasses.fields(vehicle):
            samples = getattr(vehicle, message.name)
            for name, of in vars(samples).items() if not isinstance(samples, str) else []:
                if isinstance(of, np.ndarray):
                    assert of.flags.c_contiguous
                    found[*address, message.name, name] = (str(of.dtype), of.tobytes())
                else:
                    found[*address, message.name, name] = (repr(of), b"")
    return found


@pytest.mark.parametrize("name", one_in(3, ["e_two_vehicles", "f_reboot", "h_lossy_dirty"]))
def test_the_size_of_the_pieces_changes_nothing(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A reboot and damage included: what waits at the end of a piece is gone on with in the next."""
    whole = columns(gcs_bridge.read(FIXTURES / f"{name}.tlog"))
    monkeypatch.setattr(source, "_CHUNK", 997)
    assert columns(gcs_bridge.read(FIXTURES / f"{name}.tlog")) == whole


def test_a_stream_that_comes_late_and_in_bursts_finds_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing of it at first, then ten times as much as the recording so far lets expect: no sample is lost."""
    beats = [(wire.START_US + s * 1_000_000, wire.heartbeat(seq=s)) for s in range(300)]
    burst = [(wire.START_US + 300_000_000 + i, wire.attitude(1000 + i, (1e-3 * i, 0, 0), seq=i)) for i in range(5000)]
    path = tmp_path / "late.tlog"
    path.write_bytes(wire.tlog(beats[:150] + burst[:2] + beats[150:] + burst[2:]))
    monkeypatch.setattr(source, "_CHUNK", 2048)
    (vehicle,) = gcs_bridge.read(path).vehicles.values()
    assert vehicle.attitude.rpy_rad is not None
    assert vehicle.attitude.rpy_rad[:, 0].tolist() == [float(np.float32(1e-3 * i)) for i in range(5000)]
    assert vehicle.attitude.t_boot_us.tolist() == [1000 * (1000 + i) for i in range(5000)]
    assert len(vehicle.attitude_quaternion) == 0


def test_both_messages_that_show_a_reboot_are_in_the_new_boot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first one is doubted until the second comes, in the next piece; a lone wrong time is in none."""
    frames = [
        wire.attitude(ms, (0.1, 0.2, 0.01 * i)) for i, ms in enumerate([60_000, 60_040, 900, 940, 5_000_000, 980])
    ]
    records = [wire.record(wire.START_US + 40_000 * i, frame) for i, frame in enumerate([wire.heartbeat(), *frames])]
    path = tmp_path / "reboot.tlog"
    path.write_bytes(b"".join(records))
    for size in (10_000, len(records[-1])):
        monkeypatch.setattr(source, "_CHUNK", size)
        (vehicle,) = gcs_bridge.read(path).vehicles.values()
        samples = vehicle.attitude
        assert samples.boot.tolist() == [0, 0, 1, 1, 1]
        assert samples.t_boot_us.tolist() == [60_000_000, 60_040_000, 900_000, 940_000, 980_000]
        assert samples.frame_index.tolist() == [1, 2, 4, 4, 6]  # known with the frame that showed it
        assert samples.rpy_rad is not None
        assert samples.rpy_rad[:, 2].tolist() == [float(np.float32(0.01 * i)) for i in (0, 1, 2, 3, 5)]


def test_the_second_estimate_is_stamped_between_what_came_around_it() -> None:
    """As a check is given it: midway between the timed messages; nothing before the first one, nor across a reboot."""
    ahrs2 = mavlink.MAVLink_ahrs2_message(0.1, 0.2, 0.3, 10.0, 0, 0)
    story = [None, 1000, None, None, 1100, None, 900, 950, 1000, None]  # ms of ATTITUDE, None: AHRS2
    frames = [wire.heartbeat()] + [
        wire.pack(ahrs2, seq=i) if ms is None else wire.attitude(ms * 100, (0.1, 0.2, 0.3), seq=i)
        for i, ms in enumerate(story)
    ]
    seen = []
    monitor = Monitor(observer=lambda one: seen.append(one.flight.secondary))
    for i, frame in enumerate(frames):
        monitor.feed(frame, wire.START_US + 40_000 * i)
    stamps = [(int(t), int(gap)) for one in seen for t, gap in zip(one.t_boot_us, one.gap_us, strict=True)]
    assert stamps == [(105_000_000, 10_000_000)] * 2


# --- memory ----------------------------------------------------------------------------------------------------------

PROGRAM = """
import sys
from pathlib import Path
import gcs_bridge

def now_and_peak_mb():
    lines = Path("/proc/self/status").read_text().splitlines()
    return [int(line.split()[1]) / 1024 for name in ("VmRSS", "VmHWM") for line in lines if line.startswith(name)]

gcs_bridge.read(sys.argv[1])  # compiled, loaded
before, _ = now_and_peak_mb()
recording = gcs_bridge.read(sys.argv[2])
_, peak = now_and_peak_mb()
arrays = [of for v in recording.vehicles.values() for s in vars(v).values() if not isinstance(s, str)
          for of in vars(s).values() if hasattr(of, "nbytes")]
print(peak - before, sum(of.nbytes for of in arrays) / 2**20)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="/proc")
def test_reading_takes_little_more_memory_than_what_is_returned(tmp_path: Path) -> None:
    """At most 1.3 times the arrays, and some megabytes of pieces on their way."""
    once = wire.tlog(wire.flight(wire.Motion(20.0), 20.0))
    small, large = tmp_path / "small.tlog", tmp_path / "large.tlog"
    small.write_bytes(once)
    large.write_bytes(once * 900)
    shown = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(small), str(large)], cwd=ROOT, capture_output=True, text=True, check=True
    )
    took_mb, arrays_mb = map(float, shown.stdout.split())
    assert arrays_mb > 90
    assert took_mb < 1.3 * arrays_mb + 40
