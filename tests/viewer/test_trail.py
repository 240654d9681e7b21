"""Where vehicles are: places as an independent geodesy says, trails without leaps, and what costs nothing unasked."""

import io
import math
import shutil
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from pymavlink.dialects.v20 import all as mavlink
from scipy.spatial.transform import Rotation

from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.telemetry import positions
from gcs_bridge.viewer import open_viewer
from gcs_bridge.viewer.earth import TangentPlane
from tests.helpers import wire
from tests.helpers.everyday import one_in
from tests.helpers.paths import FIXTURES
from tests.helpers.viewer_tools import Drawn, can_draw, drawn, eventually, has_browser

Array = NDArray[np.float64]
Place = tuple[float, float, float]

PLACE, TRAIL, PLUMB = (f"/vehicle/1.1/{part}" for part in ("place", "trail", "plumb"))
MOVED, TURN, LINES = "Transform3D:translation", "Transform3D:quaternion", "LineStrips3D:strips"
ZURICH = (47.3769, 8.5417, 408.0)
A_DEGREE_M = 111_319.49  # of longitude at the equator, and near to it of latitude


def ecef(place: Place) -> Array:
    """Metres from the middle of the earth, as WGS84 defines it."""
    a, f = 6_378_137.0, 1 / 298.257223563
    latitude, longitude = np.radians(place[:2])
    e2 = f * (2 - f)
    n = a / np.sqrt(1 - e2 * np.sin(latitude) ** 2)
    level = (n + place[2]) * np.cos(latitude)
    return np.array(
        (level * np.cos(longitude), level * np.sin(longitude), (n * (1 - e2) + place[2]) * np.sin(latitude))
    )


def ned(place: Place, origin: Place) -> Array:
    """Metres north, east and down of an origin, by way of the earth's middle."""
    latitude, longitude = origin[:2]
    R_en = Rotation.from_euler("ZY", (longitude, -latitude - 90), degrees=True)
    return np.asarray(R_en.inv().apply(ecef(place) - ecef(origin)))


def test_the_plane_is_that_of_wgs84() -> None:
    """Against the way by the earth's middle, whose plane the ground falls away from: within 2 cm at 300 m."""
    origin = (-35.363261, 149.16523, 584.0)
    for place in ((-35.3610, 149.1660, 600.0), (-35.3640, 149.1620, 580.0)):
        assert TangentPlane(origin).ned(place) == pytest.approx(ned(place, origin), abs=0.02)


def global_position(ms: int, place: Place, **wired: Any) -> bytes:
    latitude, longitude, altitude_m = place
    message = mavlink.MAVLink_global_position_int_message(
        ms, round(latitude * 1e7), round(longitude * 1e7), round(altitude_m * 1e3), 0, 0, 0, 0, 65535
    )
    return wire.pack(message, **wired)


def gps_raw(ms: int, place: Place, fix: int = 3) -> bytes:
    latitude, longitude, altitude_m = place
    message = mavlink.MAVLink_gps_raw_int_message(
        ms * 1000, fix, round(latitude * 1e7), round(longitude * 1e7), round(altitude_m * 1e3), 100, 100, 0, 0, 9
    )
    return wire.pack(message)


def local_position(ms: int, place: Place) -> bytes:
    return wire.pack(mavlink.MAVLink_local_position_ned_message(ms, *place, 0, 0, 0))


def flight(*tell: Callable[[int], Iterable[bytes]], seconds: int = 20) -> bytes:
    """A level vehicle whose nose points east, with what each of `tell` says ten times a second."""
    east = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
    records = [(wire.START_US, wire.heartbeat())]
    for tenth in range(10 * seconds):
        ms, now = 1000 + 100 * tenth, wire.START_US + 100_000 * tenth
        frames = [wire.attitude(ms, (0, 0, math.pi / 2)), wire.attitude_quaternion(ms, east)]
        records += [(now, frame) for frame in (*frames, *(said for one in tell for said in one(ms)))]
    return wire.tlog(records)


def north_of_zurich(ms: int) -> Place:
    """On the way north, at 10 m/s."""
    return ZURICH[0] + (ms - 1000) / 1e3 * 10 / A_DEGREE_M, ZURICH[1], ZURICH[2]


def places(data: bytes, path: Path, pieces: int = 1) -> tuple[Drawn, Array]:
    recording, _ = drawn(data, path, pieces=pieces)
    return recording, recording.numbers(PLACE, MOVED)[1]


