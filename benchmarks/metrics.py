"""What a scrape of `gcs-bridge listen --metrics` costs the process that listens to sixteen vehicles.

    python -m benchmarks.metrics           # two minutes; Linux

The vehicles are those of benchmarks.live_rate, at the rate at which they were flown. Times with a scrape each 1.1 s and
times without take turns; the difference is what the scrapes cost, and a fifth of one is what they cost a second where
Prometheus reads each five.
"""

from __future__ import annotations

import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from pathlib import Path

from benchmarks import live, live_rate

ROUNDS, SECONDS, EVERY_S = 6, 10.0, 1.1
PROMETHEUS_S = 5.0
HEADERS = {"Accept": "text/plain;version=0.0.4", "Accept-Encoding": "gzip"}  # as Prometheus asks


def scrape(port: int) -> int:
    """One; how many bytes were sent."""
    request = urllib.request.Request(f"http://127.0.0.1:{port}/metrics", headers=HEADERS)
    with urllib.request.urlopen(request, timeout=10) as answer:
        return len(answer.read())


def used_s(pid: int, port: int | None) -> tuple[float, int]:
    """What the process uses in `SECONDS`, with scrapes of `port` or without; and how many there were."""
    began_s, ends_s = live.cpu_s(pid), time.monotonic() + SECONDS
    count = 0
    while (left_s := ends_s - time.monotonic()) > 0:
        if port is not None and left_s > EVERY_S:
            scrape(port)
            count += 1
        time.sleep(min(EVERY_S, left_s))
    return live.cpu_s(pid) - began_s, count


def main() -> None:
    """Measure, and print what a scrape costs."""
    link, port = live.free_port(socket.SOCK_DGRAM), live.free_port(socket.SOCK_STREAM)
    program = [sys.executable, "-c", "import sys; from gcs_bridge.cli import main; sys.exit(main())"]
    command = [*program, "listen", f"udpin:127.0.0.1:{link}", "--viewer", "none", "-q", "--metrics", str(port)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    assert process.stderr is not None
    process.stderr.readline()  # it says where
    lasts_s = 2 * ROUNDS * SECONDS + 8
    per_s = live_rate.VEHICLES * live_rate.PER_S
    with tempfile.TemporaryDirectory() as folder:
        frames = live_rate.flight(live_rate.VEHICLES, per_s * lasts_s)
        flight = threading.Thread(target=live_rate.sent, args=(Path(folder), frames, link, per_s))
        flight.start()
        time.sleep(6)
        size = scrape(port)
        alone, each = [], []
        for _ in range(ROUNDS):
            without_s, _ = used_s(process.pid, None)
            with_s, count = used_s(process.pid, port)
            alone.append(without_s / SECONDS)
            each.append((with_s - without_s) / count)
        flight.join()
    process.send_signal(signal.SIGTERM)
    process.communicate()
    cost_s = statistics.median(each)
    sys.stdout.write(
        f"{live_rate.VEHICLES} vehicles, {per_s:,.0f} messages/s: {statistics.median(alone):.1%} of a processor\n"
        f"a scrape, {size:,} bytes compressed: {cost_s * 1e3:.1f} ms ({min(each) * 1e3:.1f} to {max(each) * 1e3:.1f}); "
        f"each {PROMETHEUS_S:g} s: {cost_s / PROMETHEUS_S:.2%} of a processor\n"
    )


if __name__ == "__main__":
    main()
