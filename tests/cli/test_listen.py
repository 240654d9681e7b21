"""`gcs-bridge listen` and `demo` as people and services run them."""

import contextlib
import json
import os
import re
import signal
import socket
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

import gcs_bridge
from gcs_bridge.cli import main
from gcs_bridge.mavlink.scanner import RawFrame
from tests.helpers.live_links import (
    Process,
    fixture,
    frames_of,
    free_port,
    judgement,
    paced,
    recorded_judgement,
    tcp_sender,
    tlog_of,
    wait_until,
)
from tests.helpers.paths import FIXTURES

FLIGHT = fixture("a_copter_square", from_s=75, to_s=80, fault="yaw_offset:25")
ALARMING = fixture("d_plane_pitchtrim3", to_s=12, fault="yaw_offset:25")  # on top of the trim
LONGEST_RECORD = 8 + 280  # a receive time, and a frame of MAVLink 2
ALARM = "ALARM euler_quaternion: ATTITUDE and ATTITUDE_QUATERNION are not one rotation: 25.00°"
NO_VIEWER = ("--viewer", "none")


@contextlib.contextmanager
def vehicle(port: int, frames: Sequence[RawFrame], speed: float = 1.0) -> Iterator[threading.Thread]:
    """Somebody who sends frames to a UDP port of this machine."""

    def send() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender, contextlib.suppress(ConnectionError):
            paced(frames, lambda data: sender.sendto(data, ("127.0.0.1", port)), speed)

    thread = threading.Thread(target=send, daemon=True)
    thread.start()
    yield thread
    thread.join()


def listening(port: int, *options: str) -> Process:
    return Process("listen", f"udpin:127.0.0.1:{port}", *NO_VIEWER, *options)


@pytest.mark.slow
def test_the_alarms_of_check(tmp_path: Path) -> None:
    """Over UDP and TCP; and the recordings give them again."""
    port = free_port()
    udp_tlog, tcp_tlog = tmp_path / "udp.tlog", tmp_path / "tcp.tlog"
    udp_events, tcp_events = tmp_path / "udp.jsonl", tmp_path / "tcp.jsonl"
    flight = tmp_path / "flight.tlog"
    flight.write_bytes(tlog_of(FLIGHT))
    with (
        tcp_sender(FLIGHT, 3.0) as (tcp_port, _),
        listening(port, "--record", str(udp_tlog), "--events", str(udp_events)) as udp,
        Process(
            "listen",
            f"tcp:127.0.0.1:{tcp_port}",
            "--viewer=none",
            "--record",
            str(tcp_tlog),
            "--events",
            str(tcp_events),
        ) as tcp,
    ):
        udp.wait_for("link up")
        with vehicle(port, FLIGHT, speed=3.0):
            pass
        wait_until(lambda: udp_tlog.stat().st_size == flight.stat().st_size)
        udp.signal(signal.SIGTERM)
        assert udp.ended() == (0, "")
        tcp.wait_for("link down")
        tcp.signal(signal.SIGTERM)
        code, notes = tcp.ended()
        assert code == 0
        assert re.fullmatch(r"(gcs-bridge: note: a link has gone, and .*\n)?", notes)  # where it has been gone for long
    expected = gcs_bridge.check(flight).to_dict()["files"][0]
    (alarm,) = expected["vehicles"][0]["alarms"]
    for tlog, events, process in ((udp_tlog, udp_events, udp), (tcp_tlog, tcp_events, tcp)):
        assert judgement(gcs_bridge.check(tlog).to_dict()["files"][0]) == judgement(expected)
        told = [json.loads(line) for line in events.read_text().splitlines()]
        raised = [event for event in told if event["event"] == "alarm_raised"]
        assert [(event["id"], event["boot_s"]) for event in raised] == [(alarm["id"], alarm["raised_boot_s"])]
        assert ALARM in "".join(process.said)
        assert ": 1 vehicle, 1 alarm: euler_quaternion at " in process.said[-1]


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signals_end_within_a_second(number: signal.Signals, tmp_path: Path) -> None:
    """With 0, a summary, and files that are closed and whole, while data come; at the best of three."""
    assert any(seconds_to_end(number, tmp_path / f"{turn}.tlog") < 1.0 for turn in range(3))


def seconds_to_end(number: signal.Signals, tlog: Path) -> float:
    port = free_port()
    with listening(port, "--record", str(tlog)) as process:
        process.wait_for("link up")
        with vehicle(port, FLIGHT[:150]):
            process.wait_for("ATTITUDE_QUATERNION started")
            asked_s = time.monotonic()
            process.signal(number)
            assert process.ended() == (0, "")
            took_s = time.monotonic() - asked_s
    summary = process.said[-1]  # of a second of flight, or of so little that nothing was compared
    assert summary.startswith(("AGREE ", "NO COMPARE "))
    assert f"udpin:127.0.0.1:{port}: 1 vehicle" in summary
    assert tlog_of(frames_of(tlog.read_bytes())) == tlog.read_bytes()
    return took_s


