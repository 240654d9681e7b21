"""Serves the web viewer's page of a program that it runs, so that it asks no other machine for anything.

The page of rerun (0.41) asks Google for a font and GitHub for news, and reports its use to its makers, whatever the
environment says. So it is handed on with a policy by which the browser asks this machine alone, and without its links
to others. It ends with who started it, even if that is killed: it runs while standard input is open.

A script of its own, without an import of ours: `python page_server.py PORT OTHER_PORT PROGRAM ARGUMENT…`, where the
program serves the page at OTHER_PORT.
"""

from __future__ import annotations

import contextlib
import http.client
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

_HOST = "127.0.0.1"
_HERE = "'self' data: blob: http://127.0.0.1:* http://localhost:*"
_POLICY = (
    f"default-src {_HERE}; script-src 'self' blob: 'unsafe-inline' 'wasm-unsafe-eval'; "
    "style-src 'self' 'unsafe-inline'; frame-ancestors 'none'; form-action 'none'"
)
_KEPT = ("Content-Type", "Content-Length", "rerun-final-length")  # of the headers; the last one is for its progress bar
_LINKS = re.compile(rb"<link\b[^>]*\bhref=\"https?://[^>]*>")  # a policy does not keep browsers from connecting ahead
_PATIENCE_S = 20.0  # so long the program may take to start
_AGAIN_S = 0.1


class _Handler(BaseHTTPRequestHandler):
    """Hands on what the program answers."""

    protocol_version = "HTTP/1.1"
    other_port: int

    def do_GET(self) -> None:
        """A file of the page."""
        with contextlib.closing(self._asked()) as connection:
            connection.request("GET", self.path)
            answer = connection.getresponse()
            headers = {name: value for name in _KEPT if (value := answer.getheader(name)) is not None}
            page = None
            if headers.get("Content-Type", "").startswith("text/html"):
                page = _LINKS.sub(b"", answer.read())
                headers["Content-Length"] = str(len(page))
            self.send_response(answer.status)
            for name, value in headers.items():
                self.send_header(name, value)
            self.send_header("Content-Security-Policy", _POLICY)
            self.send_header("X-DNS-Prefetch-Control", "off")
            if "Content-Length" not in headers:
                self.send_header("Connection", "close")
            self.end_headers()
            if page is not None:
                self.wfile.write(page)
            else:
                shutil.copyfileobj(answer, self.wfile)

    def _asked(self) -> http.client.HTTPConnection:
        ends_s = time.monotonic() + _PATIENCE_S
        while True:
            connection = http.client.HTTPConnection(_HOST, self.other_port, timeout=_PATIENCE_S)
            try:
                connection.connect()
            except OSError:
                if time.monotonic() > ends_s:
                    raise
                time.sleep(_AGAIN_S)
            else:
                return connection

    def log_message(self, *_: object) -> None:
        """Nobody reads it."""


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, *_: object) -> None:
        """A browser that has gone is no error."""


def main(port: int, other_port: int, command: list[str]) -> int:
    """Run it; its exit code."""
    handler = type("Handler", (_Handler,), {"other_port": other_port})
    server = _Server((_HOST, port), handler)
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL)  # noqa: S603  # what processes.py gives

    def end_with_input() -> None:
        while os.read(0, 4096):
            pass
        if hasattr(os, "killpg"):
            os.killpg(0, signal.SIGTERM)  # the program, what it started, and this one: a group of their own
        process.terminate()

    for work in (end_with_input, server.serve_forever):
        threading.Thread(target=work, daemon=True).start()
    return process.wait()


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:]))
