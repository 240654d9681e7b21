"""Recordings inside of other files: each gives the report of its .tlog, and damage is told."""

import gzip
import io
import json
import struct
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pytest

import gcs_bridge
from gcs_bridge.cli import main
from gcs_bridge.errors import SourceError
from gcs_bridge.recordings.packed import name_of, recordings_in
from tests.helpers.paths import FIXTURES, ROOT

FLIGHT = FIXTURES / "c_copter_4hz.tlog"
DATA = FLIGHT.read_bytes()
Packet = tuple[int, bytes]  # time, µs, and bytes


def records(data: bytes) -> list[Packet]:
    """The records of a whole .tlog of MAVLink 2, taken apart by hand."""
    found, at = [], 0
    while at < len(data):
        (t_us,) = struct.unpack_from(">Q", data, at)
        size = 12 + data[at + 9] + 13 * (data[at + 10] & 1)
        found.append((t_us, data[at + 8 : at + 8 + size]))
        at += 8 + size
    return found


def udp(payload: bytes, source: str = "10.0.0.2:14555", target: str = "10.0.0.1:14550", *, more: bool = False) -> bytes:
    """An Ethernet frame around a datagram; `more` fragments follow."""
    (from_ip, from_port), (to_ip, to_port) = (end.split(":") for end in (source, target))
    datagram = struct.pack(">HHHH", int(from_port), int(to_port), 8 + len(payload), 0) + payload
    addresses = bytes(map(int, from_ip.split("."))) + bytes(map(int, to_ip.split(".")))
    ip = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(datagram), 0, 0x2000 if more else 0, 64, 17, 0) + addresses
    return bytes(12) + b"\x08\x00" + ip + datagram


