"""The command line: one thin file a sub-command.

Each parses, reads the settings, runs and ends with an exit code; it must not know how anything is judged or drawn.
"""

from __future__ import annotations

import gc
import os

__all__ = ["main"]


def main(argv: list[str] | None = None) -> int:
    """Run `gcs-bridge` with these arguments (the process's own by default) and return its exit code."""
    # numpy's linear algebra begins a thread on each processor that looks for work for a while, and takes 0.1 s of it.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from gcs_bridge.cli import app  # only here, so that importing this package costs nothing

    code = app.main(argv)
    if argv is None:
        gc.freeze()  # the process ends: what it leaves need not be looked through
    return code
