"""What `--record` leaves behind: after a kill, on a full disk, in several files; and what it must not keep."""

import contextlib
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_bridge.cli.live_sinks import plan_sinks
from gcs_bridge.errors import UsageError
from gcs_bridge.mavlink.scanner import RawFrame
from gcs_bridge.sinks.base import SinkContext
from gcs_bridge.sinks.tlog import TlogRecorder
from tests.helpers.live_links import fixture, frames_of, recorder, tlog_of, wait_until
from tests.helpers.paths import ROOT
from tests.helpers.processor import awake_s
from tests.helpers.wire import pack, with_checksum

FRAMES = fixture("e_two_vehicles", to_s=4)


def written(
    path: Path, frames: Sequence[RawFrame], *, max_mb: float | None = None, max_minutes: float | None = None
) -> list[Path]:
    """Record frames, some at a time; the files there are then, in their order."""
    with contextlib.closing(recorder(path, max_mb=max_mb, max_minutes=max_minutes)) as sink:
        for start in range(0, len(frames), 7):
            sink.frames(0, frames[start : start + 7])
    return sorted(path.parent.iterdir())


# --- torn ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(6))
def test_a_torn_record_is_cut_off(seed: int, tmp_path: Path) -> None:
    """However much of the last record was written, what is appended follows a whole one: nothing is unreadable."""
    dice = random.Random(seed)
    path = tmp_path / "live.tlog"
    count = dice.randrange(1, len(FRAMES))
    before, after = FRAMES[:count], FRAMES[count:]
    torn = tlog_of(after[:1])
    path.write_bytes(tlog_of(before) + torn[: dice.randrange(1, len(torn))])
    written(path, after)
    assert path.read_bytes() == tlog_of(FRAMES)


def unknown(size: int) -> bytes:
    """A frame of an id that no dialect defines."""
    return with_checksum(bytes([0xFD, size, 0, 0, 9, 1, 1, 0x39, 0x30, 0]) + bytes(range(size)) + b"\0\0", 7)


@pytest.mark.parametrize("torn", [0, 1, 7, 8, 9, 10, 20])
def test_behind_frames_of_unknown_ids(torn: int, tmp_path: Path) -> None:
    """Nobody can tell their checksums; they are no torn record, and one of them may be torn."""
    path = tmp_path / "live.tlog"
    whole = [*FRAMES[:20], *(RawFrame(FRAMES[20].t_rx_us, unknown(size)) for size in (3, 200, 40))]
    path.write_bytes(tlog_of(whole) + tlog_of([RawFrame(FRAMES[20].t_rx_us, unknown(60))])[:torn])
    written(path, FRAMES[20:])
    assert path.read_bytes() == tlog_of([*whole, *FRAMES[20:]])


@pytest.mark.parametrize("junk", [b"nonsense" * 5, bytes(4096), b"12345678\xee" + bytes(3)])
def test_what_is_no_record_is_left_where_it_is(junk: bytes, tmp_path: Path) -> None:
    """Damage behind the last frame is not ours to cut: all frames are read, before and behind it."""
    path = tmp_path / "live.tlog"
    path.write_bytes(tlog_of(FRAMES[:50]) + junk)
    written(path, FRAMES[50:])
    assert path.read_bytes() == tlog_of(FRAMES[:50]) + junk + tlog_of(FRAMES[50:])
    assert [frame.data for frame in frames_of(path.read_bytes())] == [frame.data for frame in FRAMES]


def test_nothing_is_appended_to_what_is_no_recording(tmp_path: Path) -> None:
    """A name that was typed wrongly costs nobody a file."""
    path = tmp_path / "notes.txt"
    path.write_bytes(b"what I thought of it\n" * 9000)
    with pytest.raises(UsageError, match=r"notes.txt: it is no recording"):
        recorder(path)
    assert path.read_bytes() == b"what I thought of it\n" * 9000


def test_a_long_recording_is_gone_on_with_at_once(tmp_path: Path) -> None:
    """Its end alone is looked at, however large it is: here a gigabyte of nothing between two frames."""
    path = tmp_path / "live.tlog"
    with path.open("wb") as file:
        file.write(tlog_of(FRAMES[:5]))
        file.seek(2**30)
        file.write(tlog_of(FRAMES[5:10]) + b"\0\0\0")
    size = 2**30 + len(tlog_of(FRAMES[5:10]))
    began_s = awake_s()
    written(path, FRAMES[10:11])
    assert awake_s() - began_s < 2
    assert path.stat().st_size == size + len(tlog_of(FRAMES[10:11]))


