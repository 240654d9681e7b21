"""The sender: frames of a file, one a datagram, each at its time, to a port of this machine.

    python -m benchmarks.send_datagrams FRAMES.npz PORT --speed 8 --cpu 1 --sent SENT.npy

FRAMES.npz has `data`, `ends` of the frames in it, and `due_us`. All frames that are due go with one call of the system
(sendmmsg, Linux), so that 100,000 a second are no effort. SENT.npy gets the time before each one's call, ns since 1970.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import os
import socket
import sys
import time
from pathlib import Path

import numpy as np
import numpy.typing as npt

AT_ONCE = 512
_PAUSE_S = 0.0003
_MESSAGE = np.dtype(
    [(name, np.uintp) for name in ("name", "namelen", "iov", "iovlen", "control", "controllen", "flags", "len")]
)
_IOVEC = np.dtype([("base", np.uintp), ("len", np.uintp)])


def send(
    data: npt.NDArray[np.uint8],
    ends: npt.NDArray[np.int64],
    due_s: npt.NDArray[np.float64],
    sender: socket.socket,
    pause_s: float = _PAUSE_S,
) -> float:
    """Send all from a connected socket, each when it is due, s since 1970, or up to `pause_s` later.

    Fills `due_s` with when each was sent. Returns by how much it was late at the worst.
    """
    starts = np.concatenate(([0], ends[:-1]))
    iovecs = np.zeros(len(ends), _IOVEC)
    iovecs["base"], iovecs["len"] = data.ctypes.data + starts, ends - starts
    messages = np.zeros(len(ends), _MESSAGE)
    messages["iov"] = iovecs.ctypes.data + _IOVEC.itemsize * np.arange(len(ends))
    messages["iovlen"] = 1
    sendmmsg = ctypes.CDLL(None, use_errno=True).sendmmsg
    sendmmsg.argtypes = [ctypes.c_int, ctypes.c_void_p, ctypes.c_uint, ctypes.c_int]
    worst_s = 0.0
    at = 0
    while at < len(ends):
        now_s = time.time()
        until = min(int(np.searchsorted(due_s, now_s, side="right")), at + AT_ONCE)
        if until <= at:
            time.sleep(pause_s if pause_s > _PAUSE_S else min(due_s[at] - now_s, _PAUSE_S))
            continue
        worst_s = max(worst_s, now_s - due_s[at])
        done = sendmmsg(sender.fileno(), messages.ctypes.data + _MESSAGE.itemsize * at, until - at, 0)
        if done < 0:
            raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
        due_s[at : at + done] = now_s
        at += done
    return worst_s


def connected(port: int) -> socket.socket:
    """A socket that sends to a port of this machine."""
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sender.connect(("127.0.0.1", port))
    return sender


def main() -> None:
    parser = argparse.ArgumentParser(description="Send frames as datagrams, each at its time.")
    parser.add_argument("frames", type=Path)
    parser.add_argument("port", type=int)
    parser.add_argument("--speed", type=float, default=1.0, help="times as fast as they are due  [1]")
    parser.add_argument("--cpu", type=int, help="of those of this machine, the one to run on")
    parser.add_argument("--sent", type=Path, help="where the times are written")
    arguments = parser.parse_args()
    if arguments.cpu is not None:
        os.sched_setaffinity(0, {arguments.cpu})
    with np.load(arguments.frames) as frames:
        data, ends, due_s = frames["data"], frames["ends"], frames["due_us"] / 1e6 / arguments.speed
    with connected(arguments.port) as sender:
        due_s += time.time()
        worst_s = send(data, ends, due_s, sender)
    if arguments.sent is not None:
        np.save(arguments.sent, np.round(due_s * 1e9).astype(np.int64))
    took_s = float(due_s[-1] - due_s[0])
    sys.stdout.write(json.dumps({"count": len(ends), "took_s": took_s, "late_s": worst_s}) + "\n")


if __name__ == "__main__":
    main()