@pytest.mark.slow
def test_a_signal_while_nothing_comes() -> None:
    """A quiet link ends too, and says that nothing was received."""
    with listening(free_port()) as process:
        process.wait_for("link up")
        process.signal(signal.SIGTERM)
        code, said = process.ended()
    assert code == 0
    assert said.startswith("gcs-bridge: note: nothing was received")
    assert process.said[-1].startswith("NO COMPARE")


@pytest.mark.slow
def test_killed(tmp_path: Path) -> None:
    """After kill −9 the recording has every frame that was judged, and its alarms.

    Behind them a part of the record that was being written may stay; the next run on this file cuts it off.
    """
    port, tlog, events = free_port(), tmp_path / "live.tlog", tmp_path / "events.jsonl"
    frames = ALARMING
    with listening(port, "--record", str(tlog), "--events", str(events)) as process:
        process.wait_for("link up")
        with vehicle(port, frames, speed=12):
            process.wait_for("ALARM")
            process.signal(signal.SIGKILL)
            assert process.ended()[0] == -signal.SIGKILL
    recorded = frames_of(tlog.read_bytes())
    assert [frame.data for frame in recorded] == [frame.data for frame in frames[: len(recorded)]]
    whole = tlog_of(recorded)
    assert tlog.read_bytes().startswith(whole)
    assert len(tlog.read_bytes()) - len(whole) < LONGEST_RECORD
    (told,) = [e for e in map(json.loads, events.read_text().splitlines()) if e["event"] == "alarm_raised"]
    (alarm,) = gcs_bridge.check(tlog).to_dict()["files"][0]["vehicles"][0]["alarms"]
    assert (alarm["id"], alarm["raised_boot_s"]) == (told["id"], told["boot_s"])


@pytest.mark.slow
def test_events_on_standard_output(tmp_path: Path) -> None:
    """With `--events -` standard output is JSON lines and nothing else; the summary goes to standard error."""
    port = free_port()
    with listening(port, "--events", "-") as process:
        process.wait_for('"link_up"')
        with vehicle(port, fixture("e_two_vehicles", to_s=6), speed=10):
            process.wait_for('"vehicle":[2,1]')
        process.signal(signal.SIGTERM)
        code, said = process.ended()
    told = [json.loads(line) for line in process.said]
    assert code == 0
    assert told[0]["event"] == "link_up"
    assert {tuple(event["vehicle"]) for event in told if event["event"] == "vehicle_seen"} == {(1, 1), (2, 1)}
    assert all(event["link"] == f"udpin:127.0.0.1:{port}" for event in told)
    assert said == f"AGREE       udpin:127.0.0.1:{port}: 2 vehicles, no alarm\n"


@pytest.mark.slow
def test_quiet(tmp_path: Path) -> None:
    """-q shows alarms, and the summary."""
    port, events = free_port(), tmp_path / "events.jsonl"
    with listening(port, "-q", "--events", str(events)) as process:
        wait_until(lambda: events.exists() and b"link_up" in events.read_bytes())
        with vehicle(port, ALARMING, speed=12):
            process.wait_for("ALARM")
        process.signal(signal.SIGTERM)
        assert process.ended() == (0, "")
    raised, summary = process.said
    assert raised.endswith(f"  {ALARM}, tilt 0.00°, heading 25.00°\n")
    assert summary.startswith(f"ALARM       udpin:127.0.0.1:{port}: 1 vehicle, 1 alarm: euler_quaternion at ")


@pytest.mark.slow
def test_a_closed_pipe_ends_it(tmp_path: Path) -> None:
    """`listen | head -1`: whoever reads has gone, the files are closed, the exit code is that of a broken pipe."""
    port, tlog = free_port(), tmp_path / "live.tlog"
    with listening(port, "--record", str(tlog)) as process:
        process.wait_for("link up")
        process.close_stdout()
        with vehicle(port, FLIGHT[:300], speed=3):
            pass
        assert process.ended()[0] == 141
    assert frames_of(tlog.read_bytes())