RECORDS_FOR_EVER = """
import contextlib, itertools, sys, time
from pathlib import Path
from tests.helpers.live_links import fixture, recorder
frames = fixture("e_two_vehicles", to_s=4)
sink = recorder(Path(sys.argv[1]))
print("recording", flush=True)
for start in itertools.cycle(range(0, len(frames), 5)):
    sink.frames(0, frames[start : start + 5])
"""


def is_larger(path: Path, size: int) -> bool:
    """Whether the file has grown beyond `size`, bytes."""
    return path.exists() and path.stat().st_size > size


@pytest.mark.slow
def test_killed_again_and_again(tmp_path: Path) -> None:
    """kill -9 at any time, five times over: one file without damage, once the next run goes on with it.

    Of a record that the system was writing when the last kill came, a part may stand at the end until then.
    """
    from gcs_bridge import check

    path = tmp_path / "live.tlog"
    dice = random.Random(1)
    for _ in range(5):
        before = path.stat().st_size if path.exists() else 0
        process = subprocess.Popen(
            [sys.executable, "-c", RECORDS_FOR_EVER, str(path)],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdout=subprocess.PIPE,
        )
        with process:
            assert process.stdout is not None
            process.stdout.readline()
            wait_until(partial(is_larger, path, before))
            time.sleep(dice.uniform(0, 0.05))
            process.send_signal(signal.SIGKILL)
    with contextlib.closing(recorder(path)) as sink:
        sink.frames(0, FRAMES[:1])
    (entry,) = check(path).files
    assert entry.salvage.skipped_bytes == entry.salvage.bad_crc == 0
    assert entry.salvage.frames > 5 * 5


# --- a full disk -----------------------------------------------------------------------------------------------------


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 256 KiB."""
    place = tmp_path / "disk"
    place.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(place)], capture_output=True, text=True, check=False
    )
    if mounted.returncode:
        pytest.skip(f"no disk of our own can be mounted here: {mounted.stderr.strip()}")
    yield place
    subprocess.run(["umount", str(place)], check=True)


def opened(path: Path, said: list[str], **limits: float) -> TlogRecorder:
    context = SinkContext(title="x", links=["a"], note=said.append, complain=said.append, stack=ExitStack())
    sink = TlogRecorder.plan(str(path), **limits).open(context)
    assert isinstance(sink, TlogRecorder)
    return sink


@pytest.mark.parametrize("limits", [{}, {"max_mb": 0.05}, {"max_minutes": 1 / 60}])
def test_a_full_disk_is_told_once_and_gone_on_with(
    limits: dict[str, float], small_disk: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What fits is whole; what does not is left out; as soon as there is room, it is recorded again."""
    from gcs_bridge.sinks import file

    now_s = 0.0
    monkeypatch.setattr(file, "time", SimpleNamespace(monotonic=lambda: now_s))
    path, said = small_disk / "live.tlog", list[str]()
    ballast = small_disk / "ballast"
    ballast.write_bytes(bytes(100_000))
    with contextlib.closing(opened(path, said, **limits)) as sink:
        frames = list(FRAMES) * 12
        for start in range(0, len(frames), 7):
            sink.frames(0, frames[start : start + 7])
        full = b"".join(one.read_bytes() for one in sorted(small_disk.glob("live*.tlog")))
        (complaint,) = said
        assert "No space left on device" in complaint
        assert sink.failed
        assert tlog_of(frames).startswith(full)
        assert len(full) > 100_000
        ballast.unlink()
        now_s += 2.0  # it is tried again each second
        sink.frames(0, FRAMES[:20])
        assert len(said) == 1
        now_s += 11.0  # and written to for ten until that is told
        sink.frames(0, FRAMES[20:40])
        _, note = said
        assert "is written again; 0." in note
    kept = b"".join(one.read_bytes() for one in sorted(small_disk.glob("live*.tlog")))
    assert kept.startswith(full)
    assert kept.endswith(tlog_of(FRAMES[:40]))
    assert tlog_of(frames_of(kept)) == kept


# --- several files ---------------------------------------------------------------------------------------------------


