"""What somebody has asked for that sends, and what may not be asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gcs_bridge.errors import UsageError
from gcs_bridge.links.uri import NetworkUri, Uri
from gcs_bridge.sending.loops import refuse_loop

__all__ = ["Asked"]


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What somebody has asked for that sends."""

    relays: tuple[NetworkUri, ...] = ()
    both_ways: bool = False
    rates_hz: float | None = None
    texts: bool = False
    as_gcs: bool = False

    def __post_init__(self) -> None:
        """Refuse what cannot be meant."""
        if self.both_ways and not self.relays:
            raise UsageError("--relay-both-ways: there is no --relay whose answers could go back")

    @property
    def anything(self) -> bool:
        """Whether a station is needed at all."""
        return bool(self.relays) or self.transmits

    @property
    def transmits(self) -> bool:
        """Whether anything may be sent to the links that are listened to: a relay alone sends nothing there."""
        return self.both_ways or self.rates_hz is not None or self.texts or self.as_gcs

    def refuse_loops(self, links: Sequence[Uri]) -> None:
        """UsageError for a relay that would lead back here."""
        for relay in self.relays:
            if self.relays.count(relay) > 1:
                raise UsageError(f"relay {relay} is named twice")
            refuse_loop(relay, links)

    def warnings(self) -> list[str]:
        """What people must know before it begins."""
        said = []
        if self.as_gcs:
            said.append(
                "--act-as-gcs: this program sends the heartbeats of a ground station. A vehicle may take them for its "
                "own ground station's: the failsafe for a lost link then stays silent although that has gone, and it "
                "may begin when this program ends"
            )
        if self.both_ways:
            said.append(
                "--relay-both-ways: whatever a station on the relay sends reaches the vehicle, commands and the "
                "heartbeats that its failsafe watches included"
            )
        return said
