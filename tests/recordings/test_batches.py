"""Any message as columns, held against pymavlink's own parser."""

from collections import Counter, defaultdict
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import all as mavlink

import gcs_bridge
from gcs_bridge.errors import UsageError
from tests.helpers import wire
from tests.helpers.paths import FIXTURES

FLIGHTS = ["e_two_vehicles", "g_mavlink1", "p_px4_quad_square"]


def sent(name: str) -> dict[tuple[str, int, int], list[Any]]:
    """All messages by kind and sender, as pymavlink reads them."""
    found: dict[tuple[str, int, int], list[Any]] = defaultdict(list)
    with closing(mavutil.mavlink_connection(str(FIXTURES / f"{name}.tlog"), dialect="all")) as log:
        while (one := log.recv_match()) is not None:
            if one.get_type() != "BAD_DATA" and not one.get_type().startswith("UNKNOWN"):
                found[one.get_type(), one.get_srcSystem(), one.get_srcComponent()].append(one)
    return found


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize("name", FLIGHTS)
def test_every_message_and_every_field(name: str) -> None:
    """As many of each, of each sender, with each number; receive times too."""
    expected = sent(name)
    batches: dict[tuple[str, int, int], list[Any]] = defaultdict(list)
    for batch in gcs_bridge.iter_batches(FIXTURES / f"{name}.tlog"):
        batches[batch.message, batch.sysid, batch.compid].append(batch)
    assert {key: sum(map(len, of)) for key, of in batches.items()} == {key: len(of) for key, of in expected.items()}
    for key, of in batches.items():
        np.testing.assert_allclose(
            np.concatenate([one.t_rx_us for one in of]), [one._timestamp * 1e6 for one in expected[key]], atol=1
        )
        for field in expected[key][0].get_fieldnames():
            ours = [value for one in of for value in one.to_arrow()[field].to_pylist()]
            theirs = [getattr(one, field) for one in expected[key]]
            for a, b in zip(ours, theirs, strict=True):
                if isinstance(b, str):
                    assert a == " ".join(b.split()), (key, field)
                else:
                    np.testing.assert_array_equal(a, b, err_msg=f"{key} {field}")


def test_columns_are_views_and_arrow_takes_them() -> None:
    """`fields` copies nothing; pandas and polars begin with Arrow."""
    (first, *_) = gcs_bridge.iter_batches(FIXTURES / "g_mavlink1.tlog", ["ATTITUDE"])
    assert np.shares_memory(first.fields["roll"], first.fields)
    table = pa.Table.from_batches([first.to_arrow()])
    assert table.schema.field("roll").type == pa.float32()
    assert table["sysid"].to_pylist() == [first.sysid] * len(first)


def test_what_is_selected() -> None:
    """By name, by time since the start, by system."""
    path = FIXTURES / "e_two_vehicles.tlog"
    count: Counter[tuple[str, int]] = Counter()
    times = []
    for batch in gcs_bridge.iter_batches(path, ["ATTITUDE", "HEARTBEAT"], start=5.0, end=10.0, sysid=2):
        count[batch.message, batch.sysid] += len(batch)
        times += batch.t_rx_us.tolist()
    assert set(count) == {("ATTITUDE", 2), ("HEARTBEAT", 2)}
    assert max(times) - min(times) <= 5_000_000
    everything = sum(map(len, gcs_bridge.iter_batches(path, "ATTITUDE", sysid=2)))
    assert 0 < count["ATTITUDE", 2] < everything


def test_what_brings_a_key_is_left_out_unless_it_is_asked_for(tmp_path: Path) -> None:
    """And text from the air reaches nobody's terminal."""
    key = mavlink.MAVLink_setup_signing_message(1, 1, bytes(range(32)), 7)
    text = mavlink.MAVLink_statustext_message(4, b"\x1b[2Jhello")
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    frames = [(wire.START_US + i, bytes(one.pack(sender))) for i, one in enumerate((key, text))]
    (tmp_path / "a.tlog").write_bytes(b"".join(t.to_bytes(8, "big") + frame for t, frame in frames))
    (only,) = gcs_bridge.iter_batches(tmp_path / "a.tlog")
    assert only.to_arrow()["text"].to_pylist() == ["\\x1b[2Jhello"]
    (asked,) = gcs_bridge.iter_batches(tmp_path / "a.tlog", ["SETUP_SIGNING"])
    assert bytes(asked.fields["secret_key"][0]) == bytes(range(32))


def test_what_cannot_be_asked_for() -> None:
    """An unknown message is told before anything is read."""
    with pytest.raises(UsageError, match="no message 'ATTITUD' in dialect all"):
        gcs_bridge.iter_batches("nowhere.tlog", ["ATTITUD"])


def test_what_nobody_signed_is_passed_over_on_request(tmp_path: Path) -> None:
    """Of frames with and without a signature those that the key signed come; without the request all do."""
    key, path = bytes(range(32)), tmp_path / "signed.tlog"
    frames = [wire.heartbeat(custom_mode=i, seq=i) for i in range(20)]
    path.write_bytes(
        wire.tlog(
            (wire.START_US + 1000 * i, wire.signed(frame, key, time=10**6 + i) if i % 3 else frame)
            for i, frame in enumerate(frames)
        )
    )

    def modes(**how: Any) -> list[int]:
        return [int(mode) for one in gcs_bridge.iter_batches(path, **how) for mode in one.fields["custom_mode"]]

    assert modes(signing_key=key, unsigned="reject") == [i for i in range(20) if i % 3]
    assert modes() == modes(signing_key=key) == list(range(20))
    assert modes(signing_key=b"!" * 32, unsigned="reject") == []
    with pytest.raises(UsageError, match="needs the signing key"):
        gcs_bridge.iter_batches(path, unsigned="reject")
