"""What a link's URI may be."""

from pathlib import Path

import pytest

from gcs_bridge.errors import UsageError
from gcs_bridge.links.open import OPENERS
from gcs_bridge.links.uri import SCHEMES, SPEAK_FIRST, NetworkUri, SerialUri, Uri, parse_uri


@pytest.mark.parametrize(
    ("text", "uri"),
    [
        ("udpin:0.0.0.0:14550", NetworkUri("udpin", "0.0.0.0", 14550)),
        ("udpin:localhost:1", NetworkUri("udpin", "localhost", 1)),
        ("tcp:10.0.0.7:5760", NetworkUri("tcp", "10.0.0.7", 5760)),
        ("tcpin:0.0.0.0:5760", NetworkUri("tcpin", "0.0.0.0", 5760)),
        ("udpin:[::]:14550", NetworkUri("udpin", "::", 14550)),
        ("tcp:[FE80::1%eth0]:5760", NetworkUri("tcp", "fe80::1%eth0", 5760)),
        ("mcast:", NetworkUri("mcast", "239.255.145.50", 14550)),
        ("mcast:14560", NetworkUri("mcast", "239.255.145.50", 14560)),
        ("mcast:239.1.2.3:14560", NetworkUri("mcast", "239.1.2.3", 14560)),
        ("/dev/ttyACM0", SerialUri("/dev/ttyACM0", 57600)),
        ("/dev/serial/by-id/usb-3D_Robotics,Inc-if00", SerialUri("/dev/serial/by-id/usb-3D_Robotics,Inc-if00", 57600)),
        ("/dev/ttyUSB1,921600", SerialUri("/dev/ttyUSB1", 921600)),
        ("COM3", SerialUri("COM3", 57600)),
        ("com12,115200", SerialUri("com12", 115200)),
    ],
)
def test_links(text: str, uri: Uri) -> None:
    """pymavlink's forms; a serial device takes --baud unless it brings a speed of its own."""
    assert parse_uri(text, baud=57600) == uri
    assert isinstance(uri, SerialUri) or parse_uri(str(uri)) == uri


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("udpout:127.0.0.1:14550", "udpout: cannot receive before it has sent, and sending is not enabled"),
        ("udpbcast:127.0.0.1:14550", "cannot receive before it has sent"),
        ("udpni:0.0.0.0:14550", "unknown kind of link 'udpni:'; did you mean 'udpin:0.0.0.0:14550'?"),
        ("udp:0.0.0.0:14550", "did you mean 'udpin:0.0.0.0:14550'?"),
        ("TCP:1.2.3.4:5", "did you mean 'tcp:1.2.3.4:5'?"),
        ("127.0.0.1:14550", "did you mean 'udpin:127.0.0.1:14550'?"),
        ("serial:/dev/ttyACM0", "did you mean '/dev/ttyACM0'?"),
        ("zzz:1", "did you mean 'udpin:zzz:1'?"),
        (
            "qqqq:x",
            "links are udpin:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT, mcast:[GROUP:PORT] and serial devices as /dev/",
        ),
        ("ttyACM0", "'ttyACM0' is no link; links are"),
        ("", "'' is no link"),
        ("udpin:14550", "must be as udpin:127.0.0.1:14550"),
        ("udpin::14550", "must be as udpin:127.0.0.1:14550"),
        ("udpin:0.0.0.0:", "the port must be from 1 to 65535"),
        ("udpin:0.0.0.0:0", "the port must be from 1 to 65535"),
        ("udpin:0.0.0.0:65536", "the port must be from 1 to 65535"),
        ("tcp:host:²", "the port must be from 1 to 65535"),
        ("tcp:::1:5760", "an IPv6 address in brackets: [::1]"),
        ("udpin:[::1]", "must be as udpin:127.0.0.1:14550"),
        ("udpin:[nonsense]:14550", "'nonsense' is no IPv6 address"),
        ("udpin:[127.0.0.1]:14550", "'127.0.0.1' is no IPv6 address"),
        ("udpin:[]:14550", "is no IPv6 address"),
        ("mcast:127.0.0.1:14550", "groups are the IPv4 addresses from 224.0.0.0 to 239.255.255.255"),
        ("mcast:somewhere:14550", "groups are the IPv4 addresses from 224.0.0.0 to 239.255.255.255"),
        ("mcast:[ff02::1]:14550", "groups are the IPv4 addresses"),
        ("mcast:99999", "the port must be from 1 to 65535"),
    ],
)
def test_what_is_no_link_is_refused(text: str, said: str) -> None:
    """One sentence says what is wrong, and where it can be told what would be right."""
    with pytest.raises(UsageError) as refused:
        parse_uri(text)
    assert said in str(refused.value)


def test_a_recording_is_no_link(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Who names a file is told what to type for files."""
    (tmp_path / "flight.tlog").write_bytes(b"x")
    monkeypatch.chdir(tmp_path)
    for name in ("flight.tlog", "./flight.tlog", str(tmp_path / "flight.tlog")):
        with pytest.raises(UsageError, match="gcs-bridge check"):
            parse_uri(name)


def test_each_kind_of_link_can_be_opened() -> None:
    """What a URI may begin with has its opener, and nothing else has."""
    assert set(OPENERS) == {*SCHEMES, *SPEAK_FIRST, SerialUri.kind}


def test_what_must_speak_first_may_where_sending_is_allowed() -> None:
    """And nowhere else."""
    assert parse_uri("udpout:192.0.2.7:14550", may_send=True) == NetworkUri("udpout", "192.0.2.7", 14550)
    with pytest.raises(UsageError, match="cannot receive before it has sent"):
        parse_uri("udpout:192.0.2.7:14550")
    with pytest.raises(UsageError, match="from 1 to 65535"):
        parse_uri("udpout:192.0.2.7:0", may_send=True)
