"""What the view of `gcs-bridge listen` on a terminal costs, on top of listening with `--plain`.

    python -m benchmarks.view              # three minutes; Linux

The vehicles are those of benchmarks.live_rate, at the rate at which they were flown, on a pseudo-terminal whose other
end is read at once. Measured one after the other is the processor time of the whole process, and within it that of the
view, by the clock of its thread. A view that takes too much looks less often: how often is told, too.
"""

from __future__ import annotations

import fcntl
import json
import os
import pty
import signal
import socket
import struct
import sys
import tempfile
import termios
import threading
import time
from pathlib import Path
from typing import NamedTuple

from benchmarks import fleet, live, live_rate

CASES = ((1, 80, 24), (live_rate.VEHICLES, 80, 24), (live_rate.VEHICLES, 200, 60))  # vehicles, columns, rows
SETTLED_S, MEASURED_S = 5.0, 15.0
_LOOKS = "looks"
_TOLD = "BENCHMARK_TOLD"  # names the file in which the view's cost is told


class Cost(NamedTuple):
    """Shares of a processor: of the whole process, and of the view within it; what it sends, bytes/s; looks/s."""

    process: float
    view: float
    sent_per_s: float
    looks_per_s: float


def listen_timed() -> None:
    """The program with a clock at the view, from SIGUSR1 on; what it took is told in a file that is named to it."""
    from gcs_bridge.cli import main
    from gcs_bridge.screen.view import View

    used_s: dict[str, float] = {}
    live_rate.clock(used_s, "run", View, "run")
    live_rate.clock(used_s, "events", View, "events")
    look, used_s[_LOOKS] = View._look, 0.0

    def look_counted(self: View, now_s: float) -> None:
        used_s[_LOOKS] += 1
        look(self, now_s)

    setattr(View, look.__name__, look_counted)
    signal.signal(signal.SIGUSR1, lambda *_: used_s.update(dict.fromkeys(used_s, 0.0)))
    code = main(sys.argv[1:])
    Path(os.environ[_TOLD]).write_text(json.dumps(used_s))
    sys.exit(code)


def measured(folder: Path, vehicles: int, columns: int, rows: int, *, plain: bool) -> Cost:
    """Fly so many vehicles, and look at what the listener uses meanwhile."""
    port, told = live.free_port(socket.SOCK_DGRAM), folder / "told.json"
    command = [sys.executable, "-c", "from benchmarks.view import listen_timed; listen_timed()", "listen"]
    command += [f"udpin:127.0.0.1:{port}", "--viewer", "none", *(["--plain"] if plain else [])]
    child, terminal = pty.fork()
    if child == 0:
        os.execve(sys.executable, command, {**os.environ, "TERM": "xterm-256color", _TOLD: str(told)})
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
    read = [0]
    reader = threading.Thread(target=_read, args=(terminal, read), daemon=True)
    reader.start()
    while not _is_bound(port):
        time.sleep(0.1)
    per_s = vehicles * fleet.PER_S
    frames = fleet.Fleet(vehicles).first(per_s * (SETTLED_S + MEASURED_S + 1))
    flight = threading.Thread(target=live_rate.sent, args=(folder, frames, port, per_s))
    flight.start()
    time.sleep(SETTLED_S)
    os.kill(child, signal.SIGUSR1)
    began_s, began_cpu_s, began_read = time.monotonic(), live.cpu_s(child), read[0]
    time.sleep(MEASURED_S)
    lasted_s, cpu_s, sent = time.monotonic() - began_s, live.cpu_s(child) - began_cpu_s, read[0] - began_read
    flight.join()
    os.kill(child, signal.SIGTERM)
    os.waitpid(child, 0)
    reader.join()
    os.close(terminal)
    used_s: dict[str, float] = json.loads(told.read_text())
    looks = used_s.pop(_LOOKS)
    return Cost(cpu_s / lasted_s, sum(used_s.values()) / lasted_s, sent / lasted_s, looks / lasted_s)


def _is_bound(port: int) -> bool:
    """Whether somebody listens there."""
    try:
        live_rate.queue_of(port)
    except LookupError:
        return False
    return True


def _read(terminal: int, read: list[int]) -> None:
    """Count what comes until the other end is closed."""
    try:
        while got := os.read(terminal, 1 << 16):
            read[0] += len(got)
    except OSError:  # so Linux says it
        return


def main() -> None:
    """Measure, and print a line a case."""
    with tempfile.TemporaryDirectory() as name:
        for vehicles, columns, rows in CASES:
            plain, viewed = (measured(Path(name), vehicles, columns, rows, plain=plain) for plain in (True, False))
            sys.stdout.write(
                f"{vehicles} vehicles, {columns}×{rows}: listening {plain.process:.1%} of a processor, with the view "
                f"{viewed.process:.1%}; the view itself {viewed.view:.1%}, {viewed.looks_per_s:.1f} looks/s, "
                f"{viewed.sent_per_s / 1e3:.1f} kB/s\n"
            )
            sys.stdout.flush()


if __name__ == "__main__":
    main()
