"""Makes the README's picture of the viewer: a recorded flight whose quaternion is turned by 25° from 30 s on.

    python tools/screenshot.py [docs/viewer.png]

Draws with rerun's own viewer, without a window. It needs a graphics driver; on a machine without a graphics card:
apt-get install mesa-vulkan-drivers libvulkan1
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from PIL import Image
from rerun.experimental import ViewerClient

from gcs_bridge.cli import main as gcs_bridge
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from gcs_bridge.resources import demo_recording
from gcs_bridge.viewer.processes import free_port

FAULT, FROM_S = "yaw_offset:25", 30.0
SHOWN_AT_BOOT_S = 76.4  # between two turns of the square, nose to the west
SIZE = "1600x1000"
MOST_BYTES = 400_000
_PATIENCE_S = 30.0
_SETTLED_S = 2.0  # for the camera to arrive and the plots to be drawn


def main(target: Path) -> None:
    """Write the picture to `target`."""
    with tempfile.TemporaryDirectory() as folder:
        recording, drawn = Path(folder, "yaw_offset.tlog"), Path(folder, "drawn.rrd")
        recording.write_bytes(inject(demo_recording().read_bytes(), [parse_fault(FAULT)], from_s=FROM_S))
        if code := gcs_bridge(["replay", str(recording), "--viewer", f"save:{drawn}", "-q"]):
            raise SystemExit(code)
        picture = Path(folder, "picture.png")
        take_picture(drawn, picture)
        target.parent.mkdir(parents=True, exist_ok=True)
        Image.open(picture).convert("RGB").save(target, optimize=True)
    size = target.stat().st_size
    if size > MOST_BYTES:
        raise SystemExit(f"{target} is too large: {size} bytes")
    sys.stdout.write(f"{target}: {size} bytes\n")


def take_picture(drawn: Path, picture: Path) -> None:
    """Show a .rrd at the moment of the picture, and take it."""
    port = free_port(19_700)
    arguments = ["--headless", "--bind", "127.0.0.1", "--port", str(port), "--window-size", SIZE, str(drawn)]
    viewer = subprocess.Popen(
        [sys.executable, "-m", "rerun_cli", *arguments],
        env={**os.environ, "RUST_LOG": "error", "CI": "1"},
        stdin=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        client = _loaded(f"rerun+http://127.0.0.1:{port}/proxy")
        shown_at = np.timedelta64(round(SHOWN_AT_BOOT_S * 1e6), "us")
        client.set_time("boot", duration=shown_at, play_state="paused")
        time.sleep(_SETTLED_S)
        client.save_screenshot(str(picture))
    finally:
        os.killpg(viewer.pid, 9)
        viewer.wait()


def _loaded(address: str) -> ViewerClient:
    ends_s = time.monotonic() + _PATIENCE_S
    while time.monotonic() < ends_s:
        try:
            client = ViewerClient.connect(address)
            state = client.get_state()
        except Exception:  # noqa: BLE001  # whatever it is, the viewer has not started yet
            time.sleep(0.2)
            continue
        if any(line.end for recording in state.recordings for line in recording.timelines) and not state.loading:
            return client
        time.sleep(0.2)
    raise SystemExit(f"no viewer within {_PATIENCE_S:g} s: is there a graphics driver?")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/viewer.png"))
