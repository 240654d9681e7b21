"""What leaves while links are listened to: to whom, as whom, and what never does."""

import contextlib
import select
import socket
import time
from collections.abc import Iterator
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from gcs_bridge.errors import UsageError
from gcs_bridge.links.link import Link
from gcs_bridge.links.open import open_link
from gcs_bridge.links.uri import NetworkUri
from gcs_bridge.sending import station as station_module
from gcs_bridge.sending.asked import Asked
from tests.helpers.autopilot import ATTITUDE, QUATERNION, RAW_IMU, Autopilot, setup_signing, station_message
from tests.helpers.flying import GroundStation, udp_server_vehicle, udp_vehicle
from tests.helpers.live_links import Live, fixture, free_port, paced, wait_until

pytestmark = pytest.mark.slow

ALARMING = fixture("d_plane_pitchtrim3", to_s=12, fault="yaw_offset:25")


def udp_link() -> tuple[Link, int]:
    port = free_port()
    return open_link(NetworkUri("udpin", "127.0.0.1", port)), port


def relay_to(*stations: GroundStation, **more: Any) -> Asked:
    return Asked(relays=tuple(NetworkUri("udpout", "127.0.0.1", one.port) for one in stations), **more)


@contextlib.contextmanager
def relayed(*, both_ways: bool) -> Iterator[tuple[GroundStation, Autopilot, int]]:
    """A station on a relay, the vehicle that it sees, and the port at which that is heard."""
    vehicle = Autopilot(rates_hz={ATTITUDE: 20.0})
    link, port = udp_link()
    with (
        GroundStation() as station,
        Live(link, asked=relay_to(station, both_ways=both_ways)),
        udp_vehicle(vehicle, port),
    ):
        yield station, vehicle, port


def parameter_request(target: int = 1, system: int = 255) -> bytes:
    return station_message(mavlink.MAVLink_param_request_list_message(target, 1), system)


# --- relay -----------------------------------------------------------------------------------------------------------


def test_what_comes_is_relayed_byte_for_byte() -> None:
    """To each relay: signed frames with their signature, all in order; but for three that carry the secret."""
    frames = [*fixture("g_signed", to_s=3)]
    relayed = [frame.data for frame in frames if frame.data[7:10] != b"\0\1\0"]
    assert len(relayed) == len(frames) - 3
    link, port = udp_link()
    with (
        GroundStation() as one,
        GroundStation() as other,
        Live(link, asked=relay_to(one, other)),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        sender.connect(("127.0.0.1", port))
        paced(frames, sender.send, 10)
        wait_until(lambda: len(one.listen().data) == len(other.listen().data) == len(relayed))
        assert one.data == other.data == relayed
        sender.setblocking(False)
        with pytest.raises(BlockingIOError):
            sender.recv(1)


@pytest.mark.parametrize("both_ways", [False, True])
def test_the_secret_goes_nowhere(both_ways: bool) -> None:
    """SETUP_SIGNING is relayed in neither direction, alone or in the midst of others."""
    with relayed(both_ways=both_ways) as (station, vehicle, port):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            before, behind = (station_message(mavlink.MAVLink_system_time_message(n, n), 1, 1) for n in (1, 2))
            for data in (setup_signing(1), before + setup_signing(1) + behind):
                sender.sendto(data, ("127.0.0.1", port))
        wait_until(lambda: len(station.of("SYSTEM_TIME")) == 2 and len(station.of("ATTITUDE")) > 5)
        station.send(setup_signing())
        station.send(parameter_request() + setup_signing() + parameter_request())
        if both_ways:
            wait_until(lambda: len(vehicle.received) == 2)
        time.sleep(0.2)  # for whatever else may come
        assert b"SECRET" not in b"".join(station.listen().data)
        assert [message.get_type() for message in vehicle.received] == ["PARAM_REQUEST_LIST"] * 2 * both_ways


@pytest.mark.parametrize("both_ways", [False, True])
def test_answers_go_back_only_both_ways(both_ways: bool) -> None:
    """With --relay-both-ways a station's frame reaches the vehicle as it was; else nothing does."""
    with relayed(both_ways=both_ways) as (station, vehicle, _):
        wait_until(lambda: len(station.of("HEARTBEAT")) > 0)
        station.send(parameter_request())
        station.send(b"\xfd noise")
        station.send(parameter_request(target=0))
        if both_ways:
            wait_until(lambda: len(vehicle.received) == 2)
        time.sleep(0.2)  # for whatever else may come
    assert len(vehicle.received) == 2 * both_ways
    assert all(one.get_srcSystem() == 255 and one.get_srcComponent() == 190 for one in vehicle.received)


def test_an_answer_goes_to_the_link_of_its_vehicle() -> None:
    """Two links, two vehicles on one of them: a command reaches the one that it names; a broadcast all of them."""
    vehicles = [Autopilot(system=number) for number in (1, 2, 3)]
    (one, one_port), (other, other_port) = udp_link(), udp_link()
    with (
        GroundStation() as station,
        Live(one, other, asked=relay_to(station, both_ways=True)),
        udp_vehicle(vehicles[0], one_port),
        udp_vehicle(vehicles[1], other_port),
        udp_vehicle(vehicles[2], other_port),
    ):
        wait_until(lambda: {message.get_srcSystem() for message in station.of("HEARTBEAT")} == {1, 2, 3})
        for number in (1, 2, 3):
            for _ in range(number):
                station.send(parameter_request(target=number))
        wait_until(lambda: [len(vehicle.received) for vehicle in vehicles] == [1, 2, 3])
        station.send(station_message(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)))
        wait_until(lambda: [len(vehicle.received) for vehicle in vehicles] == [2, 3, 4])


