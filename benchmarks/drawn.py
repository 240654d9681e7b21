"""What it costs to draw four vehicles at 50 Hz, all panels: written to a file, opened again, and live.

    python -m benchmarks.drawn                  # six minutes of flight, and twenty seconds live; three minutes
    python -m benchmarks.drawn --minutes 60     # the hour; a quarter of an hour

Beside it stands the least that could be written of the same: one quaternion a message, nothing else, by the same
library. Both files go through `rerun rrd optimize`; a value is one number (or text), whatever its width. Linux.
"""

from __future__ import annotations

import argparse
import os
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import rerun as rr

from benchmarks.fleet import FLIGHT_S, Fleet, Flight
from benchmarks.live import free_port
from gcs_bridge import attitude
from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.judging.observation import Observation
from gcs_bridge.viewer import open_viewer
from gcs_bridge.viewer.served import ServedViewer

VEHICLES = 4
LIVE_S = 20.0
BATCH_US = 55_000  # what a live loop takes at a time, while no alarm is on its way and somebody looks on
CHUNK_US = 5_000_000  # and `replay`
_RERUN = [sys.executable, "-m", "rerun_cli"]
_QUIET = {**os.environ, "CI": "1", "RUST_LOG": "error"}


class File(NamedTuple):
    """A file of the viewer's, as it was written and put in order."""

    raw_bytes: int
    bytes: int
    values: int


class Opened(NamedTuple):
    """How long a viewer took to have it all, and its memory then."""

    seconds: float
    megabytes: float


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=6.0, help="of flight in the files  [6]")
    minutes = parser.parse_args().minutes
    fleet = Fleet(VEHICLES, also=("GLOBAL_POSITION_INT",))
    flight = fleet.copies(0, max(round(minutes * 60 / FLIGHT_S), 1))
    seconds = float(flight.due_us[-1]) / 1e6
    with tempfile.TemporaryDirectory() as folder:
        whole, least = Path(folder, "whole.rrd"), Path(folder, "least.rrd")
        judged_s = judge(flight)
        drawn_s, samples = draw(flight, whole)
        write_least(flight, least)
        ours, theirs = in_order(whole), in_order(least)
        opened = open_it(whole, seconds)
    rows = [
        ("flight, s; attitudes", f"{seconds:.0f}; {samples:,}"),
        ("processor: judged; judged and drawn, s", f"{judged_s:.1f}; {drawn_s:.1f}"),
        ("drawn, times as fast as flown", f"{seconds / drawn_s:.0f}"),
        ("written, MB; after `rerun rrd optimize`", f"{ours.raw_bytes / 1e6:.1f}; {ours.bytes / 1e6:.1f}"),
        ("written while flying, kB/s", f"{ours.raw_bytes / seconds / 1e3:.0f}"),
        ("bytes an attitude, of all that is drawn", f"{ours.bytes / samples:.0f}"),
        ("values an attitude", f"{ours.values / samples:.1f}"),
        ("bytes a value", f"{ours.bytes / ours.values:.2f}"),
        ("the same of one quaternion a message alone", f"{theirs.bytes / theirs.values:.2f}"),
        ("ratio", f"{ours.bytes / ours.values / (theirs.bytes / theirs.values):.2f}"),
        ("opened by the viewer, s; its memory, MB", f"{opened.seconds:.1f}; {opened.megabytes:.0f}"),
    ]
    without, with_one = live(fleet, "none"), live(fleet, "web")
    rows.append(("live, share of a core: without a viewer; with", f"{without:.1%}; {with_one:.1%}"))
    sys.stdout.write("| | |\n| --- | --- |\n" + "".join(f"| {name} | {value} |\n" for name, value in rows))


def cuts(flight: Flight, step_us: int) -> list[tuple[bytes, int]]:
    """The frames of each such time, and when the last of them came, µs since 1970."""
    edges = np.searchsorted(flight.due_us, np.arange(step_us, flight.due_us[-1] + step_us, step_us))
    ends = np.unique(np.append(edges, len(flight.ends)))
    starts = np.append(0, flight.ends[ends[:-1] - 1])
    start_us = 1_795_000_000_000_000
    return [
        (flight.data[start : flight.ends[end - 1]].tobytes(), start_us + int(flight.due_us[end - 1]))
        for start, end in zip(starts, ends, strict=True)
        if end
    ]


def judge(flight: Flight) -> float:
    """Processor seconds to judge a flight as `replay` does."""
    monitor, began_s = Monitor(), time.process_time()
    for data, t_rx_us in cuts(flight, CHUNK_US):
        monitor.feed(data, t_rx_us)
    monitor.finish()
    return time.process_time() - began_s


def draw(flight: Flight, path: Path) -> tuple[float, int]:
    """The same with a file of what is drawn, and how many attitudes there were."""
    samples = 0
    began_s = time.process_time()
    with open_viewer(f"save:{path}", say=print) as viewer:
        sink = viewer.recording("fleet")

        def observe(observation: Observation) -> None:
            nonlocal samples
            samples += len(observation.segment.euler) + len(observation.segment.quaternion)
            sink.observe(observation)

        monitor = Monitor(observer=observe)
        for data, t_rx_us in cuts(flight, CHUNK_US):
            sink.events(monitor.feed(data, t_rx_us))
        sink.events(monitor.finish())
        sink.finish()
    return time.process_time() - began_s, samples


