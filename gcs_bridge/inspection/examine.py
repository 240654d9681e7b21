"""What was heard on some links → what the doctor tells of them, and its exit code."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from gcs_bridge._version import __version__
from gcs_bridge.contract import readable
from gcs_bridge.inspection.advice import LEVELS, advice, refusal
from gcs_bridge.inspection.entries import stations, vehicles
from gcs_bridge.inspection.heard import Heard, Refused
from gcs_bridge.inspection.machine import machine
from gcs_bridge.inspection.schema import SCHEMA, Advice, Examination, Finding, LinkFound, Station, Vehicle

__all__ = ["EXIT_CODES", "examine"]
EXIT_CODES: dict[Finding, int] = {"unusable": 3, "wrong": 1, "missing": 4, "good": 0}
"""What an examination ends with, worst first."""


def examine(found: Iterable[Heard | Refused]) -> Examination:
    """Put together what was heard; without any link, what there is to say of this machine."""
    links: list[LinkFound] = []
    flying: list[Vehicle] = []
    others: list[Station] = []
    told: list[Advice] = []
    for one in found:
        if isinstance(one, Refused):
            said = [refusal(one)]
            links.append(_refused(one))
        else:
            here, beside = vehicles(one), stations(one)
            said = advice(one, here, beside)
            links.append(_link(one, said))
            flying += here
            others += beside
        told += said
    return Examination(
        schema=SCHEMA,
        version=__version__,
        finding=next((worst for worst in EXIT_CODES if any(link.finding == worst for link in links)), "good"),
        links=tuple(links),
        vehicles=tuple(flying),
        stations=tuple(others),
        advice=tuple(sorted(told, key=lambda one: LEVELS.index(one.level))),
        machine=machine(),
    )


def _finding(said: Sequence[Advice]) -> Finding:
    levels = {one.level for one in said}
    return next((finding for finding in EXIT_CODES if finding in levels), "good")


def _link(heard: Heard, said: Sequence[Advice]) -> LinkFound:
    salvage, seconds = heard.entry.salvage, heard.seconds
    if seconds is None and heard.counted.latest_rx_us >= 0:
        seconds = heard.counted.span_us / 1e6
    return LinkFound(
        name=readable(heard.name),
        kind=heard.kind,
        finding=_finding(said),
        seconds=seconds,
        bytes=heard.entry.bytes,
        frames=salvage.frames,
        frames_per_s=salvage.frames / seconds if seconds else None,
        bad_crc=salvage.bad_crc,
        unverified=salvage.unverified,
        skipped_bytes=salvage.skipped_bytes,
        duplicates=salvage.duplicates,
        signed=salvage.signed,
    )


def _refused(refused: Refused) -> LinkFound:
    return LinkFound(
        name=readable(refused.name),
        kind=refused.kind,
        finding="unusable",
        seconds=None,
        bytes=0,
        frames=0,
        frames_per_s=None,
        bad_crc=0,
        unverified=0,
        skipped_bytes=0,
        duplicates=0,
        signed=0,
    )