def test_answers_over_tcp() -> None:
    """A stream that is cut anywhere gives whole frames; the vehicle is reached by a TCP link as well."""
    vehicle = Autopilot()
    relay_port = free_port(socket.SOCK_STREAM)
    asked = Asked(relays=(NetworkUri("tcpin", "127.0.0.1", relay_port),), both_ways=True)
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = open_link(NetworkUri("tcp", "127.0.0.1", server.getsockname()[1]))
        own, _ = server.accept()
        with own, Live(link, asked=asked) as live, socket.create_connection(("127.0.0.1", relay_port), 5) as station:
            wait_until(lambda: any("has connected" in line for line in live.notes))
            own.sendall(b"".join(vehicle.due(0.0)))
            assert station.recv(65_536)
            frame = parameter_request()
            for piece in (frame[:5], frame[5:12], frame[12:] + frame[:9], frame[9:]):
                station.send(piece)
                time.sleep(0.05)
            own.settimeout(30)
            got = b""
            while len(got) < 2 * len(frame):
                got += own.recv(65_536)
            assert got == 2 * frame


# --- what is asked for -----------------------------------------------------------------------------------------------


def test_rates_are_requested_over_udp() -> None:
    """As an onboard computer of a system that is no ground station; the answers are told."""
    vehicle = Autopilot()
    link, port = udp_link()
    with Live(link, asked=Asked(rates_hz=25.0)) as live, udp_vehicle(vehicle, port):
        wait_until(lambda: len(live.notes) == 3)
        wait_until(lambda: vehicle.rates_hz == {ATTITUDE: 25.0, QUATERNION: 25.0, RAW_IMU: 25.0})
    assert live.notes[1] == "1,1: ATTITUDE_QUATERNION at 25 Hz: accepted"
    assert {(one.get_srcSystem(), one.get_srcComponent()) for one in vehicle.received} == {(254, 191)}
    assert {one.get_type() for one in vehicle.received} == {"COMMAND_LONG"}
    assert [one.get_seq() for one in vehicle.received] == [0, 1, 2]
    assert {(one.target_system, one.target_component) for one in vehicle.received} == {(1, 1)}


@pytest.mark.parametrize("asked", [Asked(as_gcs=True), Asked(rates_hz=10.0), Asked(texts=True)])
def test_udpout_speaks_first(asked: Asked, monkeypatch: pytest.MonkeyPatch) -> None:
    """A vehicle that waits to be spoken to is, by a heartbeat; by more of them, of a ground station, if so asked."""
    monkeypatch.setattr(station_module, "_BEAT_S", 0.2)
    vehicle = Autopilot()
    with udp_server_vehicle(vehicle) as port:
        link = open_link(NetworkUri("udpout", "127.0.0.1", port))
        with Live(link, asked=asked) as live:
            wait_until(lambda: "vehicle_seen" in live.names())
            time.sleep(0.6)  # of several heartbeats
    beats = [one for one in vehicle.received if one.get_type() == "HEARTBEAT"]
    assert {(one.type, one.autopilot) for one in beats} == {(6 if asked.as_gcs else 18, 8)}
    assert len(beats) >= 2 if asked.as_gcs else len(beats) == 1


