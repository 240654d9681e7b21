"""The doctor on live links of each kind, with somebody, nobody or noise at the other end."""

import contextlib
import errno
import json
import os
import random
import re
import signal
import socket
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence

import pytest

import gcs_bridge.links.open as opening
from gcs_bridge.inspection.examine import EXIT_CODES, examine
from gcs_bridge.inspection.listening import listen_to
from gcs_bridge.inspection.machine import machine
from gcs_bridge.inspection.schema import Advice, Examination, Station, Vehicle
from gcs_bridge.links.port_owner import port_owner
from gcs_bridge.links.stream_links import SerialLink
from gcs_bridge.links.uri import NetworkUri, SerialUri, Uri
from gcs_bridge.settings import load_settings
from tests.helpers.examined import examined, said
from tests.helpers.live_links import Process, fixture, free_port, terminals, wait_until
from tests.helpers.multicast import GROUP, Group, multicast_works
from tests.helpers.paths import ROOT

FLIGHT = fixture("a_copter_square", to_s=3.0)[:150]
NAMES = {0: "HEARTBEAT", 30: "ATTITUDE", 31: "ATTITUDE_QUATERNION", 27: "RAW_IMU"}
Send = Callable[[bytes], object]


def listened(uris: Sequence[Uri], act: Callable[[], object], *, rounds: int = 5) -> Examination:
    """Listen: `act` once all links are open, then so many rounds of the loop more."""
    left = [rounds]

    def stop() -> bool:
        if left[0] == rounds:
            act()
        left[0] -= 1
        return left[0] < 0

    found = listen_to(uris, load_settings("default"), "all", duration_s=20.0, stop=stop, note=lambda _: None)
    return examine(found)


def advice(found: Examination, code: str) -> Advice:
    (one,) = [one for one in found.advice if one.code == code]
    return one


@contextlib.contextmanager
def udpin() -> Iterator[tuple[Uri, Send]]:
    uri = NetworkUri("udpin", "127.0.0.1", free_port())
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        yield uri, lambda data: sender.sendto(data, ("127.0.0.1", uri.port))


@contextlib.contextmanager
def mcast() -> Iterator[tuple[Uri, Send]]:
    if not multicast_works():
        pytest.skip("no multicast on this machine")
    group = Group(free_port())
    with contextlib.closing(group):
        yield NetworkUri("mcast", GROUP, group.port), group.send


@contextlib.contextmanager
def tcp() -> Iterator[tuple[Uri, Send]]:
    with socket.create_server(("127.0.0.1", 0)) as server, contextlib.ExitStack() as stack:
        peers: list[socket.socket] = []

        def send(data: bytes) -> None:
            if not peers:
                peers.append(stack.enter_context(server.accept()[0]))
            peers[0].sendall(data)

        yield NetworkUri("tcp", "127.0.0.1", server.getsockname()[1]), send


@contextlib.contextmanager
def tcpin() -> Iterator[tuple[Uri, Send]]:
    uri = NetworkUri("tcpin", "127.0.0.1", free_port(socket.SOCK_STREAM))
    with contextlib.ExitStack() as stack:
        clients: list[socket.socket] = []

        def send(data: bytes) -> None:
            if not clients:
                clients.append(stack.enter_context(socket.create_connection((uri.host, uri.port))))
            clients[0].sendall(data)

        yield uri, send


@contextlib.contextmanager
def serial() -> Iterator[tuple[Uri, Send]]:
    with terminals() as (master, device):
        yield SerialUri(device, 57600), lambda data: os.write(master, data)


@pytest.mark.parametrize("kind", [udpin, mcast, tcp, tcpin, serial])
def test_the_inventory_of_each_kind_of_link(
    kind: Callable[[], contextlib.AbstractContextManager[tuple[Uri, Send]]],
) -> None:
    """As many of each message as were sent, a vehicle that lacks nothing, and ages that are known."""
    sent = FLIGHT if kind is not serial else FLIGHT[:50]  # a terminal holds 4 kB
    with kind() as (uri, send):
        found = listened([uri], lambda: [send(frame.data) for frame in sent])
    (link,), (vehicle,) = found.links, found.vehicles
    assert (link.kind, link.finding, link.frames) == (kind.__name__, "good", len(sent))
    total: Counter[str] = Counter()
    everybody: list[Vehicle | Station] = [*found.vehicles, *found.stations]
    for one in everybody:
        total.update({name: message.count for name, message in one.messages.items()})
    ids = Counter(int.from_bytes(frame.data[7:10], "little") for frame in sent)
    assert {name: total[name] for name in NAMES.values()} == {name: ids[msgid] for msgid, name in NAMES.items()}
    assert total.total() == len(sent)
    age_s = vehicle.messages["ATTITUDE"].age_s
    assert age_s is not None
    assert 0 <= age_s < 20
    assert (vehicle.address is not None) == (kind in (udpin, mcast))


