"""`gcs-bridge listen`: judges live links, and tells what happens as it happens."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gcs_bridge.cli.live_run import LiveOptions, LiveRun, LiveTask, live_options, refuse_not_positive
from gcs_bridge.cli.signing_options import key_of, signing_options
from gcs_bridge.errors import UsageError

if TYPE_CHECKING:  # loaded when there is a link to open
    from gcs_bridge.links.link import Link
    from gcs_bridge.links.uri import Uri
    from gcs_bridge.mavlink.signing import Unsigned

__all__ = ["listen"]


@click.command()
@click.argument("uris", nargs=-1, required=True, metavar="URI...")
@click.option("--baud", type=click.IntRange(min=1), default=115200, metavar="N", help="Of serial devices.  [115200]")
@click.option(
    "--relay",
    "relays",
    multiple=True,
    metavar="URI",
    help="Pass what comes on to a ground station: udpout:HOST:PORT or tcp:HOST:PORT (it waits there), tcpin:HOST:PORT "
    "or udpin:HOST:PORT (it comes here). Repeatable.",
)
@click.option("--relay-both-ways", "both_ways", is_flag=True, help="And what it answers to the vehicle. TRANSMITS.")
@click.option(
    "--request-rates", "rates_hz", type=float, metavar="HZ", help="Ask vehicles for what is compared. TRANSMITS."
)
@click.option("--statustext", "texts", is_flag=True, help="Say alarms to the operator's ground station. TRANSMITS.")
@click.option("--act-as-gcs", "as_gcs", is_flag=True, help="Send a ground station's heartbeats. TRANSMITS.")
@click.option(
    "--metrics",
    "metrics_port",
    type=click.IntRange(0, 65535),
    metavar="PORT",
    help="Serve metrics for Prometheus at 127.0.0.1:PORT; 0: at any that is free.",
)
@signing_options
@click.option("--duration", "duration_s", type=float, metavar="S", help="End after S seconds.")
@live_options
def listen(
    uris: tuple[str, ...],
    baud: int,
    relays: tuple[str, ...],
    both_ways: bool,
    rates_hz: float | None,
    texts: bool,
    as_gcs: bool,
    metrics_port: int | None,
    signing_key_file: Path | None,
    unsigned: Unsigned | None,
    duration_s: float | None,
    **options: Any,
) -> int:
    """Listen on links, judge every vehicle on them, and tell what happens.

    Nothing is ever sent to a vehicle, unless an option is given that says TRANSMITS.

    \b
    URIs: udpin:HOST:PORT    wait for datagrams there; udpin:[::]:14550 for IPv6 too
          tcp:HOST:PORT      connect to a server
          tcpin:HOST:PORT    wait for a client
          mcast:             a multicast group, 239.255.145.50:14550 unless another is named
          udpout:HOST:PORT   speak first; only with an option that TRANSMITS
          /dev/ttyACM0, COM3 a serial device, read at --baud

    A link that has gone is waited for, however long that takes, and opened again.
    Ctrl-C, SIGTERM or --duration end it; then a line a link sums up.

    \b
    Exit codes: 0 ended as asked, whatever was raised, 2 usage or configuration, or a file
    that could not be written to its end, 3 a link, or the port of --metrics, that cannot be
    opened at the start.
    """
    from gcs_bridge.links.uri import parse_uri
    from gcs_bridge.sending.asked import Asked
    from gcs_bridge.sending.outlets import parse_relay

    refuse_not_positive("--duration", duration_s)
    refuse_not_positive("--request-rates", rates_hz)
    asked = Asked(
        relays=tuple(map(parse_relay, relays)), both_ways=both_ways, rates_hz=rates_hz, texts=texts, as_gcs=as_gcs
    )
    parsed = [parse_uri(uri, baud=baud, may_send=asked.transmits) for uri in uris]
    asked.refuse_loops(parsed)
    for twice in {str(uri) for uri in parsed if parsed.count(uri) > 1}:
        raise UsageError(f"{twice} is named twice")
    signing_key = key_of(signing_key_file, unsigned)
    run = LiveRun(LiveOptions.of(options))

    def opener(uri: Uri) -> Callable[[], Link]:
        def opened() -> Link:
            from gcs_bridge.links.open import open_link

            return open_link(uri)

        return opened

    title = ", ".join(map(str, parsed))
    return run.run(
        LiveTask(
            openers=[opener(uri) for uri in parsed],
            title=title,
            duration_s=duration_s,
            asked=asked,
            metrics_port=metrics_port,
            signing_key=signing_key,
            unsigned=unsigned,
        )
    )