@pytest.mark.slow
def test_a_file_a_link(tmp_path: Path) -> None:
    """Two links, one recording asked for: two files, each named after its link, which give back that link's alarms."""
    ports = free_port(), free_port(socket.SOCK_STREAM)
    uris = f"udpin:127.0.0.1:{ports[0]}", f"tcpin:127.0.0.1:{ports[1]}"
    events = tmp_path / "events.jsonl"
    with Process(
        "listen", *uris, *NO_VIEWER, "--record", str(tmp_path / "live.tlog"), "--events", str(events)
    ) as process:
        process.wait_for(f"link up: {uris[1]}")
        with vehicle(ports[0], ALARMING, speed=12), socket.create_connection(("127.0.0.1", ports[1])) as client:
            paced(FLIGHT, client.sendall, 12)
        process.wait_for("link down")
        process.signal(signal.SIGTERM)
        code, said = process.ended()
    assert code == 0
    assert "each link is recorded in a file of its own: " in said
    told = [json.loads(line) for line in events.read_text().splitlines()]
    for uri in uris:
        path = tmp_path / f"live_{uri.replace(':', '-')}.tlog"
        (entry,) = gcs_bridge.check(path).to_dict()["files"]
        kept = [(alarm["check"], alarm["raised_boot_s"]) for one in entry["vehicles"] for alarm in one["alarms"]]
        raised = [event for event in told if event["event"] == "alarm_raised" and event["link"] == uri]
        assert [(event["check"], event["boot_s"]) for event in raised] == kept
        assert len(kept) == 1
    assert len(list(tmp_path.glob("live*"))) == 2


@pytest.mark.slow
def test_a_link_that_has_gone_ends_nothing(tmp_path: Path) -> None:
    """The server goes for good: what was asked for is still kept, until --duration or a signal; then it is 0."""
    with tcp_sender(FLIGHT, 12) as (port, _), Process("listen", f"tcp:127.0.0.1:{port}", *NO_VIEWER) as process:
        process.wait_for("link down")
        process.wait_for("vehicle LOST")
        process.signal(signal.SIGTERM)
        code, said = process.ended()
    assert code == 0
    assert said.startswith(f"gcs-bridge: note: a link has gone, and is tried again and again: tcp:127.0.0.1:{port}: ")
    assert said.count("\n") == 1