def test_what_is_missing_live_is_asked_for_by_this_program() -> None:
    """The command names the link as it was typed; PX4's shell is told which port of its own it is."""
    frames = [one for one in fixture("p_px4_quad_square", to_s=3.0) if one.data[7] in (0, 30)][:60]
    with udpin() as (uri, _), contextlib.ExitStack() as stack:
        sender = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        sender.bind(("127.0.0.1", 0))
        assert isinstance(uri, NetworkUri)
        to = ("127.0.0.1", uri.port)
        found = listened([uri], lambda: [sender.sendto(one.data, to) for one in frames])
        port = sender.getsockname()[1]
    (vehicle,) = found.vehicles
    assert vehicle.address == f"127.0.0.1:{port}"
    assert [one.command for one in vehicle.missing] == [
        f"mavlink stream -u {port} -s ATTITUDE_QUATERNION -r 25",
        f"mavlink stream -u {port} -s HIGHRES_IMU -r 25",
    ]
    assert advice(found, "missing_message").command == f"gcs-bridge listen {uri} --request-rates 25"
    assert found.finding == "missing"


@pytest.mark.parametrize("kind", [udpin, tcp, tcpin, serial])
def test_a_dead_link(kind: Callable[[], contextlib.AbstractContextManager[tuple[Uri, Send]]]) -> None:
    """Not a byte: what to look at hangs on the kind of link."""
    with kind() as (uri, _):
        found = listened([uri], lambda: None, rounds=1)
    assert (found.finding, [one.code for one in found.advice]) == ("unusable", ["no_bytes"])
    assert found.links[0].bytes == 0


