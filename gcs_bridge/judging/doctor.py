"""The convention doctor is asked about each alarm that wants it: when it is raised, as it goes on, and when it goes.

An answer takes 5 to 70 ms, and rests on the frames up to that of its question, whenever it is given. Where the
doctor `waits`, as on live links, questions are kept until somebody has time: the news of many alarms at once waits for
no answer. None is left open once its alarm goes.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from gcs_bridge.alarms.manager import AlarmManager, AlarmTransition
from gcs_bridge.events import Notice
from gcs_bridge.judging.boot import Boot
from gcs_bridge.judging.diagnosis_cases import QUESTIONS
from gcs_bridge.telemetry.link_clock import LinkClock


class _Question(NamedTuple):
    """About the alarm `name`, by all up to a frame, with its times."""

    boot: Boot
    name: str
    frame_index: int
    t_boot_us: int
    t_rx_us: int


class Doctor:
    """Asked about the alarms of one vehicle."""

    def __init__(self, alarms: AlarmManager, *, waits: bool = False) -> None:
        """Tell the alarms what is found; where the doctor `waits`, only by `answer`."""
        self._alarms = alarms
        self._waits = waits
        self._open: deque[_Question] = deque()

    @property
    def is_asked(self) -> bool:
        """Whether a question is open."""
        return bool(self._open)

    def ask(self, boot: Boot, moment: AlarmTransition, link: LinkClock) -> Iterator[Notice]:
        """Ask the doctor about an alarm that is raised, or goes."""
        if not moment.spec.asks_doctor:
            return
        name = moment.record.id
        if moment.what == "raised":
            onset_us = moment.onset_us - round(moment.spec.onset_lead_s * 1e6)
            boot.asked[name] = moment.record
            boot.diagnosis_cases.open(name, onset_us, moment.t_boot_us)
            yield from self._ask(boot, name, moment.frame_index, moment.t_boot_us, link)
        elif name in boot.asked:
            for frame_index, t_boot_us in boot.diagnosis_cases.due(name, moment.frame_index):
                yield from self._ask(boot, name, frame_index, t_boot_us, link)
            if moment.what == "goes":
                yield from self.answer_all()
                boot.diagnosis_cases.close(name)
                del boot.asked[name]

    def ask_again(self, boot: Boot, link: LinkClock) -> Iterator[Notice]:
        """Ask about the alarms that stand, as far as that is due."""
        for name in list(boot.asked):
            for frame_index, t_boot_us in boot.diagnosis_cases.due(name):
                yield from self._ask(boot, name, frame_index, t_boot_us, link)

    def answer(self) -> Iterator[Notice]:
        """Answer the oldest question that is open, if any is."""
        if self._open:
            boot, name, frame_index, t_boot_us, t_rx_us = self._open.popleft()
            record = boot.asked[name]
            answer = boot.diagnosis_cases.ask(name, frame_index, t_boot_us, of=QUESTIONS.get(record.check, "forms"))
            if answer.entry is not None and answer.entry != record.diagnosis:
                yield from self._alarms.diagnosis(record, answer.entry, frame_index, t_boot_us, t_rx_us)

    def answer_all(self) -> Iterator[Notice]:
        """Answer every question that is open."""
        while self._open:
            yield from self.answer()

    def _ask(self, boot: Boot, name: str, frame_index: int, t_boot_us: int, link: LinkClock) -> Iterator[Notice]:
        self._open.append(_Question(boot, name, frame_index, t_boot_us, link.at(frame_index)))
        if not self._waits:
            yield from self.answer()
