"""Every bundled recording live, at the speed at which it was flown, over UDP and TCP: judged as `check` judges it.

    python tests/live/all_fixtures.py [--speed X] [--jobs N] [NAME …]

Too long for every run of the tests: about six minutes. A line a run; exit code 1 if any of them differs.
"""

import argparse
import contextlib
import socket
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from gcs_bridge.links.open import open_link
from gcs_bridge.links.uri import NetworkUri
from gcs_bridge.mavlink.scanner import RawFrame
from gcs_bridge.sinks.tlog import TlogRecorder
from tests.helpers.live_links import (
    Live,
    fixture,
    free_port,
    judgement,
    paced,
    recorded_judgement,
    recorder,
    tcp_sender,
    tlog_of,
    wait_until,
)
from tests.helpers.paths import FIXTURES


def over_udp(frames: Sequence[RawFrame], speed: float, sink: TlogRecorder) -> Live:
    seen: list[int] = []

    def record(link: int | str, came: list[RawFrame]) -> None:
        sink.frames(link, came)
        seen.append(len(came))

    uri = NetworkUri("udpin", "127.0.0.1", free_port())
    with Live(open_link(uri), on_frames=record) as live, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        paced(frames, lambda data: sender.sendto(data, (uri.host, uri.port)), speed)
        wait_until(lambda: sum(seen) == len(frames))
    return live


def over_tcp(frames: Sequence[RawFrame], speed: float, sink: TlogRecorder) -> Live:
    with tcp_sender(frames, speed) as (port, _):
        link = open_link(NetworkUri("tcp", "127.0.0.1", port))
        with Live(link, on_frames=sink.frames) as live:
            live.wait_for_the_end(600)
    return live


def differences(flown: Sequence[RawFrame], way: Callable[..., Live], speed: float = 1.0) -> str:
    """Fly a recording over one kind of link; say what is not as in the recording, "" where nothing is."""
    expected = recorded_judgement(tlog_of(flown))
    with tempfile.TemporaryDirectory() as folder, contextlib.closing(recorder(Path(folder) / "live.tlog")) as opened:
        live = way(flown, speed, opened)
        judged = judgement(live.monitor.close().files[0])
        recorded = recorded_judgement((Path(folder) / "live.tlog").read_bytes())
    said = {"judged otherwise": judged, "its recording is judged otherwise": recorded}
    return "; ".join(f"{way.__name__}: {what}" for what, found in said.items() if found != expected)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--jobs", type=int, default=8, help="links at the same time")
    options = parser.parse_args()
    names = options.names or sorted(path.stem for path in FIXTURES.glob("*.tlog"))
    runs = [(name, way) for name in names for way in (over_udp, over_tcp)]
    bad = 0
    with ThreadPoolExecutor(options.jobs) as pool:
        found = pool.map(lambda run: differences(fixture(run[0]), run[1], options.speed), runs)
        for (name, way), said in zip(runs, found, strict=True):
            sys.stdout.write(f"{name} {way.__name__}: {said or 'as recorded'}\n")
            sys.stdout.flush()
            bad += bool(said)
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
