"""Time limits on a machine that is busy with other things: waiting for a processor is told from waiting for somebody."""

import threading
from pathlib import Path


def queued_s() -> float:
    """How long this thread has been ready to run by now, without a processor; 0 where the system does not tell."""
    try:
        # Three numbers: ns on a processor, ns waiting for one, and how often it got one.
        told = Path(f"/proc/self/task/{threading.get_native_id()}/schedstat").read_text("ascii")
    except OSError:
        return 0.0
    return int(told.split()[1]) / 1e9
