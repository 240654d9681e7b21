"""A viewer that looks at this process: a window or a browser's page, which may come, go, or never come.

This process holds the server, bound to this machine alone, and never waits for who reads from it: a viewer that is
killed, restarted or late gets the history anew, as far as the server's memory limit keeps it. (The other way round,
sending to a viewer, blocks for ever once it has gone.)
"""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections.abc import Sequence
from typing import Literal
from urllib.parse import quote

import rerun as rr

from gcs_bridge.viewer import processes
from gcs_bridge.viewer.base import Beside, Viewer, ViewerOptions, ViewerSink
from gcs_bridge.viewer.drawing import new_recording
from gcs_bridge.viewer.pace import Pace
from gcs_bridge.viewer.sink import sinks_of
from gcs_bridge.viewer.world import world_of

__all__ = ["ServedViewer"]

_HOST = "127.0.0.1"
_DATA_PORT, _WEB_PORT = 9877, 9090  # the first to be tried; 9876 is left to rerun's own viewer
_HISTORY = {True: "256MiB", False: "2GiB"}  # of a live link: some minutes at least; of recordings: all of it
_FLUSH_S = 5.0
_END_S = 8.0  # so long the end may take
_LAST_LOOK_S = 0.2  # for a viewer to fetch what came last, before the server goes


class ServedViewer(Viewer):
    """Serves what is drawn to a native viewer, started here, or to the web viewer's page, served here."""

    stays = True

    def __init__(self, kind: Literal["native", "web"], options: ViewerOptions, *, why: str = "") -> None:
        """Find free ports. The server starts with what is drawn, and with it the window or the page's server.

        `why` goes before the page's address.
        """
        self.kind = kind
        self._say = options.say
        self._why = why
        self._live = options.live
        self._memory_limit = options.server_memory_limit or _HISTORY[options.live]
        self._port = processes.free_port(_DATA_PORT)
        self._web_port = processes.free_port(_WEB_PORT) if kind == "web" else None
        self._recording: rr.RecordingStream | None = None
        self._page: processes.Page | None = None
        self._window: processes.Window | None = None
        self._pace: Pace | None = None

    @property
    def url(self) -> str:
        """Where viewers get the data."""
        return f"rerun+http://{_HOST}:{self._port}/proxy"

    @property
    def page_url(self) -> str:
        """The web viewer's page."""
        return f"http://{_HOST}:{self._web_port}/?url={quote(self.url, safe='')}&hide_welcome_screen"

    def recordings(self, name: str, several: Sequence[Beside | None]) -> list[ViewerSink]:
        """Where each of several is drawn that are shown side by side as `name`; None: it is alone."""
        recording = self._recording = new_recording(name, live=self._live)
        recording.set_sinks(rr.GrpcServerSink(_HOST, self._port, server_memory_limit=self._memory_limit))
        if self.kind == "native":
            self._window = processes.Window(self.url, self._say)
            self._say("viewer: a window opens")
        else:
            assert self._web_port is not None
            self._page = processes.Page(self._web_port, self.url, self._say)
            self._say(f"viewer: {self._why}open {self.page_url}{self._from_afar()}")
        if self._live:
            self._pace = Pace(recording, self._say)
        world = world_of(recording, several, live=self._live, window=self._window)
        return list(sinks_of(world, several, pace=self._pace))

    def close(self) -> None:
        """Hand over what is under way and end the server; a window stays, with what it has got."""
        recording, self._recording = self._recording, None
        if self._pace is not None:
            self._pace.end()
        if recording is not None:
            done = threading.Event()
            threading.Thread(target=_hand_over, args=(recording, done), daemon=True).start()
            if not done.wait(_END_S):  # a viewer that reads too slowly is not waited for
                rr.unregister_shutdown()  # which would wait for it, too
        if self._page is not None:
            self._page.close()
            self._page = None

    def _from_afar(self) -> str:
        if not os.environ.get("SSH_CONNECTION"):
            return ""
        tunnels = " ".join(f"-L {port}:{_HOST}:{port}" for port in (self._web_port, self._port))
        return f" (from your own machine: ssh {tunnels} …)"


def _hand_over(recording: rr.RecordingStream, done: threading.Event) -> None:
    """Let viewers have what is under way, and end the server; for as long as one of them reads slowly, it goes on."""
    with contextlib.suppress(Exception):  # by rerun, where it took too long; the next call waits for it
        recording.flush(timeout_sec=_FLUSH_S)
    time.sleep(_LAST_LOOK_S)
    recording.disconnect()
    done.set()
