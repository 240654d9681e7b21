"""How a recording that is to be gone on with ends: behind a whole record, or in the middle of one."""

from __future__ import annotations

from pathlib import Path

from gcs_bridge.errors import UsageError
from gcs_bridge.mavlink.dialect import load_dialect
from gcs_bridge.mavlink.scanner import Scanner

__all__ = ["cut_torn_record", "first_time_us"]
_LOOK = 2**16  # bytes at either end: some hundred records
_TIME = 8  # bytes before each frame
_HEADERS = {
    0xFD: (10, 2, 13),
    0xFE: (6, 2, 0),
}  # by the first byte: of header, checksum and, if there is one, signature
_SIGNED = 1  # in the third byte of version 2


def cut_torn_record(path: Path) -> None:
    """Cut off the record that whoever wrote the file had no time to finish, or no room; what is whole stays.

    UsageError for a file that is no recording, and that nothing of ours belongs into.
    """
    if not path.is_file() or not (size := path.stat().st_size):
        return
    try:
        with path.open("r+b") as file:
            start = max(size - _LOOK, 0)
            file.seek(start)
            tail = file.read()
            end = _last_frame_end(tail)
            if end is None:
                file.seek(0)
                if _last_frame_end(file.read(_LOOK)) is None:
                    raise UsageError(
                        f"cannot write {path}: it is no recording, and would not be one; choose another name"
                    )
            elif (whole := _whole(tail, end)) < len(tail):
                file.truncate(start + whole)
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror}") from None


def first_time_us(path: Path) -> int | None:
    """The receive time of the first record, µs since 1970; None where there is none, and of what is no file."""
    if not path.is_file():
        return None
    try:
        with path.open("rb") as file:
            time = file.read(_TIME)
    except OSError:
        return None
    return int.from_bytes(time, "big") if len(time) == _TIME else None


def _last_frame_end(data: bytes) -> int | None:
    """Where the last frame that can be told for one ends."""
    scanner = Scanner(load_dialect(), timed=True)
    scanner.scan(data, final=True)
    if not len(scanner.all_frames):
        return None
    last = int(scanner.all_frames["offset"][-1])
    return last + _frame_size(data[last:])


def _whole(tail: bytes, end: int) -> int:
    """Where the last whole record ends. What does not look like one, torn or not, is left where it is."""
    while end < len(tail):
        frame = tail[end + _TIME :]
        if frame and frame[0] not in _HEADERS:
            return len(tail)
        if len(frame) < 3 or len(frame) < (size := _frame_size(frame)):
            return end
        end += _TIME + size
    return end


def _frame_size(frame: bytes) -> int:
    header, checksum, signature = _HEADERS[frame[0]]
    return header + frame[1] + checksum + (signature if frame[2] & _SIGNED else 0)
