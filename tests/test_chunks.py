"""Links and recordings bring chunks, and a monitor takes them, whatever they come from."""

import socket
from pathlib import Path

import pytest

from gcs_bridge.chunks import Chunk, Framing
from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.links.open import open_link
from gcs_bridge.links.uri import NetworkUri
from gcs_bridge.links.wall_clock import now_us
from gcs_bridge.recordings.open import READERS, open_recording
from tests.helpers.live_links import fixture, free_port, tcp_sender, tlog_of, wait_until
from tests.helpers.paths import FIXTURES

FRAMES = fixture("a_copter_square", from_s=75, to_s=83, fault="yaw_offset:25")


def test_a_recording_is_chunks(tmp_path: Path) -> None:
    """Of records where it has times, of a stream where it has none; the same again when it is read again."""
    for name, data, framing in (
        ("a.tlog", tlog_of(FRAMES), Framing.RECORDS),
        ("a.raw", b"".join(frame.data for frame in FRAMES), Framing.STREAM),
    ):
        (tmp_path / name).write_bytes(data)
        with open_recording(tmp_path / name) as source:
            chunks = list(source)
            assert list(source) == chunks
            assert [len(chunk.data) for chunk in source.chunks(lambda: 1000)][:2] == [1000, 1000]
        assert b"".join(chunk.data for chunk in chunks) == data
        assert {(chunk.t_rx_us, chunk.framing) for chunk in chunks} == {(-1, framing)}


@pytest.mark.parametrize("suffix", [*READERS, ".TLOG", ".bin", ""])
def test_a_recording_is_known_by_its_content(suffix: str, tmp_path: Path) -> None:
    """Each suffix of the table has a reader; what has another, or a wrong one, is telemetry if it looks like it."""
    path = tmp_path / f"a{suffix}"
    path.write_bytes((FIXTURES / "c_copter_4hz.tlog").read_bytes())
    with open_recording(path) as source:
        assert source.timed


def test_a_link_of_datagrams_is_chunks() -> None:
    """Iterating it gives those that have come, and ends where it would have to wait."""
    uri = NetworkUri("udpin", "127.0.0.1", free_port())
    link = open_link(uri)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for data in (b"one", b"two"):
            sender.sendto(data, (uri.host, uri.port))
    assert [(chunk.data, chunk.framing) for chunk in link] == [
        (b"one", Framing.DATAGRAM),
        (b"two", Framing.DATAGRAM),
    ]
    assert list(link) == []
    link.close()


def test_a_stream_that_waited_is_one_chunk() -> None:
    """However it was sent: it is judged at once, with the time at which it was fetched."""
    with tcp_sender(FRAMES[:50], 1e9) as (port, _):
        link = open_link(NetworkUri("tcp", "127.0.0.1", port))
        size = sum(len(frame.data) for frame in FRAMES[:50])
        found: list[list[Chunk]] = []

        def enough() -> bool:
            found.append(list(link))
            return sum(len(chunk.data) for chunks in found for chunk in chunks) == size

        wait_until(enough)
        link.close()
    assert all(len(chunks) <= 1 for chunks in found)
    chunks = [chunk for chunks in found for chunk in chunks]
    assert b"".join(bytes(chunk.data) for chunk in chunks) == b"".join(frame.data for frame in FRAMES[:50])
    assert len(chunks) < 50
    assert all(chunk.framing is Framing.STREAM and abs(chunk.t_rx_us - now_us()) < 60e6 for chunk in chunks)


@pytest.mark.slow
def test_a_monitor_takes_chunks_of_every_kind() -> None:
    """`feed`, `feed_datagrams` and `feed_recording` are `take` with one framing each: the same events and reports."""
    tlog, stream = tlog_of(FRAMES), b"".join(frame.data for frame in FRAMES)
    t_rx_us = FRAMES[0].t_rx_us
    cuts = range(0, len(tlog), 4999)
    by_name, by_chunk = Monitor(), Monitor()
    assert [event for at in cuts for event in by_name.feed_recording(tlog[at : at + 4999])] == by_chunk.take(
        [Chunk(tlog[at : at + 4999], -1, Framing.RECORDS) for at in cuts]
    )
    datagrams = [(frame.data, frame.t_rx_us) for frame in FRAMES]
    assert by_name.feed_datagrams(datagrams, 1) == by_chunk.take(
        [Chunk(*datagram, Framing.DATAGRAM) for datagram in datagrams], 1
    )
    assert by_name.feed(stream, t_rx_us, 2) == by_chunk.take([Chunk(stream, t_rx_us, Framing.STREAM)], 2)
    report = by_name.close()
    assert report == by_chunk.close()
    assert [entry.path for entry in report.files] == ["recording", "1", "2"]
    assert [len(entry.vehicles[0].alarms) for entry in report.files] == [1, 1, 1]


def test_no_chunks_are_no_link() -> None:
    """Nothing has come: nothing is told, and nothing is in the report."""
    monitor = Monitor()
    assert monitor.take([]) == []
    assert monitor.close().files == ()
