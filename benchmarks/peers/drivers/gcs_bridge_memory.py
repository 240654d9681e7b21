"""What `gcs_bridge.read` takes of memory: the bytes of the arrays that it returns, and by how much this process grew.

A first, short recording is read before, so that the libraries, the kernels and the tables are there already. Prints
ARRAYS=BYTES and GROWN=BYTES. Linux tells how large a process is now; elsewhere its largest size so far must do.
"""

import resource
import sys
from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np

import gcs_bridge


def largest_bytes() -> int:
    size = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return size if sys.platform == "darwin" else size * 1024


def present_bytes() -> int:
    status = Path("/proc/self/statm")
    return int(status.read_text().split()[1]) * resource.getpagesize() if status.exists() else largest_bytes()


def arrays_of(held: object) -> dict[tuple[int, int], int]:
    """Bytes of every array below dataclasses; one that is held twice counts once."""
    if isinstance(held, np.ndarray):
        return {(held.ctypes.data, held.nbytes): held.nbytes}
    found: dict[tuple[int, int], int] = {}
    if is_dataclass(held):
        for field in fields(held):
            found |= arrays_of(getattr(held, field.name))
    return found


short, path = sys.argv[1:]
gcs_bridge.read(short)
before = present_bytes()
vehicles = gcs_bridge.read(path).vehicles.values()
grown = largest_bytes() - before
arrays = sum(sum(arrays_of(vehicle).values()) for vehicle in vehicles)
print(f"ARRAYS={arrays} GROWN={grown}")
