"""`gcs-bridge listen`: judges live links, and tells what happens as it happens."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from gcs_bridge.cli.live_run import LiveOptions, LiveRun, live_options, refuse_not_positive
from gcs_bridge.errors import UsageError

if TYPE_CHECKING:  # loaded when there is a link to open
    from gcs_bridge.links.link import Link
    from gcs_bridge.links.uri import Uri

__all__ = ["listen"]


@click.command()
@click.argument("uris", nargs=-1, required=True, metavar="URI...")
@click.option("--baud", type=click.IntRange(min=1), default=115200, metavar="N", help="Of serial devices.  [115200]")
@click.option("--duration", "duration_s", type=float, metavar="S", help="End after S seconds.")
@live_options
def listen(uris: tuple[str, ...], baud: int, duration_s: float | None, **options: Any) -> int:
    """Listen on links, judge every vehicle on them, and tell what happens; nothing is ever sent.

    \b
    URIs: udpin:HOST:PORT    wait for datagrams there; udpin:[::]:14550 for IPv6 too
          tcp:HOST:PORT      connect to a server
          tcpin:HOST:PORT    wait for a client
          mcast:             a multicast group, 239.255.145.50:14550 unless another is named
          /dev/ttyACM0, COM3 a serial device, read at --baud

    A link that has gone is waited for, however long that takes, and opened again.
    Ctrl-C, SIGTERM or --duration end it; then a line a link sums up.

    \b
    Exit codes: 0 ended as asked, whatever was raised, 2 usage or configuration, or a file
    that could not be written to its end, 3 a link that cannot be opened at the start.
    """
    from gcs_bridge.links.uri import parse_uri

    refuse_not_positive("--duration", duration_s)
    parsed = [parse_uri(uri, baud=baud) for uri in uris]
    for twice in {str(uri) for uri in parsed if parsed.count(uri) > 1}:
        raise UsageError(f"{twice} is named twice")
    run = LiveRun(LiveOptions.of(options))

    def opener(uri: Uri) -> Callable[[], Link]:
        def opened() -> Link:
            from gcs_bridge.links.open import open_link

            return open_link(uri)

        return opened

    return run.run([opener(uri) for uri in parsed], title=", ".join(map(str, parsed)), duration_s=duration_s)
