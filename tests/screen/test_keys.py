"""What terminals send for keys, whole or cut in pieces, and what nobody meant."""

import pytest

from gcs_bridge.screen.keys import HELP, Key, KeyReader

NEXT, PREVIOUS = Key.NEXT_VEHICLE, Key.PREVIOUS_VEHICLE


def read(*pieces: bytes) -> list[Key]:
    reader = KeyReader()
    return [key for piece in pieces for key in reader.read(piece)]


def test_keys() -> None:
    """Letters, and cursor keys in both of their modes (xterm's CSI and SS3)."""
    assert read(b"asuq") == [Key.ACKNOWLEDGE, Key.SHELVE, Key.UNSHELVE, Key.QUIT]
    assert read(b"\x1b[C\x1b[D\x1b[A\x1b[B") == [NEXT, PREVIOUS, Key.PREVIOUS_ALERT, Key.NEXT_ALERT]
    assert read(b"\x1bOC\x1bOD\t\x1b[Z") == [NEXT, PREVIOUS, NEXT, PREVIOUS]


def test_cut_anywhere() -> None:
    """A slow line brings a sequence in pieces."""
    for cut in range(1, 9):
        data = b"\x1b[C\x1bODaq"
        assert read(data[:cut], data[cut:]) == [NEXT, PREVIOUS, Key.ACKNOWLEDGE, Key.QUIT]


@pytest.mark.parametrize(
    "sent",
    [
        b"\x1b[1;5A",  # a key with Ctrl
        b"\x1b[15~",  # a function key
        b"\x1b[200",  # a sequence that does not end
        b"\x1b\x1b[5~",  # with Alt
        b"\x1ba",
        b"\xff\xfe\x00\x80",
        "ä航".encode(),
        b"\x1b[" + b"0" * 500,
        b"xyzXYZ0123456789\r\n",
    ],
)
def test_other_keys_do_nothing(sent: bytes) -> None:
    """Above all they acknowledge nothing."""
    assert read(sent) == []


def test_a_sequence_that_never_ends_is_given_up() -> None:
    """Keys behind it count."""
    assert read(b"\x1b[" + b"0" * 100, b"q")[-1:] == [Key.QUIT]


def test_the_help_fits_the_smallest_usual_terminal() -> None:
    """80 columns, 24 rows less the title's."""
    assert len(HELP) <= 21
    assert max(map(len, HELP)) <= 78
