"""Many datagrams of a socket by one call of the system: recvmmsg, which Linux has.

Fetched one by one, each costs a call of the system and Python's handling of it. Here the system puts each into a slot
of its own; a kernel moves them together, and reads the time at which each arrived.
"""

from __future__ import annotations

import ctypes
import errno
import os
import socket
import struct
import sys
from typing import Annotated

import numpy as np
import numpy.typing as npt

from gcs_bridge.columns import Int64s, Records
from gcs_bridge.jit import kernel
from gcs_bridge.links.wall_clock import now_us

__all__ = ["AT_ONCE", "DatagramReader", "address_of"]
AT_ONCE = 128
_SLOT = 65_600  # for the largest datagram; no power of two: all slots would share a few lines of the processor's cache
# Numbers of Linux's asm-generic/socket.h that Python does not name: when each datagram arrived, and how many did not
# fit into the buffer since the socket was opened.
_SO_TIMESTAMPNS, _SO_RXQ_OVFL = 35, 40
# C's struct mmsghdr (with the padding behind its flags) and struct iovec; and what comes beside a datagram: a struct
# cmsghdr with its time, and another one if any was dropped.
_MESSAGE = np.dtype(
    [
        ("name", np.uintp),
        ("namelen", np.uint32),
        ("iov", np.uintp),
        ("iovlen", np.uintp),
        ("control", np.uintp),
        ("controllen", np.uintp),
        ("flags", np.uintp),
        ("len", np.uint32),
    ],
    align=True,
)
_IOVEC = np.dtype([("base", np.uintp), ("len", np.uintp)])
_TIME = np.dtype(
    [("len", np.uintp), ("level", np.int32), ("type", np.int32), ("seconds", np.intp), ("nanoseconds", np.intp)]
)
_DROPS = np.dtype([("len", np.uintp), ("level", np.int32), ("type", np.int32), ("count", np.uint32)], align=True)
_CONTROL = np.dtype([("time", _TIME), ("drops", _DROPS)], align=True)
_CONTROL_SIZE = _CONTROL.itemsize
_NAME_SIZE = 28  # C's struct sockaddr_in6, the larger of the two


class DatagramReader:
    """Fetches the datagrams of one socket, `AT_ONCE` or fewer at a time; `dropped` by the system, by the latest one."""

    def __init__(self, from_socket: socket.socket) -> None:
        """Ask the socket for times and drops. OSError where the system has no such call."""
        if sys.platform != "linux":
            raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS))
        self.dropped = 0
        from_socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        from_socket.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
        self._socket = from_socket
        self._receive = ctypes.CDLL(None, use_errno=True).recvmmsg
        self._receive.argtypes = [ctypes.c_int, ctypes.c_void_p, ctypes.c_uint, ctypes.c_int, ctypes.c_void_p]
        self._slots = np.empty((AT_ONCE, _SLOT), np.uint8)
        self._control = np.zeros(AT_ONCE, _CONTROL)
        self._iovecs = np.zeros(AT_ONCE, _IOVEC)
        self._iovecs["base"] = _addresses(self._slots)
        self._iovecs["len"] = _SLOT
        self._messages = np.zeros(AT_ONCE, _MESSAGE)
        self._messages["iov"] = _addresses(self._iovecs)
        self._messages["iovlen"] = 1
        self._names = np.zeros((AT_ONCE, _NAME_SIZE), np.uint8)
        self._messages["name"] = _addresses(self._names)
        self._messages["namelen"] = _NAME_SIZE
        self._messages["control"] = _addresses(self._control)
        self._messages["controllen"] = _CONTROL_SIZE
        self._address = self._messages.ctypes.data

    def read(self, data: npt.NDArray[np.uint8], ends: Int64s, t_rx_us: Int64s, count: int) -> int:
        """Fetch what has arrived; BlockingIOError if nothing has. Returns how many datagrams there are then.

        There are `count` in `data` already, which `ends` and `t_rx_us` tell of; the next ones come behind them.
        """
        fetched = self._receive(self._socket.fileno(), self._address, AT_ONCE, socket.MSG_DONTWAIT, None)
        if fetched < 0:
            number = ctypes.get_errno()
            raise OSError(number, os.strerror(number))  # of EAGAIN Python makes a BlockingIOError
        dropped = _gather(self._messages, self._control, self._slots, fetched, now_us(), data, ends, t_rx_us, count)
        self.dropped = max(self.dropped, dropped)
        return count + int(fetched)

    def sender(self, index: int) -> bytes:
        """Whence datagram `index` of the last `read` came, as the system writes it: for `address_of`."""
        return bytes(self._names[index])


@kernel
def _gather(
    messages: Annotated[Records, _MESSAGE],
    control: Annotated[Records, _CONTROL],
    slots: Annotated[npt.NDArray[np.uint8], 2],
    fetched: int,
    read_us: int,
    data: npt.NDArray[np.uint8],
    ends: Int64s,
    t_rx_us: Int64s,
    count: int,
) -> int:
    """Put what was fetched behind the `count` datagrams that are in `data`; returns how many were dropped by now."""
    dropped = 0
    end = int(ends[count - 1]) if count else 0
    for i in range(fetched):
        told = control[i]
        for j in range(messages[i].len):
            data[end + j] = slots[i, j]
        end += int(messages[i].len)
        ends[count + i] = end
        t_rx_us[count + i] = read_us
        if told.time.type == _SO_TIMESTAMPNS:
            arrived_us = told.time.seconds * 1_000_000 + told.time.nanoseconds // 1000
            t_rx_us[count + i] = min(arrived_us, read_us)  # later than now: the clock was set back since
        if told.drops.type == _SO_RXQ_OVFL:
            dropped = int(told.drops.count)
        # The system writes over how much room it has, and writes nothing where it has nothing to tell.
        messages[i].controllen = _CONTROL_SIZE
        messages[i].namelen = _NAME_SIZE
        told.time.type = told.drops.type = 0
    # None came after the one behind it. Linux takes the time of reading for those that came before it began to stamp.
    for i in range(count + fetched - 1, 0, -1):
        t_rx_us[i - 1] = min(t_rx_us[i - 1], t_rx_us[i])
    return dropped


def address_of(sender: bytes) -> tuple[str | int, ...]:
    """An address as Python's sockets take it, of C's struct sockaddr_in or sockaddr_in6.

    >>> address_of(struct.pack("=H", socket.AF_INET) + bytes([0x36, 0xB0, 127, 0, 0, 1]) + bytes(20))
    ('127.0.0.1', 14000)
    """
    (family,), (port,) = struct.unpack_from("=H", sender), struct.unpack_from(">H", sender, 2)
    if family == socket.AF_INET:
        return socket.inet_ntop(family, sender[4:8]), port
    (scope,) = struct.unpack_from("=I", sender, 24)
    return socket.inet_ntop(socket.AF_INET6, sender[8:24]), port, 0, scope


def _addresses(rows: npt.NDArray[np.generic]) -> npt.NDArray[np.uintp]:
    """Where each row is in memory."""
    return rows.ctypes.data + rows.strides[0] * np.arange(len(rows), dtype=np.uintp)
