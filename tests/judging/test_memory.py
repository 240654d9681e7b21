"""What a component costs that hardly sends anything: large links, and hostile ones, are full of them."""

import subprocess
import sys

import pytest

from tests.helpers.paths import ROOT

PROGRAM = """
import gc, sys
from pathlib import Path
from gcs_bridge.judging.monitor import Monitor
from tests.helpers import wire

def resident_mb():
    status = Path("/proc/self/status").read_text()
    return int(next(line for line in status.splitlines() if line.startswith("VmRSS")).split()[1]) / 1024

def batch(first, count):
    frames = b""
    for i in range(first, first + count):
        sender = {"sysid": 1 + i % 250, "compid": 1 + i // 250}
        frames += wire.heartbeat(**sender) + wire.attitude(10_000 + i, (0.1, 0.2, 0.3), **sender)
    return frames

monitor = Monitor()
monitor.feed(batch(0, 1), wire.START_US)
gc.collect()
before = resident_mb()
for first in range(1, 500, 25):
    monitor.feed(batch(first, min(25, 500 - first)), wire.START_US + first)
gc.collect()
print(resident_mb() - before, sum(len(file.vehicles) for file in monitor.close().files))
"""


@pytest.mark.slow
def test_500_components_that_send_heartbeats_and_one_attitude() -> None:
    """They take less than 60 MB more than one does, and each is in the report."""
    shown = subprocess.run([sys.executable, "-c", PROGRAM], cwd=ROOT, capture_output=True, text=True, check=True)
    more_mb, vehicles = shown.stdout.split()
    assert int(vehicles) == 500
    assert float(more_mb) < 60.0


FORGED = """
import gc, resource, time
from gcs_bridge.judging.monitor import Monitor
from tests.helpers import wire

flown = wire.flight(wire.Motion(21, seed=3), 20.0, euler_hz=10.0, quaternion_hz=10.0)
forged = [{"sysid": 2 + i % 250, "compid": 1 + i // 250} for i in range(12_791)]
share = -(-len(forged) // len(flown))
monitor = Monitor()
monitor.feed(b"", wire.START_US)
gc.collect()
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
begin = time.process_time()
for i, (t_us, frame) in enumerate(flown):
    for sender in forged[i * share : (i + 1) * share]:
        frame += wire.heartbeat(**sender) + wire.attitude(10_000 + i, (0.1, 0.2, 0.3), **sender)
    monitor.feed(frame, t_us)
(entry,) = monitor.close().files
(vehicle,) = entry.vehicles
more_mb = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
seconds = time.process_time() - begin
print(more_mb, seconds, entry.verdict, vehicle.checks[0].pairs, entry.other_count, *entry.salvage.remarks)
"""


@pytest.mark.sweep
@pytest.mark.slow
def test_thousands_of_forged_senders_beside_a_vehicle() -> None:
    """A heartbeat and an attitude each: below 300 MB, in seconds; the vehicle is judged, and they are counted."""
    shown = subprocess.run([sys.executable, "-c", FORGED], cwd=ROOT, capture_output=True, text=True, check=True)
    more_mb, seconds, verdict, pairs, others, *said = shown.stdout.split()
    assert float(more_mb) < 300.0
    assert float(seconds) < 60.0  # most of it packs the frames
    assert (verdict, int(pairs), int(others)) == ("agree", 200, 12_791)
    assert " ".join(said).startswith("12791 that claim to be vehicles were heard too briefly")