def test_udpout_waits_for_who_is_not_there_yet(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody listens at first, the system refuses, the link stays."""
    monkeypatch.setattr(station_module, "_BEAT_S", 0.2)
    port = free_port()
    link = open_link(NetworkUri("udpout", "127.0.0.1", port))
    with Live(link, asked=Asked(as_gcs=True)) as live:
        time.sleep(0.6)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
            vehicle.bind(("127.0.0.1", port))
            vehicle.settimeout(30)
            assert vehicle.recv(65_536)[0] == 0xFD
    assert live.names() == ["link_up"]


def test_heartbeats_of_a_ground_station() -> None:
    """One a second, numbered in order, as MAV_TYPE_GCS, of a system that is not 255."""
    vehicle = Autopilot()
    link, port = udp_link()
    began_s = time.monotonic()
    with Live(link, asked=Asked(as_gcs=True)), udp_vehicle(vehicle, port):
        wait_until(lambda: len(vehicle.received) >= 3)
    assert time.monotonic() - began_s > 1.9  # two seconds from the first to the third
    assert [one.get_seq() for one in vehicle.received[:3]] == [0, 1, 2]
    assert {one.get_type() for one in vehicle.received} == {"HEARTBEAT"}
    assert {(one.type, one.autopilot, one.get_srcSystem(), one.get_srcComponent()) for one in vehicle.received} == {
        (6, 8, 254, 191)
    }


@pytest.mark.slow
@pytest.mark.parametrize("relayed", [True, False])
def test_alarms_are_said(relayed: bool) -> None:
    """As STATUSTEXT of the vehicle's own onboard computer, by the relay or the link; critical, as the alarm is."""
    link, port = udp_link()
    with GroundStation() as station, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        asked = relay_to(station, texts=True) if relayed else Asked(texts=True)
        with Live(link, asked=asked) as live:
            sender.connect(("127.0.0.1", port))
            paced(ALARMING, sender.send, 12)
            wait_until(lambda: "alarm_raised" in live.names())
            if not relayed:
                sender.setblocking(False)
                station.messages += station.mav.parse_buffer(sender.recv(65_536)) or ()
            wait_until(lambda: any(one.get_srcComponent() == 191 for one in station.of("STATUSTEXT")))
            if relayed:
                wait_until(lambda: len(station.listen().data) == len(ALARMING) + 1)
                sender.setblocking(False)
                with pytest.raises(BlockingIOError):
                    sender.recv(1)
    (said,) = [one for one in station.messages if one.get_type() == "STATUSTEXT" and one.get_srcComponent() == 191]
    assert said.text == "euler_quaternion ALARM: 25 deg, heading"
    assert (said.severity, said.get_srcSystem(), said.get_seq()) == (2, 1, 0)


def test_a_link_that_takes_nothing_holds_nothing_up() -> None:
    """Commands to a TCP peer that does not read are dropped, whole frames of them, and it is told."""
    vehicle = Autopilot()
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        link = open_link(NetworkUri("tcp", "127.0.0.1", server.getsockname()[1]))
        link.allow_sending()
        own, _ = server.accept()
        frame = parameter_request()
        taken = sum(link.send(frame, 1) for _ in range(400_000))
        assert 100 < taken < 400_000
        data = b""
        while select.select([own], [], [], 0.5)[0]:
            data += own.recv(2**20)
        while not link.send(frame, 1):
            pass
        assert select.select([own], [], [], 5)[0]
        rest = own.recv(2**20)
        link.close()
        own.close()
    assert set(_cut(data + rest, len(frame))) == {frame}
    assert len(data + rest) == (taken + 1) * len(frame)
    assert not vehicle.received


def _cut(data: bytes, size: int) -> list[bytes]:
    return [data[at : at + size] for at in range(0, len(data), size)]


def test_what_may_not_be_asked_for() -> None:
    """Answers without a relay; a relay that leads back; one named twice."""
    with pytest.raises(UsageError, match="no --relay"):
        Asked(both_ways=True)
    relay = NetworkUri("udpout", "127.0.0.1", 14550)
    with pytest.raises(UsageError, match="listened to"):
        Asked(relays=(relay,)).refuse_loops([NetworkUri("udpin", "0.0.0.0", 14550)])
    with pytest.raises(UsageError, match="twice"):
        Asked(relays=(relay, relay)).refuse_loops([])


def test_no_link_sends_before_it_is_allowed() -> None:
    """Whoever would send by mistake finds that nobody has allowed it."""
    link, _ = udp_link()
    with pytest.raises(AssertionError, match="nobody has allowed it"):
        link.send(b"x", 0)
    link.close()
