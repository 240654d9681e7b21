"""The viewers' processes: a window that is let go, a page's server that ends with us, and free ports for them.

Both are rerun's own program. It binds all interfaces unless told otherwise, so it is told each time.
"""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from gcs_bridge.errors import UsageError
from gcs_bridge.viewer.base import SUFFIX, Say
from gcs_bridge.viewer.scene import UTC

__all__ = ["Page", "Window", "free_port"]

_RERUN = (sys.executable, "-m", "rerun_cli")
_HOST = "127.0.0.1"
_PORTS_TRIED = 100
_WINDOW_PORT = 9900  # where a window is told at which moment to stand; the first to be tried
_WINDOW_MEMORY = "2GiB"
_LOADED_S = 20.0  # so long a window may take to load a recording, until its cursor is left where it is
_END_S = 2.0


def free_port(first: int) -> int:
    """The first port from `first` on that nobody listens at; rerun only logs that a port is taken."""
    for port in range(first, first + _PORTS_TRIED):
        with socket.socket() as probe:
            if os.name == "posix":  # a port that is only cooling down is free
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            with contextlib.suppress(OSError):
                probe.bind((_HOST, port))
                return port
    taken = f"{first} to {first + _PORTS_TRIED - 1} are taken"
    raise UsageError(f"no free port for the viewer: {taken}: end what listens there, or use save:FILE{SUFFIX}")


class Window:
    """A native viewer's window. It outlives us: people may look on at what it has got."""

    def __init__(self, url: str, say: Say) -> None:
        """Start the program and go on at once; if it fails, `say` is told, from another thread."""
        self._port = free_port(_WINDOW_PORT)
        arguments = ["--connect", url, "--bind", _HOST, "--port", str(self._port), "--memory-limit", _WINDOW_MEMORY]
        self.process = subprocess.Popen(  # noqa: S603  # rerun's own program
            [*_RERUN, *arguments, "--hide-welcome-screen"],
            env=_without_analytics(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        _tell_of_failure(self.process, say, "the window ended by a failure", f"'rerun --connect {url}' opens another")

    def show(self, recording_id: str, timeline: str, time_us: int) -> None:
        """Put the window's cursor to a time, as soon as it has loaded the recording so far; waits in a thread.

        A layout cannot say where the cursor starts (rerun 0.41), and the way to say it is experimental: if it fails,
        the cursor is left where it is.
        """
        threading.Thread(target=self._show, args=(recording_id, timeline, time_us), daemon=True).start()

    def _show(self, recording_id: str, timeline: str, time_us: int) -> None:
        from rerun.experimental import ViewerClient

        ends_s = time.monotonic() + _LOADED_S
        while time.monotonic() < ends_s:
            with contextlib.suppress(Exception):  # it has not started yet, or has been closed
                client = ViewerClient.connect(f"rerun+http://{_HOST}:{self._port}/proxy")
                for shown in client.get_state().recordings:
                    ends_ns = {line.name: line.end for line in shown.timelines}
                    if shown.store_id.endswith(recording_id) and (ends_ns.get(timeline) or -1) >= time_us * 1000:
                        if timeline == UTC:
                            stamp = np.datetime64(time_us, "us")
                            client.set_time(timeline, timestamp=stamp, play_state="paused", recording=shown.store_id)
                        else:
                            since = np.timedelta64(time_us, "us")
                            client.set_time(timeline, duration=since, play_state="paused", recording=shown.store_id)
                        return
            time.sleep(0.3)


class Page:
    """The web viewer's page, served from this machine to this machine."""

    def __init__(self, port: int, url: str, say: Say) -> None:
        """Start the programs and go on at once; if one fails, `say` is told, from another thread."""
        other_port = free_port(port + 1)
        arguments = ["--serve-web", "--bind", _HOST, "--web-viewer-port", str(other_port), url]
        server = str(Path(__file__).with_name("page_server.py"))
        self._process = subprocess.Popen(  # noqa: S603  # rerun's own program
            [sys.executable, server, str(port), str(other_port), *_RERUN, *arguments],
            env=_without_analytics(),
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        self._closed = False
        _tell_of_failure(
            self._process,
            say,
            f"the web viewer's page at port {port} failed",
            "start anew, or use save:FILE.rrd; the rest goes on",
            unless=lambda: self._closed,
        )

    def close(self) -> None:
        """End it."""
        self._closed = True
        assert self._process.stdin is not None
        self._process.stdin.close()  # the server's sign to end
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_END_S)


def _without_analytics() -> dict[str, str]:
    """The environment in which rerun's program reports its use to nobody, whatever its user has set or not set.

    It holds a machine with `CI` for nobody's (rerun 0.41, re_analytics); its own setting is a file of the user's.
    """
    return {name: value for name, value in os.environ.items() if name != "FORCE_RERUN_ANALYTICS"} | {"CI": "1"}


def _tell_of_failure(
    process: subprocess.Popen[bytes], say: Say, what: str, remedy: str, unless: Callable[[], bool] = lambda: False
) -> None:
    def wait() -> None:
        code = process.wait()
        if code and not unless():
            say(f"viewer: {what} (exit code {code}): {remedy}")

    threading.Thread(target=wait, daemon=True).start()
