"""What workers do in the tests of executors: it must be importable in their processes."""

import os
import signal
import time
from pathlib import Path
from typing import Any

DEADLY = -1


def squared(number: int) -> int:
    """A number's square; DEADLY ends the process as want of memory does."""
    if number == DEADLY:
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number


def pid_of(_: int) -> int:
    """Which process it was."""
    return os.getpid()


def begin_and_wait(file: str) -> None:
    """Write this process's id into a file, and never be done."""
    whole = Path(file)
    whole.with_suffix(".part").write_text(str(os.getpid()))
    whole.with_suffix(".part").replace(whole)
    time.sleep(600)


def begin_or_square(task: str) -> int | None:
    """One that is never done, or, of a number, one that is done at once."""
    if task.isdigit():
        return squared(int(task))
    begin_and_wait(task)
    return None


def die_at(numbered: Any) -> Any:
    """Judge a recording as `check` does, but for the one of this name, at which the process dies."""
    from gcs_bridge.cli.check_run import _judged_there

    if numbered.task.recording.name == "1.tlog":
        os.kill(os.getpid(), signal.SIGKILL)
    return _judged_there(numbered)
