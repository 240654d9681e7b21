"""What each kernel costs once: the time to compile it, in this one process, and the time to load it.

A helper is compiled with the first kernel that calls it, so the order matters; processor time, as other processes run
beside it. With --helpers, how often each helper was compiled, that is for how many combinations of types.

    python -m benchmarks.kernels
"""

from __future__ import annotations

import argparse
import importlib
import os
import pkgutil
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

_FOLDER = tempfile.TemporaryDirectory(prefix="gcs-bridge-kernels-")
os.environ["GCS_BRIDGE_CACHE_DIR"] = _FOLDER.name  # before anything looks for kernels

import gcs_bridge  # noqa: E402
from gcs_bridge.jit import native  # noqa: E402
from gcs_bridge.jit.kernels import KERNELS  # noqa: E402


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="What each kernel costs once.")
    parser.add_argument("--helpers", action="store_true", help="and what is compiled more than once")
    arguments = parser.parse_args(argv)
    for module in pkgutil.walk_packages(gcs_bridge.__path__, "gcs_bridge."):
        if not module.name.startswith(("gcs_bridge.viewer", "gcs_bridge.__main__")):
            importlib.import_module(module.name)
    native.processor()

    compiled: Counter[str] = Counter()
    begun_s = time.process_time()
    from numba.core import event

    importlib.import_module("gcs_bridge.jit.compiler")  # its import is a step of its own

    class Count(event.Listener):  # type: ignore[misc]  # untyped in numba
        def on_start(self, happened: event.Event) -> None:
            compiled[str(happened.data["dispatcher"].py_func.__qualname__)] += 1

        def on_end(self, happened: event.Event) -> None:
            pass

    event.register("numba:compile", Count())
    print("| kernel | s to compile | bytes | ms to load |\n| --- | --- | --- | --- |")
    print(f"| (numba itself) | {time.process_time() - begun_s:.2f} | | |")
    in_all_s = begun_s
    for one in KERNELS:
        begun_s = time.process_time()
        one.load()
        spent_s = time.process_time() - begun_s
        again = type(one)(one.function)
        begun_ms = time.perf_counter() * 1e3
        again.load()
        size = Path(_FOLDER.name, one.name).stat().st_size
        print(f"| {one.__name__} | {spent_s:.2f} | {size} | {time.perf_counter() * 1e3 - begun_ms:.2f} |", flush=True)
    print(f"| all | {time.process_time() - in_all_s:.2f} | | |")
    if arguments.helpers:
        for name, times in compiled.most_common():
            print(f"{times:3} {name}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
