"""The text of a scrape: byte for byte what Prometheus's library writes, also of what it has not written again."""

from collections.abc import Sequence

import pytest
from prometheus_client import CollectorRegistry
from prometheus_client.core import Metric
from prometheus_client.exposition import choose_encoder
from prometheus_client.registry import Collector

from gcs_bridge.metrics.families import FAMILIES, Family, Samples
from gcs_bridge.metrics.text import Encoder, Writer

UP = next(family for family in FAMILIES if family.name == "link_up")
FRAMES = next(family for family in FAMILIES if family.name == "frames_total")
ODD = Family("odd_total", ("link",), 'Help with "quotes",\na line end and \\')
ASKED = [
    "",
    "text/plain;version=0.0.4",
    "text/plain;version=1.0.0;escaping=allow-utf-8",
    "text/plain;version=1.0.0;escaping=values",
    "application/openmetrics-text;version=0.0.1,text/plain;version=0.0.4;q=0.5,*/*;q=0.1",
    "application/openmetrics-text;version=1.0.0;escaping=dots",
]
LINKS = [
    "udpin:0.0.0.0:14550",
    "",
    " ",
    "a b ",
    "#",
    'q"q',
    "back\\slash",
    "line\nend",
    "\r",
    "\x85\u2028",
    "ä→",
    "} 7",
]
VALUES = [0, 1, True, 0.5, 1e-9, -3.0, 999_999.0, 1_000_000.0, 123_456_789, 1e21]


class Written(Collector):
    """The library's own metrics of the same samples."""

    def __init__(self, scraped: Sequence[Samples]) -> None:
        self._scraped = scraped

    def collect(self) -> list[Metric]:
        return [samples.as_metric() for samples in self._scraped]


def assert_written(writer: Writer, encoder: Encoder, *scraped: Samples) -> None:
    assert writer.text(scraped, CollectorRegistry()) == encoder(Written(scraped))


@pytest.mark.parametrize("asked", ASKED)
def test_as_the_library_writes_it(asked: str) -> None:
    """In every form, at first and again: the same series, others, fewer, more, none, and other numbers."""
    encoder, _ = choose_encoder(asked)
    writer = Writer(encoder)
    for shift in range(len(VALUES)):
        values = VALUES[shift:] + VALUES[:shift]
        up = [((link,), value) for link, value in zip(LINKS, values * 2, strict=False)]
        frames = [((link, f"{shift}.1"), value) for link, value in zip(LINKS[shift:], values, strict=False)]
        assert_written(writer, encoder, Samples(UP, up), Samples(ODD, up[:shift]), Samples(FRAMES, frames))
        assert_written(writer, encoder, Samples(FRAMES, frames[::-1]), Samples(UP, []))
        assert_written(writer, encoder)


def test_the_library_writes_a_series_once() -> None:
    """Not again when it has another number, nor when it was gone meanwhile."""
    encoder, _ = choose_encoder("")
    asked: list[Metric] = []

    def counting(registry: Collector) -> bytes:
        asked.extend(registry.collect())
        return encoder(registry)

    writer = Writer(counting)
    for value, links in enumerate([LINKS[:2], LINKS[:1], LINKS[:2], LINKS[1::-1]]):
        writer.text([Samples(UP, [((link,), value) for link in links])], CollectorRegistry())
    assert len(asked) == 1
    writer.text([Samples(UP, [((LINKS[3],), 1)])], CollectorRegistry())
    assert len(asked) == 2


def test_what_the_library_knows_itself_follows() -> None:
    """Its own metrics stand behind, and a form that has an end has it once."""
    encoder, _ = choose_encoder("application/openmetrics-text;version=1.0.0")
    scraped = [Samples(UP, [(("a",), 1)])]
    others = Written([Samples(ODD, [(("b",), 2)])])
    both = Written([*scraped, Samples(ODD, [(("b",), 2)])])
    assert Writer(encoder).text(scraped, others) == encoder(both)
