"""Time limits on a busy machine: waiting for a processor is told from waiting for somebody."""

import threading
import time
from pathlib import Path


def queued_s(thread: int | None = None) -> float:
    """How long a thread of this process (its native id; this one) has been ready to run so far, without a processor.

    0 where the system does not tell.
    """
    try:
        # Three numbers: ns on a processor, ns waiting for one, and how often it got one.
        told = Path(f"/proc/self/task/{thread or threading.get_native_id()}/schedstat").read_text("ascii")
    except OSError:
        return 0.0
    return int(told.split()[1]) / 1e9


def awake_s() -> float:
    """A clock that stands still while this thread waits for a processor, and goes on while it waits for others."""
    return time.monotonic() - queued_s()