def test_by_size(tmp_path: Path) -> None:
    """No file is larger than asked, none is cut within a frame, and together they are the whole."""
    files = written(tmp_path / "live.tlog", FRAMES, max_mb=0.01)
    assert [file.name for file in files[:3]] == ["live.tlog", "live_part002.tlog", "live_part003.tlog"]
    sizes = [file.stat().st_size for file in files]
    assert max(sizes) <= 10_000
    assert min(sizes[:-1]) > 9_500
    for file in files:
        assert tlog_of(frames_of(file.read_bytes())) == file.read_bytes()
    assert b"".join(file.read_bytes() for file in files) == tlog_of(FRAMES)


def test_by_time(tmp_path: Path) -> None:
    """By the time at which frames came: each file lasts as long as asked at most."""
    files = written(tmp_path / "live.tlog", FRAMES, max_minutes=1 / 60)
    assert len(files) == 4
    for file in files:
        frames = frames_of(file.read_bytes())
        assert 0.8 < (frames[-1].t_rx_us - frames[0].t_rx_us) / 1e6 < 1.0
    assert b"".join(file.read_bytes() for file in files) == tlog_of(FRAMES)


@pytest.mark.parametrize("step_s", [-86_400, 86_400])
def test_a_clock_that_is_set(step_s: int, tmp_path: Path) -> None:
    """Forwards or back, by a day: one more file, and not one for each frame."""
    shifted = [frame._replace(t_rx_us=frame.t_rx_us + step_s * 1_000_000) for frame in FRAMES[300:]]
    files = written(tmp_path / "live.tlog", [*FRAMES[:300], *shifted], max_minutes=10)
    assert [file.read_bytes() for file in files] == [tlog_of(FRAMES[:300]), tlog_of(shifted)]


def test_the_next_run_goes_on_behind_the_last_file(tmp_path: Path) -> None:
    """As a service that was restarted: the last file is filled up, torn end and all, and no earlier one is touched."""
    path = tmp_path / "live.tlog"
    first = written(path, FRAMES[:300], max_mb=0.005)
    (tmp_path / "live_part1.tlog").write_bytes(b"no part of it")
    (tmp_path / "other_part099.tlog").write_bytes(b"of another one")
    before = [file.read_bytes() for file in first]
    with first[-1].open("ab") as file:
        file.write(b"torn")
    written(path, FRAMES[300:], max_mb=0.005)
    files = [path, *sorted(tmp_path.glob("live_part???.tlog"))]
    assert [file.read_bytes() for file in files[: len(first) - 1]] == before[:-1]
    assert files[len(first) - 1].read_bytes().startswith(before[-1])
    assert b"".join(file.read_bytes() for file in files) == tlog_of(FRAMES)


def test_what_cannot_be_begun_is_gone_on_with(tmp_path: Path) -> None:
    """Where the next file cannot be opened, the present one grows on; it is told once."""
    said: list[str] = []
    path = tmp_path / "live.tlog"
    with contextlib.closing(opened(path, said, max_mb=0.005)) as sink:
        (tmp_path / "live_part002.tlog").mkdir()
        for start in range(0, len(FRAMES), 7):
            sink.frames(0, FRAMES[start : start + 7])
    assert path.read_bytes() == tlog_of(FRAMES)
    (text,) = said
    assert "live_part002.tlog: it is a folder; going on in " in text


@pytest.mark.parametrize(
    ("asked", "limits", "said"),
    [
        ({}, {"record": {"max-mb": 5.0}}, "--record-max-mb is for --record, which is missing"),
        ({"record": "x.tlog"}, {"record": {"max-mb": 0.0}}, "--record-max-mb 0: must be above 0"),
        ({"record": "x.tlog"}, {"record": {"max-minutes": float("nan")}}, "--record-max-minutes nan: must be above 0"),
    ],
)
def test_limits_that_mean_nothing(asked: dict[str, str], limits: dict[str, dict[str, float]], said: str) -> None:
    """Refused at once."""
    with pytest.raises(UsageError, match=said):
        plan_sinks(asked, limits)