# --- refusals --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["listen"], 2, "Missing argument"),
        (["listen", "udpout:127.0.0.1:14550"], 2, "cannot receive before it has sent"),
        (
            ["listen", "udpout:127.0.0.1:14550", "--relay=udpout:127.0.0.1:14551"],
            2,
            "cannot receive before it has sent",
        ),
        (
            ["listen", "udpin:0.0.0.0:14550", "--relay=udp:127.0.0.1:14551"],
            2,
            "is not a relay: that is written udpout:",
        ),
        (["listen", "udpin:0.0.0.0:14550", "--relay=udpout:127.0.0.1:14550"], 2, "name another port"),
        (["listen", "udpin:0.0.0.0:14550", "--relay-both-ways"], 2, "there is no --relay"),
        (["listen", "udpin:0.0.0.0:14550", "--request-rates=0"], 2, "--request-rates 0: must be above 0"),
        (["listen", "udpin:0.0.0.0:14550", "--request-rates=x"], 2, "--request-rates"),
        (["demo", "--act-as-gcs"], 2, "--act-as-gcs"),
        (["listen", "udpni:0.0.0.0:14550"], 2, "did you mean 'udpin:0.0.0.0:14550'"),
        (["listen", str(FIXTURES / "f_reboot.tlog")], 2, "gcs-bridge check"),
        (["listen", "udpin:0.0.0.0:14550", "udpin:0.0.0.0:14550"], 2, "is named twice"),
        (["listen", "udpin:0.0.0.0:14550", "--duration", "0"], 2, "--duration 0: must be above 0"),
        (["listen", "udpin:0.0.0.0:14550", "--duration", "nan"], 2, "--duration nan: must be above 0"),
        (["listen", "udpin:0.0.0.0:14550", "--baud", "0"], 2, "--baud"),
        (["listen", "udpin:0.0.0.0:14550", "--record", "none/x.tlog"], 2, "there is no folder"),
        (["listen", "udpin:0.0.0.0:14550", "--events", "."], 2, "it is a folder"),
        (["listen", "udpin:0.0.0.0:14550", "--record", "x", "--events", "./x"], 2, "cannot both write x"),
        (
            ["listen", "udpin:0.0.0.0:14550", "--record-max-mb", "5"],
            2,
            "--record-max-mb is for --record, which is missing",
        ),
        (["listen", "udpin:0.0.0.0:14550", "--record=x", "--record-max-minutes=0"], 2, "0: must be above 0"),
        (["listen", "mcast:", "mcast:14550"], 2, "mcast:239.255.145.50:14550 is named twice"),
        (["listen", "udpin:0.0.0.0:14550", "--profile", "cii"], 2, "did you mean 'ci'?"),
        (["listen", "udpin:0.0.0.0:14550", "--dialect", "nope"], 2, "unknown dialect 'nope'"),
        (["listen", "udpin:0.0.0.0:14550", "--viewer", "bogus"], 2, "bogus"),
        (["listen", "/dev/ttyNONE0", "--viewer", "none"], 3, "/dev/ttyNONE0: no such device"),
        (["listen", "tcp:127.0.0.1:9", "--viewer", "none"], 3, "connection refused"),
        (["listen", f"udpin:127.0.0.1:{free_port()}", "tcp:127.0.0.1:9", "--viewer=none"], 3, "connection refused"),
        (["demo", "--speed", "0"], 2, "--speed 0: must be above 0"),
        (["demo", "--duration", "-3"], 2, "--duration -3: must be above 0"),
    ],
)
def test_refusals_are_one_line(
    arguments: list[str],
    code: int,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Exit code 2 for what was asked wrongly, 3 for a link that cannot be used; nothing on standard output."""
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == code
    shown = capsys.readouterr()
    assert shown.out == ""
    assert said in shown.err
    assert shown.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_port_in_use(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """One line, with who has it, exit code 3, and no file is left behind."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        arguments = [f"udpin:127.0.0.1:{port}", "--viewer", "none", "--record", str(tmp_path / "live.tlog")]
        assert main(["listen", *arguments]) == 3
    said = capsys.readouterr().err
    assert said.startswith(f"gcs-bridge: error: udpin:127.0.0.1:{port}: port {port} is in use")
    if sys.platform == "linux":
        assert f"(process {os.getpid()})" in said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_recording_that_fails_is_told(capfd: pytest.CaptureFixture[str]) -> None:
    """Listening goes on to its end, which is 2: an output could not be written."""
    port = free_port()
    with vehicle(port, fixture("e_two_vehicles", to_s=14), speed=10):
        assert main(["listen", f"udpin:127.0.0.1:{port}", "--viewer=none", "--record=/dev/full", "--duration=1.5"]) == 2
    shown = capfd.readouterr()
    assert shown.err.count("\n") == 1
    assert "cannot write /dev/full: No space left on device" in shown.err
    assert "2 vehicles, no alarm" in shown.out


@pytest.mark.slow
def test_without_a_viewer_rerun_is_not_loaded() -> None:
    """`--viewer none` works where the viewer cannot even be imported."""
    program = (
        "import sys; sys.modules['rerun'] = None; from gcs_bridge.cli import main; "
        f"sys.exit(main(['listen', 'udpin:127.0.0.1:{free_port()}', '--viewer', 'none', '--duration', '0.3']))"
    )
    with Process(program=[sys.executable, "-c", program]) as process:
        assert process.ended()[0] == 0


# --- demo ------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_demo(tmp_path: Path) -> None:
    """It ends by itself, raises its one alarm after half of its time, and says what to type next."""
    events = tmp_path / "events.jsonl"
    began_s = time.monotonic()
    with Process("demo", "--viewer", "none", "--duration", "3", "--speed", "5", "--events", str(events)) as process:
        code, said = process.ended()
    assert code == 0
    assert time.monotonic() - began_s > 3
    assert said.startswith("gcs-bridge: note: a recorded flight plays for 3 s to udpin:127.0.0.1:")
    told = [json.loads(line) for line in events.read_text().splitlines()]
    (alarm,) = [event for event in told if event["event"] == "alarm_raised"]
    started = next(event for event in told if event["event"] == "stream_started")
    assert alarm["peak"] == pytest.approx(25.0, abs=0.01)
    assert alarm["boot_s"] - started["boot_s"] == pytest.approx(8.5, abs=0.5)
    shown = "".join(process.said)
    assert ALARM in shown
    assert "and its alarm: a difference of 25°" in shown
    assert process.said[-1] == "  gcs-bridge listen udpin:0.0.0.0:14550\n"


@pytest.mark.slow
def test_demo_is_quick_to_show_its_alarm() -> None:
    """As it is by default: 40 s, and the alarm within the first 30."""
    from gcs_bridge.cli.demo import _flight, demo
    from gcs_bridge.resources import demo_recording

    (duration,) = [option.default for option in demo.params if option.name == "duration_s"]
    assert duration == 40.0
    frames, half_s = _flight(demo_recording(), duration)
    (vehicle_entry,) = recorded_judgement(tlog_of(frames))
    (alarm,) = vehicle_entry["alarms"]
    assert half_s == pytest.approx(20.0, abs=0.1)
    assert alarm["raised_boot_s"] - vehicle_entry["boots"][0][0] == pytest.approx(21.0, abs=0.3)


@pytest.mark.parametrize("seconds", [1.0, 1000.0])
def test_demo_of_any_length(seconds: float) -> None:
    """As much of the flight as there is, and never more."""
    from gcs_bridge.cli.demo import _flight
    from gcs_bridge.resources import demo_recording

    frames, half_s = _flight(demo_recording(), seconds)
    lasts_s = (frames[-1].t_rx_us - frames[0].t_rx_us) / 1e6
    assert lasts_s == pytest.approx(min(seconds, 120), abs=2.5)
    assert half_s == pytest.approx(lasts_s / 2, abs=0.1)
