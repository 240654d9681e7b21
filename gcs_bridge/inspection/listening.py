"""Listens to links for a while, or reads recordings, for an examination."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

from msgspec import UNSET

from gcs_bridge.contract import readable
from gcs_bridge.errors import SourceError
from gcs_bridge.events import Event
from gcs_bridge.inspection.heard import RECORDING, STREAM, Heard, Refused
from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.links.link import DatagramLink, Link
from gcs_bridge.links.loop import listen
from gcs_bridge.links.open import open_link
from gcs_bridge.links.uri import SerialUri, Uri
from gcs_bridge.mavlink.signing import SigningKey, Unsigned
from gcs_bridge.recordings.ahead import ahead
from gcs_bridge.recordings.open import open_recording
from gcs_bridge.settings import Settings

__all__ = ["listen_to", "read"]
_SYSTEMS = range(1, 256)


def read(
    path: Path,
    settings: Settings,
    dialect: str,
    progress: Callable[[int, int], None],
    *,
    signing_key: SigningKey | None = None,
) -> Heard | Refused:
    """A recording, to its end; `progress` is told bytes done and in all."""
    name = readable(str(path))
    told: list[Event] = []
    monitor = _monitor(settings, dialect, signing_key)

    try:
        with open_recording(path, dialect) as source:
            kind = RECORDING if source.timed else STREAM
            for scanned in ahead(monitor.scan([chunk]) for chunk in source):
                told += monitor.judge(scanned)
                progress(scanned.scanned.done, source.size)
            told += monitor.finish()
    except SourceError as error:
        return Refused(name=name, kind=RECORDING, error=error)
    report = monitor.close()
    (counted,) = monitor.censuses()
    return Heard(name=name, kind=kind, typed=name, entry=report.files[0], counted=counted, events=told)


def listen_to(
    uris: Sequence[Uri],
    settings: Settings,
    dialect: str,
    *,
    duration_s: float,
    stop: Callable[[], bool],
    note: Callable[[str], None],
    signing_key: SigningKey | None = None,
) -> list[Heard | Refused]:
    """Links, for `duration_s` or until `stop` says so, all at once; nothing is sent."""
    opened: list[Link] = []
    numbers: dict[int, int] = {}  # of those that could be opened, by their place
    found: list[Heard | Refused | None] = []
    try:
        for place, uri in enumerate(uris):
            try:
                link = open_link(uri)
            except SourceError as error:
                found.append(Refused(name=str(uri), kind=uri.kind, error=error))
                continue
            if isinstance(link, DatagramLink):
                link.remember_senders()
            numbers[place] = len(opened)
            opened.append(link)
            found.append(None)
        monitor = _monitor(settings, dialect, signing_key)
        told: list[Event] = []
        since_s = time.monotonic()
        if opened:
            listen(opened, monitor, told.extend, stop=stop, duration_s=duration_s, note=note)
        seconds = time.monotonic() - since_s
    finally:
        for link in opened:
            link.close()
    entries, counted = monitor.close().files, monitor.censuses()
    for place, number in numbers.items():
        uri, link = uris[place], opened[number]
        found[place] = Heard(
            name=str(uri),
            kind=uri.kind,
            typed=f"{uri.device} --baud {uri.baud}" if isinstance(uri, SerialUri) else str(uri),
            entry=entries[number],
            counted=counted[number],
            events=[event for event in told if _is_of(event, number, str(uri))],
            seconds=seconds,
            unreadable=link.unreadable,
            baud=uri.baud if isinstance(uri, SerialUri) else None,
            addresses=_addresses(link),
        )
    return [one for one in found if one is not None]


def _monitor(settings: Settings, dialect: str, signing_key: SigningKey | None) -> Monitor:
    """One that counts; whatever signatures come to, no frame is left out."""
    unsigned: Unsigned | None = None if signing_key is None else "accept"
    return Monitor(settings=settings, dialect=dialect, census=True, signing_key=signing_key, unsigned=unsigned)


def _is_of(event: Event, number: int, name: str) -> bool:
    """Whether an event is of a link or of a vehicle on it; of the first one's vehicles none is named."""
    return event.link in (number, name) or (event.link is UNSET and number == 0)


def _addresses(link: Link) -> dict[int, list[tuple[str, int]]]:
    """By system, whence its datagrams came."""
    if not isinstance(link, DatagramLink):
        return {}
    return {system: found for system in _SYSTEMS if (found := link.addresses_of(system))}