def test_a_link_that_goes() -> None:
    """What came before is told, and that it went."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def act() -> None:
            peer, _ = server.accept()
            with peer:
                for frame in FLIGHT:
                    peer.sendall(frame.data)
            server.close()

        found = listened([NetworkUri("tcp", "127.0.0.1", server.getsockname()[1])], act)
    assert "the other side has closed the connection" in advice(found, "link_down").text
    assert (found.finding, found.links[0].frames) == ("good", len(FLIGHT))


def test_a_wrong_speed() -> None:
    """Noise on a serial line: the speed that was read at, others to try, and the command for the likeliest."""
    noise = random.Random(3).randbytes(2000)
    with serial() as (uri, send):
        found = listened([uri], lambda: send(noise))
        assert isinstance(uri, SerialUri)
        one = advice(found, "wrong_baud")
        assert one.command == f"gcs-bridge doctor {uri.device} --baud 115200"
    assert "--baud 57600" in one.text
    assert (found.finding, found.links[0].bytes) == ("unusable", 2000)


def test_noise_on_a_socket() -> None:
    """Bytes that are no frame, where there is no speed."""
    with udpin() as (uri, send):
        found = listened([uri], lambda: [send(b"hello, are you there?") for _ in range(20)])
    assert [one.code for one in found.advice] == ["no_frames"]


def test_one_link_that_cannot_be_opened_is_no_reason_not_to_look_at_another() -> None:
    """Why it cannot is told, with a name that stays; the other one is good, and the whole is not."""
    with udpin() as (uri, send), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        taken = NetworkUri("udpin", "127.0.0.1", other.getsockname()[1])
        found = listened([taken, uri], lambda: [send(frame.data) for frame in FLIGHT])
    assert [(one.name, one.finding) for one in found.links] == [(str(taken), "unusable"), (str(uri), "good")]
    one = advice(found, "port_in_use")
    assert one.link == str(taken)
    if sys.platform == "linux":
        assert f"(process {os.getpid()})" in one.text
    assert [vehicle.link for vehicle in found.vehicles] == [str(uri)]


@pytest.mark.parametrize(
    ("uri", "code"),
    [
        ("tcp:127.0.0.1:9", "connection_refused"),
        ("udpin:no-such-host.invalid:14550", "unknown_host"),
        ("udpin:192.0.2.7:14550", "no_such_address"),
        ("/dev/ttyNONE0", "no_such_device"),
        ("/dev/null", "no_serial_device"),
    ],
)
def test_links_that_cannot_be_opened(uri: str, code: str) -> None:
    """Each by a code that stays; it ends with 3."""
    found = examined(uri, "--duration", "0.1")
    assert (found.code, found.codes) == (3, [code])


def test_the_command_listens_and_ends() -> None:
    """For as long as was asked; that it listens is told on standard error, the result alone on standard output."""
    code, out, err = said(f"udpin:127.0.0.1:{free_port()}", "--duration", "0.2", "--no-color")
    assert code == 3
    assert "listening for 0.2 s" in err
    assert out.splitlines()[-3].startswith("UNUSABLE")


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="whether it listens is told by /proc")
def test_an_interrupt_ends_it_with_what_came() -> None:
    """Ctrl-C is no mistake: what was heard until then is told, whole."""
    port = free_port()
    with Process("doctor", f"udpin:127.0.0.1:{port}", "--duration", "600", "--format", "json") as process:
        wait_until(lambda: port_owner(port, "udp") is not None, 60.0)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for frame in FLIGHT:
                sender.sendto(frame.data, ("127.0.0.1", port))
        process.signal(signal.SIGINT)
        code, _ = process.ended()
        told = json.loads("".join(process.said))
    assert code == EXIT_CODES[told["finding"]]


# --- codes ----------------------------------------------------------------------------------------------------------


def test_every_code_is_on_the_page() -> None:
    """Programs and people look for them there; none is there that is gone."""
    sources = [ROOT / "gcs_bridge" / name for name in ("inspection/advice.py", "links/open.py")]
    code = "".join(path.read_text(encoding="utf-8") for path in sources)
    codes = set(re.findall(r'(?:_Reason\(|_of\(\s*\w+,\s*|"code", )"(\w+)"', code))
    page = (ROOT / "docs" / "field.md").read_text(encoding="utf-8").split("## What is on a link")[1].split("\n## ")[0]
    named = {
        name for row in re.findall(r"^\| \d \| (.*) \|$", page, re.MULTILINE) for name in re.findall(r"`(\w+)`", row)
    }
    assert len(codes) > 30
    assert named == codes


def refused(monkeypatch: pytest.MonkeyPatch, number: int) -> list[Advice]:
    """What is said of a device that the system refuses so."""

    def refuse(*_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setitem(opening.OPENERS, "serial", (SerialLink, refuse))
    return list(listened([SerialUri("/dev/ttyNONE0", 57600)], lambda: None).advice)


def test_a_device_of_another_group(monkeypatch: pytest.MonkeyPatch) -> None:
    """The command that joins it."""
    (one,) = refused(monkeypatch, errno.EACCES)
    assert (one.code, one.command) == ("not_in_group", "sudo usermod -aG dialout $USER")


@pytest.mark.parametrize(
    ("runs", "code", "command"),
    [
        (True, "held_by_modem_manager", "sudo systemctl stop ModemManager"),
        (False, "device_held", "sudo fuser -v /dev/ttyNONE0"),
    ],
)
def test_a_device_that_somebody_holds(runs: bool, code: str, command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """By ModemManager, which is ended otherwise than others."""
    monkeypatch.setattr(opening, "device_owner", lambda _: None)
    monkeypatch.setattr(opening, "is_running", lambda _: runs)
    (one,) = refused(monkeypatch, errno.EBUSY)
    assert (one.code, one.command) == (code, command)


@pytest.mark.skipif(sys.platform != "linux", reason="groups are Linux's matter")
def test_a_user_who_may_not_use_serial_devices(monkeypatch: pytest.MonkeyPatch) -> None:
    """This machine's part says which group to join; who is in it is in order."""
    import grp

    group = grp.getgrgid(0)
    monkeypatch.setattr(opening, "serial_devices", lambda: ["/dev/ttyNONE0"])
    monkeypatch.setattr(opening, "device_group", lambda _: group.gr_name)
    monkeypatch.setattr(os, "geteuid", lambda: 4711)
    monkeypatch.setattr(os, "getegid", lambda: 4711)
    monkeypatch.setattr(os, "getgroups", lambda: [4711])
    part = machine()["groups"]
    assert (part.state, part.command) == ("mend", f"sudo usermod -aG {group.gr_name} $USER")
    monkeypatch.setattr(os, "getgroups", lambda: [4711, group.gr_gid])
    assert machine()["groups"].state == "good"
