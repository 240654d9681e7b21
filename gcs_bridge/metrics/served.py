"""The port at which Prometheus reads: http://127.0.0.1:PORT/metrics. Nothing but the address of this machine is served.

HTTP is the standard library's, the text is as prometheus_client writes it; each scrape is answered by a thread of its
own, which asks the loop for what is known now. If the loop does not answer, neither does the scrape: then `up` is 0.
"""

from __future__ import annotations

import errno
import os
import socketserver
import sys
from collections.abc import Callable, Iterable, Sequence
from http import HTTPStatus
from threading import Lock, Thread
from typing import TYPE_CHECKING, Any, Protocol
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer

from prometheus_client import CollectorRegistry, ProcessCollector, make_wsgi_app
from prometheus_client.exposition import choose_encoder

from gcs_bridge.errors import SourceError
from gcs_bridge.events import AlarmRaised, Event, vehicle_of
from gcs_bridge.links.port_owner import port_owner
from gcs_bridge.metrics.families import SnapshotCollector
from gcs_bridge.metrics.published import Exchange, Published, Raised
from gcs_bridge.metrics.text import Writer
from gcs_bridge.sinks.base import Sink

if TYPE_CHECKING:
    from gcs_bridge.judging.snapshot import Snapshot

__all__ = ["MOST_VEHICLES", "MetricsServer"]

MOST_VEHICLES = 64  # of a link that have series: whoever comes first. Senders can be made up by the ten thousand
_HOST = "127.0.0.1"
_MOST_FORMS = 4  # of the text are remembered: a server asks for one, again and again
_IDLE_S = 10.0  # so long a connection may say nothing
_POLL_S = 0.5  # so soon it ends when it is asked to
_FIRST_FREE_PORT = 1024

_Start = Callable[..., Any]  # as WSGI has them
_Environ = dict[str, Any]


class Watched(Protocol):
    """What can be looked at: a Monitor, which only the loop's thread may touch."""

    def snapshot(self, *, most_vehicles: int | None = None) -> Snapshot:
        """What is known now."""


class MetricsServer(Sink):
    """Serves what is known of a live run. A sink, as it counts alarms; and an errand of the loop, which publishes."""

    def __init__(self, port: int, links: Sequence[str]) -> None:
        """Serve at `port`, 0: any that is free; SourceError where that cannot be. `links`: their names, by number."""
        self._exchange = Exchange()
        self._raises: dict[Raised, int] = {}
        self._take: Callable[[], Published] | None = None
        self._collector = SnapshotCollector(links)
        self._writers: dict[str, Writer] = {}  # by the type of what they write
        self._collecting = Lock()  # among scrapes; the loop never takes it
        self._process = CollectorRegistry()  # what this process uses
        ProcessCollector(registry=self._process)
        self._no_scrape = make_wsgi_app(self._process)
        try:
            self._server = _Server((_HOST, port), _Handler)
        except OSError as error:
            raise SourceError(f"--metrics {port}: {_reason(port, error)}") from None
        self._server.set_app(self._answer)
        self._thread = Thread(target=self._server.serve_forever, args=(_POLL_S,), name="metrics", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """Where it is read."""
        return f"http://{_HOST}:{self._server.server_port}/metrics"

    def follow(self, monitor: Watched) -> None:
        """Publish what this one knows."""
        self._take = lambda: Published(monitor.snapshot(most_vehicles=MOST_VEHICLES), dict(self._raises))

    def events(self, events: Sequence[Event]) -> None:
        """Count what was raised: between two scrapes an alarm can come and go."""
        for event in events:
            if isinstance(event, AlarmRaised):
                raised = Raised(vehicle_of(event), event.check or "", event.severity)
                self._raises[raised] = self._raises.get(raised, 0) + 1

    def descriptors(self) -> Sequence[int]:
        """None to wait on: who scrapes can wait until the loop comes round."""
        return ()

    def run(self) -> None:
        """The loop has come round: give what is known to whoever waits for it."""
        if self._take is not None:
            self._exchange.give(self._take)

    def close(self) -> None:
        """Give the port back."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def _answer(self, environ: _Environ, start: _Start) -> Iterable[bytes]:
        """One request, in a thread of its own."""
        if environ["REQUEST_METHOD"] != "GET" or environ["PATH_INFO"] == "/favicon.ico":
            others: Iterable[bytes] = self._no_scrape(environ, start)
            return others
        published = self._exchange.get()
        if published is None:
            start("503 Service Unavailable", [("Content-Type", "text/plain; charset=utf-8")])
            return [b"gcs-bridge is busy, starts or ends: nothing is known right now\n"]
        # It is not compressed: within one machine nothing is gained by that, and it costs more than writing it.
        with self._collecting:
            text, content_type = self._written(published, environ.get("HTTP_ACCEPT", ""))
        start("200 OK", [("Content-Type", content_type)])
        return [text]

    def _written(self, published: Published, accept: str) -> tuple[bytes, str]:
        """What is known, in the form that is asked for, and the type of that."""
        encoder, content_type = choose_encoder(accept)
        writer = self._writers.get(content_type)
        if writer is None:
            if len(self._writers) >= _MOST_FORMS:
                self._writers.clear()
            writer = self._writers[content_type] = Writer(encoder)
        return writer.text(self._collector.collect(published), self._process), content_type


class _Server(socketserver.ThreadingMixIn, WSGIServer):
    daemon_threads = True
    allow_reuse_address = os.name == "posix"  # elsewhere that would let two programs have one port

    def server_bind(self) -> None:
        """As the standard library's, but for asking the network what this machine is called: that can take seconds."""
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = _HOST, self.server_address[1]
        self.setup_environ()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Somebody who went before the answer came is no mistake."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


class _Handler(WSGIRequestHandler):
    timeout = _IDLE_S

    def parse_request(self) -> bool:
        """As the library's, but that noise, which it takes for HTTP 0.9, is refused: that has no headers."""
        if not super().parse_request():
            return False
        if self.request_version == "HTTP/0.9":
            self.send_error(HTTPStatus.BAD_REQUEST)
            return False
        return True

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002  # as the library calls it
        """Nothing: a scrape is no news."""


def _reason(port: int, error: OSError) -> str:
    if error.errno == errno.EADDRINUSE:
        owner = port_owner(port, "tcp")
        return f"port {port} is in use{f' by {owner}' if owner else ''}: end that program, or name another port"
    if error.errno in (errno.EACCES, errno.EPERM) and port < _FIRST_FREE_PORT:
        return f"permission refused: port {port} needs an administrator; choose one above {_FIRST_FREE_PORT - 1}"
    return (error.strerror or str(error)).lower()
