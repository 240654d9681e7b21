"""Runs a program while standard input is open, so that it ends with who started it, even if that is killed.

A script of its own, without an import of ours: `python run_until_parent_exits.py PROGRAM ARGUMENT…`.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading


def main(command: list[str]) -> int:
    """Run it; its exit code."""
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL)  # noqa: S603  # what processes.py gives

    def end_with_input() -> None:
        while os.read(0, 4096):
            pass
        if hasattr(os, "killpg"):
            os.killpg(0, signal.SIGTERM)  # the program, what it started, and this one: a group of their own
        process.terminate()

    threading.Thread(target=end_with_input, daemon=True).start()
    return process.wait()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