@pytest.mark.slow
def test_a_real_flight_lies_where_its_messages_say(tmp_path: Path) -> None:
    """Each GLOBAL_POSITION_INT behind the first, as pymavlink reads it: its place is the oracle's to 3 cm."""
    path = FIXTURES / "a_copter_square.tlog"
    messages = [mavlink.MAVLink(None).parse_char(frame) for _, frame in wire.records(path.read_bytes())]
    told: list[Place] = [
        (m.lat * 1e-7, m.lon * 1e-7, m.alt * 1e-3)
        for m in messages
        if m.get_type() == "GLOBAL_POSITION_INT" and (m.lat or m.lon)
    ]
    recording, found = places(path.read_bytes(), tmp_path / "a.rrd")
    origin = told[1]  # the second one bears the first one out
    globally = found[-len(told) + 1 :]
    assert globally == pytest.approx(np.array([ned(place, origin) for place in told[1:]]), abs=0.03)
    assert np.ptp(globally, axis=0) == pytest.approx((12, 12, 10), abs=1)  # the square of 12 m, and its height
    _, ends = recording.numbers(PLUMB, LINES)
    assert ends[-1] == pytest.approx(np.array([globally[-1], (*globally[-1][:2], 0.0)]), abs=1e-3)


@pytest.mark.slow
def test_the_nose_points_where_it_did(tmp_path: Path) -> None:
    """Flying north with its nose to the east, it stands so at each place."""
    recording, found = places(flight(lambda ms: [global_position(ms, north_of_zurich(ms))]), tmp_path / "a.rrd")
    assert np.diff(found[:, 0]) == pytest.approx(1.0, abs=0.02)
    _, xyzw = recording.numbers(f"{PLACE}/airframe", TURN)
    assert Rotation.from_quat(xyzw).apply((1, 0, 0)) == pytest.approx(np.tile((0, 1, 0), (len(xyzw), 1)), abs=1e-6)


def test_the_trail_is_one_line_and_thin(tmp_path: Path) -> None:
    """Each piece begins where the one before ended; there are fewer of them than places."""
    recording, found = places(flight(lambda ms: [global_position(ms, north_of_zurich(ms))]), tmp_path / "a.rrd")
    _, pieces = recording.numbers(TRAIL, LINES)
    assert pieces[1:, 0].tolist() == pieces[:-1, 1].tolist()
    assert 20 < len(pieces) < len(found) / 3
    assert pieces[-1, 1, 0] == pytest.approx(found[-1][0], abs=5.0)


@pytest.mark.parametrize(
    "bad",
    one_in(
        3,
        [
            lambda ms: global_position(ms, (0.0, 0.0, 0.0)),
            lambda ms: global_position(ms, (ZURICH[0] + 1.0, *ZURICH[1:])),
            lambda ms: global_position(ms, (*ZURICH[:2], 2e6)),
            lambda ms: global_position(ms, (91.0, *ZURICH[1:])),
            lambda ms: local_position(ms, (math.nan, 0.0, math.inf)),
            lambda ms: gps_raw(ms, (3.0, 4.0, 5.0), fix=1),
        ],
        swept=False,
    ),
)
def test_what_cannot_be_is_left_out(bad: Callable[[int], bytes], tmp_path: Path) -> None:
    """0° north 0° east, a leap and back, heights and angles that there are not, NaN: as if they had not come."""

    def told(ms: int) -> Iterable[bytes]:
        return [global_position(ms, north_of_zurich(ms)), *([bad(ms)] if ms % 700 == 0 else [])]

    _, found = places(flight(told), tmp_path / "a.rrd")
    assert np.abs(np.diff(found[:, 0]) - 1.0).max() < 0.02
    assert np.ptp(found, axis=0) == pytest.approx((199, 0, 0), abs=1.5)


@pytest.mark.slow
def test_a_vehicle_that_is_elsewhere_from_now_on_leaves_no_line(tmp_path: Path) -> None:
    """Moved by 5 km and staying there: it is drawn there, in the same world, and nothing leads there."""

    def told(ms: int) -> Iterable[bytes]:
        latitude, longitude, altitude_m = north_of_zurich(ms)
        return [global_position(ms, (latitude + (0.045 if ms > 10_000 else 0.0), longitude, altitude_m))]

    recording, found = places(flight(told), tmp_path / "a.rrd")
    assert np.ptp(found[:, 0]) == pytest.approx(5000 + 200, rel=0.01)
    _, pieces = recording.numbers(TRAIL, LINES)
    assert np.linalg.norm(pieces[:, 1] - pieces[:, 0], axis=1).max() < 20


@pytest.mark.slow
def test_the_best_message_is_followed(tmp_path: Path) -> None:
    """The GPS until the estimate comes; places of the vehicle's own world only where it tells no other."""
    north = north_of_zurich

    def south(ms: int) -> Place:
        return 2 * ZURICH[0] - north(ms)[0], *ZURICH[1:]

    both = flight(lambda ms: [gps_raw(ms, north(ms)), *([global_position(ms, south(ms))] if ms > 5000 else [])])
    _, found = places(both, tmp_path / "a.rrd")
    heading_north = np.diff(found[:, 0]) > 0
    change = int(np.flatnonzero(~heading_north)[0])
    assert change == pytest.approx(40, abs=3)
    assert not heading_north[change:].any()
    _, found = places(flight(lambda ms: [local_position(ms, (1.0, ms / 1e3, -5.0))]), tmp_path / "b.rrd")
    assert found[-1] == pytest.approx((1.0, 20.9, -5.0), abs=1e-3)
    _, found = places(flight(lambda ms: [gps_raw(ms, north(ms)), local_position(ms, (7, 7, 7))]), tmp_path / "c.rrd")
    assert found[-1] == pytest.approx((7, 7, 7))