def write_least(flight: Flight, path: Path) -> None:
    """One quaternion a message of both streams, at boot and receive time."""
    recording = rr.RecordingStream("least")
    recording.set_sinks(rr.FileSink(path))

    def observe(observation: Observation) -> None:
        for name, samples in (("euler", observation.segment.euler), ("quaternion", observation.segment.quaternion)):
            if len(samples):
                times = [
                    rr.TimeColumn("boot", duration=samples.t_boot_us.astype("m8[us]")),
                    rr.TimeColumn("utc", timestamp=samples.t_rx_us.astype("M8[us]")),
                ]
                turned = rr.Transform3D.columns(quaternion=attitude.xyzw_from_wxyz(samples.q_nb))
                recording.send_columns(f"{observation.vehicle.name}/{name}", times, turned)

    monitor = Monitor(observer=observe)
    for data, t_rx_us in cuts(flight, CHUNK_US):
        monitor.feed(data, t_rx_us)
    recording.flush(timeout_sec=60.0)
    recording.disconnect()


def in_order(path: Path) -> File:
    """What a file holds, and how large it is once it is put in order."""
    from rerun.chunk import RrdReader

    raw, ordered = path.stat().st_size, path.with_suffix(".ordered.rrd")
    subprocess.run([*_RERUN, "rrd", "optimize", str(path), "-o", str(ordered)], check=True, env=_QUIET)
    values = 0
    reader = RrdReader(ordered)
    for chunk in reader.stream(store=reader.recordings()[0]):
        batch = chunk.to_record_batch()
        times = {"rerun.controls.RowId", *chunk.timeline_names}
        values += sum(count(batch.column(name)) for name in batch.schema.names if name not in times)
    return File(raw, ordered.stat().st_size, values)


def count(column: pa.Array) -> int:
    """How many numbers or texts there are in a column of lists."""
    while pa.types.is_list(column.type) or pa.types.is_fixed_size_list(column.type):
        column = column.flatten()
    return int(len(column) - column.null_count)


def open_it(path: Path, seconds: float) -> Opened:
    """Let a viewer without a window open it."""
    from rerun.experimental import ViewerClient

    port = free_port(socket.SOCK_STREAM)
    arguments = ["--headless", "--bind", "127.0.0.1", "--port", str(port), "--window-size", "1400x900", str(path)]
    began_s = time.monotonic()
    viewer = subprocess.Popen([*_RERUN, *arguments], env=_QUIET, stderr=subprocess.DEVNULL, start_new_session=True)
    try:
        while time.monotonic() < began_s + 300:
            time.sleep(0.1)
            try:
                state = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy").get_state()
            except ConnectionError:  # it has not started yet
                continue
            boots = [line for one in state.recordings for line in one.timelines if line.name == "boot"]
            spans_ns = [(line.end or 0) - (line.start or 0) for line in boots]
            if max(spans_ns, default=0) >= (seconds - 1) * 1e9 and not state.loading:
                took_s = time.monotonic() - began_s
                time.sleep(3.0)  # all is drawn by now
                return Opened(took_s, memory_mb(viewer.pid))
        raise SystemExit("the viewer did not open it within 300 s")
    finally:
        os.killpg(viewer.pid, signal.SIGKILL)
        viewer.wait()


def memory_mb(group: int) -> float:
    """The resident memory of the largest process of a group, MB."""
    found = [0]
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = status.read_text().rsplit(")", 1)[1].split()
        except OSError:  # it has ended
            continue
        if int(fields[2]) == group:
            found.append(int(fields[21]) * resource.getpagesize())
    return max(found) / 1e6


def live(fleet: Fleet, viewer: str) -> float:
    """The share of a core that it takes to judge, and to draw for a viewer that looks on, as fast as it is flown."""
    flight = fleet.copies(0, 1)
    batches = cuts(flight, BATCH_US)
    said: list[str] = []
    looker = None
    with open_viewer(viewer, say=said.append, live=True) as shown:
        sink = shown.recording("live")
        if isinstance(shown, ServedViewer):
            url = shown.url
            looker = subprocess.Popen(
                [
                    *_RERUN,
                    "--headless",
                    "--bind",
                    "127.0.0.1",
                    "--port",
                    str(free_port(socket.SOCK_STREAM)),
                    "--connect",
                    url,
                ],
                env=_QUIET,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
            time.sleep(4.0)
        monitor = Monitor(observer=None if viewer == "none" else sink.observe)
        first_us = batches[0][1]
        began_s, started_s = time.monotonic(), 0.0
        for data, t_rx_us in batches:
            due_s = (t_rx_us - first_us) / 1e6
            if due_s > LIVE_S:
                break
            if due_s < LIVE_S / 5:  # until then it starts
                started_s, since_s = time.process_time(), due_s
            time.sleep(max(began_s + due_s - time.monotonic(), 0.0))
            sink.events(monitor.feed(data, t_rx_us))
        share = (time.process_time() - started_s) / (LIVE_S - since_s)
        if looker is not None:
            os.killpg(looker.pid, signal.SIGKILL)
            looker.wait()
    return share


if __name__ == "__main__":
    main()
