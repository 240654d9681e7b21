"""What is scraped, as Prometheus's library writes it: of each series it writes name and labels once, then only numbers.

Names and labels make up nine tenths of a text, are dear to write, and are the same each time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from prometheus_client.core import Metric
from prometheus_client.registry import Collector
from prometheus_client.utils import floatToGoString

from gcs_bridge.metrics.families import Family, Labels, Samples

__all__ = ["Encoder", "Writer"]

Encoder = Callable[[Collector], bytes]
"""Of the library: it writes one of the forms of text that may be asked for."""
_as_text: Callable[[float], str] = floatToGoString  # the library does not say its type


class Writer:
    """Writes what an encoder would, and remembers every series that it has written; used by one thread at a time."""

    def __init__(self, encoder: Encoder) -> None:
        """Start with nothing written."""
        self._encoder = encoder
        self._end = encoder(_Metrics()).decode()  # of every text, in some forms
        self._heads: dict[Family, str] = {}
        self._starts: dict[Family, dict[Labels, str]] = {}  # of the lines, up to their values

    def text(self, scraped: Iterable[Samples], others: Collector) -> bytes:
        """The text of a scrape, and after it what the library knows of `others`."""
        parts: list[str] = []
        for samples in scraped:
            starts = self._starts.setdefault(samples.family, {})
            unknown = [row for row in samples.rows if row[0] not in starts]
            if unknown or samples.family not in self._heads:
                self._learn(Samples(samples.family, unknown))
            parts.append(self._heads[samples.family])
            parts += [f"{starts[labels]} {_as_text(value)}\n" for labels, value in samples.rows]
        return "".join(parts).encode() + self._encoder(others)

    def _learn(self, samples: Samples) -> None:
        """Have the library write a family, and see how it begins, and each of its lines."""
        text = self._encoder(_Metrics(samples.as_metric())).decode().removesuffix(self._end)
        lines = text.removesuffix("\n").split("\n")  # no splitlines: labels may hold what else ends a line
        heads = [line for line in lines if line.startswith("#")]
        self._heads[samples.family] = "".join(f"{line}\n" for line in heads)
        for (labels, _), line in zip(samples.rows, lines[len(heads) :], strict=True):
            self._starts[samples.family][labels] = line.rpartition(" ")[0]


class _Metrics(Collector):
    """What an encoder is given."""

    def __init__(self, *metrics: Metric) -> None:
        self._metrics = metrics

    def collect(self) -> Iterable[Metric]:
        return self._metrics
