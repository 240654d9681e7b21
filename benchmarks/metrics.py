"""What a scrape of `gcs-bridge listen --metrics` costs the process that listens to sixteen vehicles.

    python -m benchmarks.metrics           # a minute; Linux

The vehicles are those of benchmarks.live_rate, at the rate at which they were flown. Measured is the processor time of
all that is done for a scrape, by each thread's own clock: of the loop, which looks at what is known, and of the thread
that answers; and of the one that waits for who comes, all the time.
"""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from pathlib import Path

from benchmarks import fleet, live, live_rate

SCRAPES, EVERY_S = 20, 1.1
PROMETHEUS_S = 5.0
WAITING = "waiting"
HEADERS = {"Accept": "text/plain;version=0.0.4", "Accept-Encoding": "gzip"}  # as Prometheus asks


def listen_timed() -> None:
    """The program with a clock at what is done for scrapes; what they took is told on standard error at the end."""
    from gcs_bridge.cli import main
    from gcs_bridge.metrics import served

    used_s: dict[str, float] = {}
    live_rate.clock(used_s, "answering", served._Server, "process_request_thread")
    live_rate.clock(used_s, WAITING, served._Server, "serve_forever")
    live_rate.clock(used_s, "in the loop", served.MetricsServer, "run")
    code = main(sys.argv[1:])
    sys.stderr.write(json.dumps(used_s) + "\n")
    sys.exit(code)


def scrape(port: int) -> bytes:
    """One."""
    request = urllib.request.Request(f"http://127.0.0.1:{port}/metrics", headers=HEADERS)
    with urllib.request.urlopen(request, timeout=10) as answer:
        text: bytes = answer.read()
        return text


def main() -> None:
    """Measure, and print what a scrape costs."""
    link, port = live.free_port(socket.SOCK_DGRAM), live.free_port(socket.SOCK_STREAM)
    command = [sys.executable, "-c", "from benchmarks.metrics import listen_timed; listen_timed()", "listen"]
    command += [f"udpin:127.0.0.1:{link}", "--viewer", "none", "-q", "--metrics", str(port)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    while "metrics are at" not in (said := process.stderr.readline()):
        assert said, "the listener has ended"
    waits_from_s = time.monotonic()
    per_s, lasts_s = live_rate.VEHICLES * fleet.PER_S, SCRAPES * EVERY_S + 8
    with tempfile.TemporaryDirectory() as folder:
        frames = fleet.Fleet(live_rate.VEHICLES).first(per_s * lasts_s)
        flight = threading.Thread(target=live_rate.sent, args=(Path(folder), frames, link, per_s))
        flight.start()
        time.sleep(6)
        began_s, began_cpu_s = time.monotonic(), live.cpu_s(process.pid)
        for _ in range(SCRAPES):
            text = scrape(port)
            time.sleep(EVERY_S)
        lasted_s, all_s = time.monotonic() - began_s, live.cpu_s(process.pid) - began_cpu_s
        flight.join()
    process.send_signal(signal.SIGTERM)
    waited_s = time.monotonic() - waits_from_s
    used_s: dict[str, float] = json.loads(process.stderr.read().splitlines()[-1])
    process.wait()
    waiting = used_s.pop(WAITING) / waited_s
    each_ms = {name: spent_s / SCRAPES * 1e3 for name, spent_s in used_s.items()}
    cost_ms = sum(each_ms.values())
    sys.stdout.write(
        f"{live_rate.VEHICLES} vehicles, {per_s:,.0f} messages/s, a scrape each {EVERY_S:g} s: "
        f"{all_s / lasted_s:.1%} of a processor\n"
        f"a scrape, {text.count(b'{'):,} series: {cost_ms:.1f} ms "
        f"({', '.join(f'{name} {spent_ms:.1f}' for name, spent_ms in each_ms.items())})\n"
        f"each {PROMETHEUS_S:g} s, with {waiting:.2%} for waiting: "
        f"{cost_ms / 1e3 / PROMETHEUS_S + waiting:.2%} of a processor\n"
    )


if __name__ == "__main__":
    main()