@pytest.mark.slow
def test_vehicles_near_to_each_other_share_a_world(tmp_path: Path) -> None:
    """A second vehicle 300 m to the east stands 300 m to the east; one in Canberra has a world of its own."""
    east = ZURICH[1] + 300 / (A_DEGREE_M * math.cos(math.radians(ZURICH[0])))
    records = [
        (t_us, frame)
        for sysid, place in ((1, ZURICH), (2, (ZURICH[0], east, ZURICH[2])), (3, (-35.36, 149.16, 584.0)))
        for t_us, frame in wire.records(flight(lambda ms, place=place: [global_position(ms, place)], seconds=3))  # type: ignore[misc]
        for frame in [renumbered(frame, sysid)]
    ]
    recording, _ = drawn(wire.tlog(sorted(records, key=lambda record: record[0])), tmp_path / "a.rrd")
    stand = [recording.numbers(f"/vehicle/{sysid}.1/place", MOVED)[1][-1] for sysid in (1, 2, 3)]
    assert stand[1] - stand[0] == pytest.approx((0, 300, 0), abs=1.0)
    assert np.linalg.norm(stand[2]) < 1.0


def renumbered(frame: bytes, sysid: int) -> bytes:
    """The same frame of another system."""
    extra = mavlink.mavlink_map[int.from_bytes(frame[7:10], "little")].crc_extra
    return wire.with_checksum(frame[:5] + bytes([sysid]) + frame[6:], extra)


@pytest.mark.slow
@pytest.mark.sweep
def test_how_it_was_cut_does_not_matter(tmp_path: Path) -> None:
    """Whole or in 57 pieces: the same places, attitudes and trail."""
    data = (FIXTURES / "c_copter_4hz.tlog").read_bytes()
    whole, cut = (drawn(data, tmp_path / f"{pieces}.rrd", pieces=pieces)[0] for pieces in (1, 57))
    for entity, component in (
        (PLACE, MOVED),
        (f"{PLACE}/airframe", TURN),
        ("/vehicle/1.1/geo/now", "GeoPoints:positions"),
    ):
        for one, other in zip(whole.numbers(entity, component), cut.numbers(entity, component), strict=True):
            assert np.array_equal(one, other), entity


def test_nobody_looks_nothing_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where nobody looks on, as in `check`, positions are not even decoded."""
    read: list[int] = []

    def reads(*_: object) -> positions.PositionSamples:
        read.append(1)
        return positions.NO_POSITIONS

    monkeypatch.setattr(positions.PositionReader, "read", reads)
    data = (FIXTURES / "c_copter_4hz.tlog").read_bytes()
    for observer in (None, lambda _: None):
        assert not read
        monitor = Monitor(observer=observer)
        monitor.feed_recording(data)
    assert read


@pytest.mark.sweep
@pytest.mark.slow
@can_draw
@has_browser
def test_no_map_is_asked_for_before_somebody_opens_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In real Chromium, with places known and the trail's tabs there: until all is drawn no tile is asked for."""
    playwright = pytest.importorskip("playwright.sync_api", reason="pip install playwright (no browser of its own)")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setenv("CI", "1")
    said: list[str] = []
    asked: list[str] = []
    flags = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    flags += ["--js-flags=--no-wasm-tier-up --no-wasm-dynamic-tiering"]
    with open_viewer("web", say=said.append) as viewer:
        sink = viewer.recording("page")
        monitor = Monitor(observer=sink.observe)
        sink.events(monitor.feed_recording(flight(lambda ms: [global_position(ms, north_of_zurich(ms))], seconds=5)))
        sink.finish()
        (address,) = [word for word in said[0].split() if word.startswith("http")]
        with playwright.sync_playwright() as tool:
            browser = tool.chromium.launch(executable_path=shutil.which("chromium"), args=flags)
            page = browser.new_page(viewport={"width": 700, "height": 450})

            def route(request: Any) -> None:
                asked.append(request.request.url)
                if asked[-1].startswith(("http://127.0.0.1", "blob:", "data:")):
                    request.continue_()
                else:
                    request.abort()

            page.route("**/*", route)
            page.goto(f"{address}&renderer=webgl&theme=dark&persist=0")

            def drawn_body() -> bool:
                picture = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB")).astype(int)[65:285, :380]
                return int((np.abs(picture - (155, 187, 213)).max(axis=2) <= 25).sum()) > 250

            eventually(drawn_body, 120)
            page.wait_for_timeout(3000)
            browser.close()
    assert any(url.startswith("http://127.0.0.1") for url in asked)
    assert not [url for url in asked if "openstreetmap" in url or "mapbox" in url or "tile" in url]
