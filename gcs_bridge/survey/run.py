"""A survey, from what is named to the dataset: what was judged is not judged again, what fails is tried once more."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from dataclasses import replace as replaced
from typing import Protocol

from gcs_bridge.errors import SourceError, UsageError, one_line
from gcs_bridge.executors.base import Executor, Outcome
from gcs_bridge.survey.dataset import Dataset, codes_of
from gcs_bridge.survey.found import Candidate, is_url
from gcs_bridge.survey.task import Asked, Result, Task, survey_one

__all__ = ["Ran", "Watch", "survey"]


@dataclass
class Ran:
    """What a survey did."""

    judged: int = 0
    known: int = 0
    """Files that were judged before, and have not changed."""
    copies: int = 0
    """Recordings whose content was judged under another name, or at another time."""
    retried: int = 0
    bytes: int = 0
    """Of what was judged."""
    failures: list[str] = field(default_factory=list)
    codes: set[str] = field(default_factory=set)
    """What came of all recordings that were named, those judged before included."""


class Watch(Protocol):
    """Is told how far it is."""

    def planned(self, files: int, size: int) -> None:
        """So many files more are to be judged, with so many bytes."""

    def done(self, ran: Ran, size: int) -> None:
        """A file of that size is done, however it ended."""


def survey(
    found: Iterable[Candidate | SourceError], dataset: Dataset, asked: Asked, executor: Executor, watch: Watch
) -> Ran:
    """Judge what is found and not in the dataset yet.

    UsageError where the dataset cannot be written, or nothing of what is asked for can be done: what was judged by then
    is kept.
    """
    run = _Run(dataset, asked, watch)
    run.plan(found)
    for is_last in (False, True):
        while run.waiting:  # what lies in archives is added meanwhile
            for outcome in executor.run(survey_one, run.tasks()):
                run.take(outcome, is_last=is_last)
        run.waiting, run.failed = deque(run.failed), []
        if not run.waiting:
            break
        run.ran.retried = len(run.waiting)
    return run.ran


class _Run:
    """What is known while it goes on."""

    def __init__(self, dataset: Dataset, asked: Asked, watch: Watch) -> None:
        self.ran = Ran()
        self.waiting: deque[Task] = deque()
        self.failed: list[Task] = []
        self._dataset, self._asked, self._watch = dataset, asked, watch

    def plan(self, found: Iterable[Candidate | SourceError]) -> None:
        """Find out what is to be done."""
        for one in found:
            if isinstance(one, SourceError):
                self.ran.failures.append(one_line(str(one)))
                continue
            codes = self._dataset.codes(one)
            if codes is not None:
                self.ran.known += 1
                self.ran.codes |= codes
                continue
            before = "" if one.stamp or not is_url(one.path) else self._dataset.stamp(one.path)
            self.waiting.append(Task(asked=self._asked, path=one.path, size=one.size, stamp=one.stamp, before=before))
            self._watch.planned(1, one.size or 0)

    def tasks(self) -> Iterator[Task]:
        """Each once, with what is known by then."""
        while self.waiting:
            task = self.waiting.popleft()
            yield replaced(task, known=self._dataset.known(task.size))

    def take(self, outcome: Outcome[Task, Result], *, is_last: bool) -> None:
        """Keep what came of a task."""
        task, result = outcome.task, outcome.result
        if result is None:
            result = Result(failure=one_line(f"{task.path}: not judged: {outcome.lost}"))
        if result.stop is not None:
            raise UsageError(result.stop)
        if result.inside:
            parts = task.parts(result.inside, result.content)
            self._watch.planned(len(parts) - 1, 0)
            for part, judged in zip(parts, result.parts, strict=False):
                self.take(Outcome(part, judged), is_last=is_last)
            self.waiting.extend(() if result.parts else parts)
            return
        if result.failure is not None and not is_last:
            self.failed.append(task)
            return
        if result.failure is not None:
            self.ran.failures.append(result.failure)
        elif result.unchanged:
            self.ran.known += 1
            self.ran.codes |= self._dataset.codes_of_file(task.path)
        elif result.known is not None:
            self.ran.copies += 1
            self.ran.codes |= self._dataset.codes_of_content(result.known)
        elif result.recording is not None:
            row = result.recording
            self.ran.codes |= codes_of(row["verdict"], compared=row["compared"])
            if self._dataset.add(result):
                self.ran.judged += 1
                self.ran.bytes += result.bytes
            else:
                self.ran.copies += 1
        self._watch.done(self.ran, (task.size or result.bytes) // task.of)