def pcap(packets: Iterable[Packet]) -> bytes:
    """A capture in the older format: libpcap's, in µs, little endian, Ethernet."""
    head = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)
    each = (struct.pack("<IIII", t // 10**6, t % 10**6, len(data), len(data)) + data for t, data in packets)
    return head + b"".join(each)


def pcapng(packets: Iterable[Packet]) -> bytes:
    """The same in the newer one: section header, interface, enhanced packets."""

    def block(kind: int, body: bytes) -> bytes:
        body += bytes(-len(body) % 4)
        return struct.pack("<II", kind, len(body) + 12) + body + struct.pack("<I", len(body) + 12)

    head = block(0x0A0D0D0A, struct.pack("<IHHq", 0x1A2B3C4D, 1, 0, -1)) + block(1, struct.pack("<HHI", 1, 0, 65535))
    each = (
        block(6, struct.pack("<IIIII", 0, t >> 32, t & 0xFFFFFFFF, len(data), len(data)) + data) for t, data in packets
    )
    return head + b"".join(each)


def zipped(**members: bytes) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return file.getvalue()


def layered(times: int) -> bytes:
    data = DATA[:1000]
    for _ in range(times):
        data = gzip.compress(data, 1)
    return data


def judged(path: Path, data: bytes) -> dict[str, Any]:
    """The report's entry but for the file's name and size."""
    path.write_bytes(data)
    (entry,) = gcs_bridge.check(path).to_dict()["files"]
    return {name: value for name, value in entry.items() if name not in ("path", "bytes")}


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return judged(tmp_path_factory.mktemp("plain") / "flight.tlog", DATA)


@pytest.mark.parametrize(
    ("name", "packed"),
    [
        ("flight.mavlink", lambda: DATA),
        ("flight.tlog.gz", lambda: gzip.compress(DATA)),
        ("flight.zip", lambda: zipped(**{"logs/flight.tlog": DATA, "readme.txt": b"a flight"})),
        ("flight.zip", lambda: zipped(whatever=DATA)),
        ("flight.zip", lambda: zipped(**{"flight.tlog.gz": gzip.compress(DATA)})),
        ("flight.pcap", lambda: pcap((t, udp(frame)) for t, frame in records(DATA))),
        ("flight.pcapng", lambda: pcapng((t, udp(frame)) for t, frame in records(DATA))),
        ("flight.pcap.gz", lambda: gzip.compress(pcap((t, udp(frame)) for t, frame in records(DATA)))),
    ],
)
def test_each_gives_the_report_of_its_tlog(
    name: str, packed: Callable[[], bytes], tmp_path: Path, report: dict[str, Any]
) -> None:
    """Word for word: nothing is lost, and every time is as it was."""
    assert judged(tmp_path / name, packed()) == report


@pytest.mark.slow
def test_what_both_ends_say_is_one_link_and_other_flows_are_others(tmp_path: Path) -> None:
    """A vehicle that a router sends to two stations is judged twice, once a flow: it is not two that interleave."""
    packets = []
    for i, (t, frame) in enumerate(records(DATA)):
        to_us = udp(frame) if i % 2 else udp(frame, "10.0.0.1:14550", "10.0.0.2:14555")
        packets += [(t, to_us), (t + 10, udp(frame, target="10.0.0.9:14550")), (t + 20, udp(b"hello", "10.0.0.3:53"))]
    path = tmp_path / "capture.pcap"
    path.write_bytes(pcap(packets))
    named = [f"{path}::10.0.0.1:14550-10.0.0.2:14555", f"{path}::10.0.0.2:14555-10.0.0.9:14550"]
    assert list(map(str, recordings_in(path))) == named
    for one in named:
        (entry,) = gcs_bridge.check(one).to_dict()["files"]
        assert (entry["verdict"], entry["salvage"]["frames"]) == ("agree", len(records(DATA)))
    with pytest.raises(SourceError, match=r"name one of the 2 in it: .*14555-10\.0\.0\.9:14550"):
        gcs_bridge.check(path)


@pytest.mark.slow
def test_frames_in_shape_alone_are_no_flow(tmp_path: Path) -> None:
    """What happens to begin and end as a frame does, with another checksum, is no second link to choose from."""
    alike = b"\xfe\x09" + bytes(15)
    packets = [(t, udp(frame)) for t, frame in records(DATA)]
    packets[1:1] = [(packets[1][0], udp(alike, "10.0.0.3:53")), (packets[1][0], udp(b"", "10.0.0.4:54"))]
    path = tmp_path / "capture.pcap"
    path.write_bytes(pcap(packets))
    assert recordings_in(path) == [path]
    (entry,) = gcs_bridge.check(path).to_dict()["files"]
    assert entry["salvage"]["frames"] == len(records(DATA))


def test_several_frames_in_a_datagram_and_noise_between_them(tmp_path: Path) -> None:
    """What is no frame is counted as it is in any recording; the frames around it are read."""
    frames = records(DATA)
    packets = [(frames[i][0], udp(b"".join(f for _, f in frames[i : i + 3]))) for i in range(0, len(frames), 3)]
    packets.insert(5, (packets[5][0], udp(b"noise" + frames[0][1][:7])))
    entry = judged(tmp_path / "a.pcap", pcap(packets))
    assert entry["salvage"]["frames"] == len(frames)
    assert entry["salvage"]["skipped_bytes"] > 0


@pytest.mark.slow
def test_what_a_capture_lacks_is_told(tmp_path: Path) -> None:
    """Fragments, datagrams that were not captured whole, and an end in the middle of a packet."""
    packets = [(t, udp(frame)) for t, frame in records(DATA)]
    packets[10] = (packets[10][0], udp(records(DATA)[10][1], more=True))
    packets[20] = (packets[20][0], packets[20][1][:-4])
    remarks = " ".join(judged(tmp_path / "a.pcap", pcap(packets)[: -len(packets[-1][1]) - 9])["salvage"]["remarks"])
    assert "1 fragments" in remarks
    assert "1 datagrams were not captured whole" in remarks
    assert "cut off" in remarks


def test_a_gzip_that_is_cut_off_is_judged_as_far_as_it_goes(tmp_path: Path) -> None:
    """And says so; of one whose beginning is damaged there is nothing."""
    packed = gzip.compress(DATA)
    entry = judged(tmp_path / "a.tlog.gz", packed[: len(packed) // 2])
    assert 0 < entry["salvage"]["frames"] < len(records(DATA))
    assert any("damaged or cut off" in remark for remark in entry["salvage"]["remarks"])
    with pytest.raises(SourceError, match="nothing of it can be unpacked"):
        judged(tmp_path / "b.tlog.gz", packed[:9])


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        ("a.zip", zipped(a=b"text", b=b"text"), "no recording in it"),
        ("a.zip", zipped(), "no recording in it"),
        (
            "a.zip",
            zipped(**{"\xe9.tlog": DATA}).replace("\xe9".encode(), b"\x99\x99"),
            "a zip archive that cannot be read",
        ),
        ("a.gz", layered(9), "packed more than 8 times over"),
        ("a.zip", zipped(**{"a.tlog": DATA})[:-30], "a zip archive that cannot be read"),
        ("a.pcap", pcap([(1, udp(b"hello"))]), "no flow of MAVLink over UDP in it"),
        ("a.pcap", pcap([])[:10], "the capture cannot be read"),
        ("a.pcap", pcap([])[:-4] + struct.pack("<I", 147), "packets of link type 147 are not known here"),
        ("a.bag", b"#ROSBAG V2.0\n", "a ROS bag"),
        ("a.xz", b"\xfd7zXZ\x00" + bytes(99), "unxz"),
    ],
)
def test_what_is_none(name: str, data: bytes, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One line, and 3."""
    (tmp_path / name).write_bytes(data)
    assert main(["check", str(tmp_path / name)]) == 3
    told = capsys.readouterr().err
    assert said in told
    assert told.count("\n") == 1


def test_a_folder_is_searched_for_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Archives without a recording are none of ours."""
    (tmp_path / "a.tlog.gz").write_bytes(gzip.compress(DATA))
    (tmp_path / "b.zip").write_bytes(zipped(**{"one.tlog": DATA, "two.tlog": DATA}))
    (tmp_path / "c.zip").write_bytes(zipped(a=b"text", b=b"text"))
    assert main(["check", str(tmp_path), "--format", "json"]) == 0
    paths = [Path(entry["path"]).name for entry in json.loads(capsys.readouterr().out)["files"]]
    assert paths == ["a.tlog.gz", "b.zip::one.tlog", "b.zip::two.tlog"]


def test_a_folder_of_archives_without_a_recording_is_no_good_one(tmp_path: Path) -> None:
    """Nothing was judged, which must not look like a pass."""
    (tmp_path / "c.zip").write_bytes(zipped(a=b"text", b=b"text"))
    assert main(["check", str(tmp_path)]) == 3


def test_an_output_never_replaces_the_archive_that_is_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By whatever name its recordings go."""
    path, data = tmp_path / "a.zip", zipped(**{"one.tlog": DATA, "two.tlog": DATA})
    path.write_bytes(data)
    assert main(["check", str(path), "--output", str(path)]) == 2
    assert main(["export", f"{path}::one.tlog", "--format", "mcap", "--output", str(path)]) == 2
    assert main(["inject", f"{path}::one.tlog", "--fault", "yaw_offset", "--output", str(path)]) == 2
    assert capsys.readouterr().err.count("it is one of the recordings to be read") == 3
    assert path.read_bytes() == data


def test_datagrams_with_nothing_in_them_are_no_flow(tmp_path: Path) -> None:
    """What keeps a way through a router open."""
    packets = [(t, udp(data)) for t, data in records(DATA)[:500]]
    packets.insert(0, (packets[0][0], udp(b"", target="10.0.0.1:9999")))
    (tmp_path / "a.pcap").write_bytes(pcap(packets))
    assert recordings_in(tmp_path / "a.pcap") == [tmp_path / "a.pcap"]


def test_a_time_that_cannot_be_is_a_damaged_one(tmp_path: Path) -> None:
    """All bits set, in one packet of a capture."""
    packets = [(t, udp(data)) for t, data in records(DATA)]
    packets[300] = (2**64 - 1, packets[300][1])
    entry = judged(tmp_path / "a.pcapng", pcapng(packets))
    assert entry["salvage"]["frames"] == len(packets)


def test_a_fault_is_put_into_what_was_packed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The copy is a plain .tlog, the same as of the plain one."""
    monkeypatch.chdir(tmp_path)
    Path("a.tlog").write_bytes(DATA)
    Path("b.TLOG.gz").write_bytes(gzip.compress(DATA))
    Path("c.zip").write_bytes(zipped(**{"in/one.tlog": DATA, "two.tlog": DATA}))
    for path in ("a.tlog", "b.TLOG.gz", "c.zip::in/one.tlog"):
        assert main(["inject", path, "--fault", "yaw_offset"]) == 0
    plain, *others = (Path(f"{name}.yaw_offset.tlog").read_bytes() for name in ("a", "b", "one"))
    assert others == [plain, plain]


@pytest.mark.slow
def test_each_recording_of_an_archive_that_is_piped_in() -> None:
    """Named as those of a file are; what is made of one that has no name is not called `-`, an option to all tools."""
    ended = subprocess.run(
        [sys.executable, "-m", "gcs_bridge", "check", "-q", "-"],
        input=zipped(**{"one.tlog": DATA, "two.tlog": DATA}),
        capture_output=True,
        cwd=ROOT,
        check=False,
    )
    said = b"AGREE       -::one.tlog: 1 vehicle, no alarm\nAGREE       -::two.tlog: 1 vehicle, no alarm\n"
    assert (ended.returncode, ended.stdout) == (0, said)
    assert [name_of(Path(name)) for name in ("-", "-::one.tlog", "x/a.tlog.gz")] == ["stdin", "one", "a"]


@pytest.mark.slow
@pytest.mark.parametrize("data", [DATA, gzip.compress(DATA)], ids=["tlog", "gzip"])
def test_standard_input(data: bytes) -> None:
    """Piped in, packed or not; with evidence of it, which reads it twice."""
    ended = subprocess.run(
        [sys.executable, "-m", "gcs_bridge", "check", "-q", "-"], input=data, capture_output=True, cwd=ROOT, check=False
    )
    assert (ended.returncode, ended.stdout) == (0, b"AGREE       -: 1 vehicle, no alarm\n")
