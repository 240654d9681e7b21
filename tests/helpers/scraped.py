"""What Prometheus's text says, read by its own library's parser."""

from collections.abc import Iterator

from prometheus_client.parser import text_string_to_metric_families

Labels = dict[str, str]
PREFIX = "gcs_bridge_"


class Scraped:
    """One scrape: samples by name, without the prefix, and labels."""

    def __init__(self, text: str) -> None:
        self.samples: list[tuple[str, Labels, float]] = []
        self.kinds: dict[str, str] = {}
        for family in text_string_to_metric_families(text):
            for sample in family.samples:
                name = sample.name.removeprefix(PREFIX)
                self.kinds[name] = family.type
                self.samples.append((name, dict(sample.labels), sample.value))

    def all(self, name: str, **labels: str) -> list[tuple[Labels, float]]:
        """The samples of a family that have these labels, those with others too."""
        return [(own, value) for found, own, value in self.samples if found == name and labels.items() <= own.items()]

    def one(self, name: str, **labels: str) -> float:
        """The only one of them."""
        ((_, value),) = self.all(name, **labels)
        return value

    def state(self, check: str, vehicle: str = "1.1", **labels: str) -> str:
        """The one state that a check of a vehicle is in."""
        rows = self.all("alarm_state", check=check, vehicle=vehicle, **labels)
        assert sorted(value for _, value in rows) == [0.0] * (len(rows) - 1) + [1.0]
        return next(own["state"] for own, value in rows if value)

    def counters(self) -> Iterator[tuple[tuple[str, frozenset[tuple[str, str]]], float]]:
        """All counters of the bridge's own, by name and labels."""
        for name, labels, value in self.samples:
            if self.kinds[name] == "counter" and not name.startswith("process_"):
                yield (name, frozenset(labels.items())), value


def assert_counters_went_on(before: Scraped, after: Scraped) -> None:
    """No counter has gone, and none has gone back."""
    then, now = dict(before.counters()), dict(after.counters())
    assert then
    assert {key: value for key, value in then.items() if now.get(key, -1.0) < value} == {}
