"""Judges recordings: each is fed to a Monitor, piece by piece; how anything is judged is not known here."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from gcs_bridge.chunks import Chunk
from gcs_bridge.contract import readable
from gcs_bridge.errors import UsageError
from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.judging.rating import Beside
from gcs_bridge.mavlink.signing import SigningKey, Unsigned
from gcs_bridge.recordings.ahead import ahead, other_thread
from gcs_bridge.recordings.open import open_recording
from gcs_bridge.report import Report
from gcs_bridge.report.schema import File
from gcs_bridge.settings import Settings, load_settings
from gcs_bridge.sinks.base import Sink, Sinks

Progress = Callable[[int, int], None]


def check(
    path: str | Path,
    profile: str = "default",
    *,
    settings: Settings | None = None,
    dialect: str = "all",
    sysid: int | None = None,
    from_s: float | None = None,
    to_s: float | None = None,
    signing_key: bytes | SigningKey | None = None,
    unsigned: Unsigned | None = None,
) -> Report:
    """Judge one recording; `report.to_dict()` is the contract's JSON. Key and `unsigned` as of a `Monitor`.

    With `sysid` that system alone; `from_s` and `to_s`, in seconds after the recording's start, are where it begins and
    ends. Raises SourceError where the file cannot be used, UsageError for an unknown profile or dialect, no key, or a
    `from_s` past the end.
    """
    asked = settings or load_settings(profile)
    selected: dict[str, Any] = {"dialect": dialect, "sysid": sysid, "from_s": from_s, "to_s": to_s}
    return Report.of([check_file(Path(path), asked, **selected, signing_key=signing_key, unsigned=unsigned)])


def check_file(
    path: Path,
    settings: Settings,
    *,
    dialect: str = "all",
    sysid: int | None = None,
    from_s: float | None = None,
    to_s: float | None = None,
    progress: Progress | None = None,
    sinks: Iterable[Sink] = (),
    signing_key: bytes | SigningKey | None = None,
    unsigned: Unsigned | None = None,
) -> File:
    """Judge one recording and return its entry in the report.

    `progress` is told bytes done and in all, `sinks` what is told while it is judged; key and `unsigned` are
    a `Monitor`'s. Raises SourceError where the
    file cannot be used, UsageError where `from_s` is past its end or the file has no times to select by.
    """
    taking = Sinks(sinks)
    with open_recording(path, dialect) as source, other_thread() as other:
        monitor = Monitor(
            settings=settings,
            dialect=dialect,
            sysid=sysid,
            from_s=from_s,
            to_s=to_s,
            observer=taking.observer,
            on_frames=taking.on_frames,
            signing_key=signing_key,
            unsigned=unsigned,
            beside=other,
        )
        if from_s is not None or to_s is not None:
            source.need_times("--from and --to cannot select by them")
        feed(source, monitor, taking, lambda done: None if progress is None else progress(done, source.size), other)
    return closing_entry(monitor, path, source.remarks)


def feed(
    chunks: Iterable[Chunk],
    monitor: Monitor,
    sinks: Sinks,
    after: Callable[[int], None],
    other: Beside | None = None,
) -> None:
    """Give `monitor` a recording to its end, and `sinks` what is told; `after` each chunk is told the bytes so far.

    `other` is the thread beside which it judges, if it does.
    """
    for done in steps(chunks, monitor, sinks, other):
        after(done)


def steps(chunks: Iterable[Chunk], monitor: Monitor, sinks: Sinks, other: Beside | None = None) -> Iterator[int]:
    """The same chunk by chunk, for who does something in between: each time the bytes so far."""
    for scan in ahead((monitor.scan([chunk]) for chunk in chunks), other):
        sinks.events(monitor.judge(scan))
        yield scan.scanned.done
    sinks.events(monitor.finish())


def closing_entry(monitor: Monitor, path: Path, remarks: Sequence[str] = ()) -> File:
    """The report's entry of a recording that has been fed to `monitor` as a whole, with `remarks` on how it came.

    Raises UsageError where nothing was recorded in the times to judge.
    """
    report = monitor.close()
    if monitor.window_is_empty:
        raise UsageError(f"{path}: nothing was recorded between --from and --to: {monitor.span_s:.1f} s in all")
    (entry,) = report.files
    salvage = replace(entry.salvage, remarks=(*entry.salvage.remarks, *remarks)) if remarks else entry.salvage
    return replace(entry, path=readable(str(path)), salvage=salvage)
