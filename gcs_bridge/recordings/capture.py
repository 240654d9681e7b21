"""Captures of a network (pcap, pcapng): the MAVLink over UDP in them, a link for each flow, as records with times.

A flow is what two ends say to each other, either way. Packets are taken apart by dpkt.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, BinaryIO, NamedTuple

import dpkt

from gcs_bridge.mavlink.likeness import frame_end, holds

__all__ = ["flows", "write_records"]

_END_OF_TIME_US = 2**63  # a damaged time reads as 0, as in a .tlog
_PCAPNG = b"\x0a\x0d\x0d\x0a"
_RAW_IP = (12, 14, 101)  # link types of packets that begin with IP
_BY_LINK: dict[int, type[dpkt.Packet]] = {
    0: dpkt.loopback.Loopback,
    1: dpkt.ethernet.Ethernet,
    113: dpkt.sll.SLL,
    276: dpkt.sll2.SLL2,
}


class _Datagram(NamedTuple):
    flow: str
    t_us: int
    data: bytes


class _Passed:
    """Packets that could not be used, counted."""

    fragments = truncated = 0
    cut_off = False


def flows(file: BinaryIO) -> list[str]:
    """The flows that carry MAVLink, in order of appearance. ValueError for what is no capture."""
    found: dict[str, bool] = {}
    for datagram in _datagrams(file, _Passed()):
        if not found.get(datagram.flow):
            found[datagram.flow] = _is_mavlink(datagram.data)
    return [flow for flow, has_frames in found.items() if has_frames]


def write_records(file: BinaryIO, flow: str | None, into: BinaryIO) -> tuple[list[str], list[str]]:
    """Write a flow as a .tlog, frame by frame, each with its time: the one that is called so, or the first of MAVLink.

    Returns the flows that carry MAVLink, and what there is to say of the capture. A flow begins with its first datagram
    of whole frames. ValueError for what is no capture.
    """
    passed = _Passed()
    found: dict[str, bool] = {}
    for datagram in _datagrams(file, passed):
        if not found.get(datagram.flow):
            found[datagram.flow] = is_one = _is_mavlink(datagram.data)
            if not is_one:
                continue
            flow = flow or datagram.flow
        if datagram.flow == flow:
            stamp = struct.pack(">Q", datagram.t_us)
            into.writelines(stamp + piece for piece in _pieces(datagram.data))
    remarks = []
    if passed.fragments:
        remarks.append(f"{passed.fragments} fragments of larger datagrams in the capture were passed over")
    if passed.truncated:
        remarks.append(f"{passed.truncated} datagrams were not captured whole, and were passed over")
    if passed.cut_off:
        remarks.append("the capture is cut off; what lies before that is judged")
    return [name for name, has_frames in found.items() if has_frames], remarks


def _is_mavlink(data: bytes) -> bool:
    """Whether a datagram is frames and nothing else, their checksums such as MAVLink's are."""
    at = 0
    while at < len(data):
        end = frame_end(data, at)
        if end is None or not holds(data, at, end):
            return False
        at = end
    return at > 0


def _pieces(data: bytes) -> Iterator[bytes]:
    """A datagram's frames by their shape, and what lies between them."""
    at = loose = 0
    while at < len(data):
        end = frame_end(data, at)
        if end is None:
            at += 1
            continue
        if loose < at:
            yield data[loose:at]
        yield data[at:end]
        at = loose = end
    if loose < len(data):
        yield data[loose:]


def _datagrams(file: BinaryIO, passed: _Passed) -> Iterator[_Datagram]:
    file.seek(0)
    reader = dpkt.pcapng.Reader if file.read(4) == _PCAPNG else dpkt.pcap.Reader
    file.seek(0)
    try:
        packets = reader(file)
        link = packets.datalink()
    except (dpkt.UnpackError, ValueError) as error:
        raise ValueError(str(error) or "its header is cut off") from None
    if link not in _BY_LINK and link not in _RAW_IP:
        raise ValueError(f"packets of link type {link} are not known here")
    each = iter(packets)
    while True:
        try:
            t_s, packet = next(each)
        except StopIteration:
            return
        except (dpkt.UnpackError, ValueError, struct.error):
            passed.cut_off = True
            return
        t_us = round(float(t_s) * 1e6)
        datagram = _datagram(t_us if 0 <= t_us < _END_OF_TIME_US else 0, link, bytes(packet), passed)
        if datagram is not None:
            yield datagram


def _datagram(t_us: int, link: int, packet: bytes, passed: _Passed) -> _Datagram | None:
    """The UDP datagram in a packet, if there is one."""
    try:
        network: Any = _ip(packet) if link in _RAW_IP else _BY_LINK[link](packet).data
        if isinstance(network, dpkt.ip.IP) and (network.mf or network.offset):
            passed.fragments += network.p == dpkt.ip.IP_PROTO_UDP
            return None
        udp = getattr(network, "data", None)
        if not isinstance(udp, dpkt.udp.UDP):
            return None
        if udp.ulen > len(udp.data) + 8:
            passed.truncated += 1
            return None
        one, other = (network.src, udp.sport), (network.dst, udp.dport)
    except (dpkt.UnpackError, ValueError, AttributeError):
        return None
    return _Datagram(_flow(one, other), t_us, bytes(udp.data))


@lru_cache(maxsize=1024)
def _flow(one: tuple[bytes, int], other: tuple[bytes, int]) -> str:
    """How the flow between two ends is called, whichever of them sent."""
    return "-".join(f"{dpkt.utils.inet_to_str(address)}:{port}" for address, port in sorted((one, other)))


def _ip(packet: bytes) -> Any:
    return dpkt.ip6.IP6(packet) if packet[:1] and packet[0] >> 4 == 6 else dpkt.ip.IP(packet)
