"""Every bundled recording live, at the speed at which it was flown, over UDP and TCP: judged as `check` judges it.

    python tests/live/all_fixtures.py [--speed X] [--jobs N] [NAME …]

Too long for every run of the tests: about six minutes. A line a recording; exit code 1 if any of them differs.
"""

import argparse
import socket
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from live_links import FIXTURES, Live, fixture, free_port, judgement, paced, recorded_judgement, tcp_sender, wait_until

from gcs_bridge.mavlink.scan import RawFrame
from gcs_bridge.sinks.file import LiveFile
from gcs_bridge.sinks.tlog import TlogRecorder
from gcs_bridge.sources.open import open_link
from gcs_bridge.sources.uri import NetworkUri


def over_udp(frames: list[RawFrame], speed: float, recorder: TlogRecorder) -> Live:
    seen: list[int] = []

    def record(link: int | str, came: list[RawFrame]) -> None:
        recorder.record(link, came)
        seen.append(len(came))

    uri = NetworkUri("udpin", "127.0.0.1", free_port())
    with Live(open_link(uri), on_frames=record) as live, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        paced(frames, lambda data: sender.sendto(data, (uri.host, uri.port)), speed)
        wait_until(lambda: sum(seen) == len(frames), 10)
    return live


def over_tcp(frames: list[RawFrame], speed: float, recorder: TlogRecorder) -> Live:
    with tcp_sender(frames, speed) as (port, _):
        link = open_link(NetworkUri("tcp", "127.0.0.1", port))
        with Live(link, on_frames=recorder.record) as live:
            live.join(600)
    return live


def differences(name: str, speed: float) -> list[str]:
    """Fly one recording on both kinds of link; say what was not as it is in the recording."""
    frames = fixture(name)
    expected = recorded_judgement((FIXTURES / f"{name}.tlog").read_bytes())
    found = []
    for way in (over_udp, over_tcp):
        with tempfile.TemporaryDirectory() as folder, LiveFile(Path(folder) / "live.tlog", print) as file:
            live = way(frames, speed, TlogRecorder(file))
            judged = judgement(live.monitor.close().files[0])
            recorded = recorded_judgement((Path(folder) / "live.tlog").read_bytes())
        if judged != expected:
            found.append(f"{way.__name__}: judged otherwise")
        if recorded != expected:
            found.append(f"{way.__name__}: its recording is judged otherwise")
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--jobs", type=int, default=8, help="recordings at the same time")
    options = parser.parse_args()
    names = options.names or sorted(path.stem for path in FIXTURES.glob("*.tlog"))
    bad = 0
    with ThreadPoolExecutor(options.jobs) as pool:
        flown = pool.map(lambda name: differences(name, options.speed), names)
        for name, found in zip(names, flown, strict=True):
            sys.stdout.write(f"{name}: {'; '.join(found) or 'as recorded'}\n")
            sys.stdout.flush()
            bad += bool(found)
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
