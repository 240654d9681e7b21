"""The convention doctor is asked about each alarm that wants it: when it is raised, as it goes on, and when it goes."""

from __future__ import annotations

from collections.abc import Iterator

from gcs_bridge.alarms.manager import AlarmManager, AlarmTransition
from gcs_bridge.events import Notice
from gcs_bridge.judging.boot import Boot
from gcs_bridge.judging.diagnosis_cases import QUESTIONS
from gcs_bridge.telemetry.link_clock import LinkClock


class Doctor:
    """Asked about the alarms of one vehicle."""

    def __init__(self, alarms: AlarmManager) -> None:
        """Tell the alarms what is found."""
        self._alarms = alarms

    def ask(self, boot: Boot, moment: AlarmTransition, link: LinkClock) -> Iterator[Notice]:
        """Ask the doctor about an alarm that is raised, or goes."""
        if not moment.spec.asks_doctor:
            return
        name = moment.record.id
        if moment.what == "raised":
            onset_us = moment.onset_us - round(moment.spec.onset_lead_s * 1e6)
            boot.asked[name] = moment.record
            boot.diagnosis_cases.open(name, onset_us, moment.t_boot_us)
            yield from self._answer(boot, name, moment.frame_index, moment.t_boot_us, link)
        elif name in boot.asked:
            for frame_index, t_boot_us in boot.diagnosis_cases.due(name, moment.frame_index):
                yield from self._answer(boot, name, frame_index, t_boot_us, link)
            if moment.what == "goes":
                boot.diagnosis_cases.close(name)
                del boot.asked[name]

    def ask_again(self, boot: Boot, link: LinkClock) -> Iterator[Notice]:
        """Ask about the alarms that stand, as far as that is due."""
        for name in list(boot.asked):
            for frame_index, t_boot_us in boot.diagnosis_cases.due(name):
                yield from self._answer(boot, name, frame_index, t_boot_us, link)

    def _answer(self, boot: Boot, name: str, frame_index: int, t_boot_us: int, link: LinkClock) -> Iterator[Notice]:
        record = boot.asked[name]
        answer = boot.diagnosis_cases.ask(name, frame_index, t_boot_us, of=QUESTIONS.get(record.check, "forms"))
        if answer.entry is not None and answer.entry != record.diagnosis:
            yield from self._alarms.diagnosis(record, answer.entry, frame_index, t_boot_us, link.at(frame_index))