def test_files_that_were_moved_away(tmp_path: Path) -> None:
    """As log rotation does: each link goes on in a new file of the same name, whose limits count from its own start."""
    frames = fixture("e_two_vehicles", to_s=3)
    half = len(frames) // 2
    live = recorder(tmp_path / "f.tlog", links=("tcp:a:1", "tcp:b:2"), max_minutes=2.5 / 60)
    paths = [tmp_path / "f_tcp-a-1.tlog", tmp_path / "f_tcp-b-2.tlog"]
    for link in (0, 1):
        live.frames(link, frames[:half])
    for path in paths:
        path.rename(path.with_suffix(".1"))
    live.reopen()
    for link in (0, 1):
        live.frames(link, frames[half:])
    live.close()
    for path in paths:
        assert path.with_suffix(".1").read_bytes() == tlog_of(frames[:half])
        assert path.read_bytes() == tlog_of(frames[half:])
    assert len([*tmp_path.iterdir()]) == 4


def test_another_file_under_the_name_is_left_alone(tmp_path: Path) -> None:
    """What is no recording is not appended to, then either: the old file is gone on with."""
    frames = fixture("e_two_vehicles", to_s=1)
    said: list[str] = []
    path = tmp_path / "f.tlog"
    context = SinkContext(title="x", links=("a",), note=said.append, complain=said.append, stack=ExitStack())
    live = TlogRecorder.plan(str(path)).open(context)
    live.frames(0, frames[:9])
    path.rename(tmp_path / "moved")
    path.write_bytes(b"a letter")
    live.reopen()
    live.frames(0, frames[9:])
    live.close()
    assert path.read_bytes() == b"a letter"
    assert (tmp_path / "moved").read_bytes() == tlog_of(frames)
    assert len(said) == 1
    assert said[0].endswith("; going on as before")


def test_a_file_a_link(tmp_path: Path) -> None:
    """Named after the link; what came on one is in none of the others."""
    links = ["udpin:0.0.0.0:14550", "/dev/ttyACM0", "/dev/tty:ACM0", "tcp:[::1]:5760"]
    path = tmp_path / "live.tlog"
    with contextlib.closing(recorder(path, links=links)) as sink:
        for start in range(0, len(FRAMES), 9):
            sink.frames(start // 9 % 4, FRAMES[start : start + 9])
    names = [
        "live_udpin-0.0.0.0-14550.tlog",
        "live_dev-ttyACM0.tlog",
        "live_dev-tty-ACM0.tlog",
        "live_tcp-1-5760.tlog",
    ]
    assert sorted(file.name for file in tmp_path.iterdir()) == sorted(names)
    for number, name in enumerate(names):
        of_link = [frame for place, frame in enumerate(FRAMES) if place // 9 % 4 == number]
        assert (tmp_path / name).read_bytes() == tlog_of(of_link)


def test_links_of_like_names_have_files_of_their_own(tmp_path: Path) -> None:
    """What a file's name cannot hold may be all that tells two links apart."""
    with contextlib.closing(recorder(tmp_path / "a.tlog", links=["/dev/a-b", "/dev/a:b"])):
        assert sorted(file.name for file in tmp_path.iterdir()) == ["a_dev-a-b-link0.tlog", "a_dev-a-b-link1.tlog"]


def test_into_a_pipe(tmp_path: Path) -> None:
    """Whoever reads it gets every record; nothing is read from it, or cut off."""
    pipe = tmp_path / "live.tlog"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    with contextlib.closing(recorder(pipe, max_minutes=10)) as sink:
        sink.frames(0, FRAMES[:50])
        assert os.read(reader, 2**16) == tlog_of(FRAMES[:50])
    os.close(reader)


# --- what is not kept ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("signed", [False, True])
def test_a_signing_key_is_not_recorded(signed: bool, tmp_path: Path) -> None:
    """Neither plain nor signed; what only looks like it is."""
    secret = bytes(range(100, 132))
    key = bytes(32) if signed else None
    setup = pack(mavlink.MAVLink_setup_signing_message(1, 1, secret, 12345), key=key)
    assert secret in setup
    # Version 1's ids end at 255: what stands where version 2 has its id is a part of what it says.
    alike = pack(mavlink.MAVLink_ping_message(0x0000_0000_0001_0000, 7, 0, 0), version=1)
    assert alike[7:10] != alike[8:11]
    frames = [RawFrame(1_700_000_000_000_000 + place, data) for place, data in enumerate((alike, setup, alike))]
    (path,) = written(tmp_path / "live.tlog", frames)
    assert path.read_bytes() == tlog_of([frames[0], frames[2]])
