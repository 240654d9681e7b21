"""What stands around the attitudes: airframes, compass, triads and arrows, and texts that do not cover each other."""

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pymavlink.dialects.v20 import all as mavlink
from scipy.spatial.transform import Rotation

from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.viewer.airframes import airframe_of, shape_of
from gcs_bridge.viewer.compass import POINTS, rose
from gcs_bridge.viewer.places import NAME_AT, UNDONE_AT, eye_of, lift_of, place_of, written_places
from gcs_bridge.viewer.processes import free_port
from gcs_bridge.viewer.scene import LEGEND
from tests.helpers import wire
from tests.helpers.everyday import one_in
from tests.helpers.paths import FIXTURES
from tests.helpers.viewer_tools import HEADLESS_PORT, Drawn, Picture, can_draw, drawn, headless

Array = NDArray[np.float64]

BODY = "/vehicle/1.1/body"
TURN, ARROWS = "Transform3D:quaternion", "Arrows3D:vectors"
SHAPES = (
    *(f"multirotor {rotors}" for rotors in (3, 4, 6, 8, 10, 12)),
    *("plane", "vtol", "tailsitter", "helicopter", "rover", "boat", "submarine", "other"),
)


def steady(rpy_deg: tuple[float, float, float], *others: bytes, seconds: float = 2.0, **wired: int) -> bytes:
    """A vehicle that keeps its attitude and turns at (0.1, −0.2, 0.3) rad/s, as it says; with `others`."""
    rpy = np.radians(rpy_deg)
    wxyz = wire.wxyz(Rotation.from_euler("ZYX", rpy[::-1]))
    records = [(wire.START_US, wire.heartbeat(**wired))]
    for i in range(int(25 * seconds)):
        frames = (
            wire.attitude(1000 + 40 * i, rpy, (0.1, -0.2, 0.3)),
            wire.attitude_quaternion(1000 + 40 * i, wxyz, (0.1, -0.2, 0.3)),
        )
        records += [(wire.START_US + 40_000 * i, frame) for frame in (*frames, *others)]
    return wire.tlog(records)


@pytest.mark.slow
def test_the_second_estimate_turns_as_scipy_says(tmp_path: Path) -> None:
    """Roll, pitch and yaw of each AHRS2 of a real flight, as pymavlink reads them: SciPy's matrix to 1e-6."""
    path = FIXTURES / "c_copter_4hz.tlog"
    messages = [mavlink.MAVLink(None).parse_char(frame) for _, frame in wire.records(path.read_bytes())]
    began = next(i for i, m in enumerate(messages) if m.get_type() == "ATTITUDE")
    sent = [(m.roll, m.pitch, m.yaw) for m in messages[began:] if m.get_type() == "AHRS2"]
    _, xyzw = drawn(path.read_bytes(), tmp_path / "a.rrd")[0].numbers(f"{BODY}/ahrs2", TURN)
    assert 0 <= len(sent) - len(xyzw) <= 1  # the last one waits for the time that comes behind it
    expected = Rotation.from_euler("ZYX", np.array(sent)[: len(xyzw), ::-1])
    assert Rotation.from_quat(xyzw).as_matrix() == pytest.approx(expected.as_matrix(), abs=1e-6)


def test_field_and_rates_point_where_they_should(tmp_path: Path) -> None:
    """By hand: of a nose to the east, a field to its left and down is north and down; rates are 1 m for 1 rad/s."""
    imu = mavlink.MAVLink_highres_imu_message
    frames = [
        wire.pack(imu(1_000_000 + 40_000 * i, 0, 0, -9.8, 0, 0, 0, 0, -0.3, 0.4, *[0] * 4, fields_updated=0x1FF))
        for i in range(50)
    ]
    records = list(wire.records(steady((0, 0, 90))))
    records += [(wire.START_US + 40_000 * i, frame) for i, frame in enumerate(frames)]
    recording, _ = drawn(wire.tlog(sorted(records, key=lambda row: row[0])), tmp_path / "a.rrd")
    _, field = recording.numbers(f"{BODY}/field", ARROWS)
    assert len(field) > 40
    assert field == pytest.approx(np.tile(1.3 * np.array((0.6, 0, 0.8)), (len(field), 1)), abs=1e-6)
    for source in ("quaternion", "euler"):
        _, rates = recording.numbers(f"{BODY}/{source}/rates", ARROWS)
        assert rates == pytest.approx(np.tile((0.1, -0.2, 0.3), (50, 1)), abs=1e-6)


def test_of_what_never_came_nothing_is_drawn(tmp_path: Path) -> None:
    """Of a vehicle that sends ATTITUDE alone, no solid stands there level, as if a quaternion had said so."""
    records = [record for record in wire.records(steady((0, 0, 0))) if record[1][7] != 31]  # ATTITUDE_QUATERNION
    recording, _ = drawn(wire.tlog(records), tmp_path / "a.rrd")
    assert {f"{BODY}/euler/airframe", f"{BODY}/euler/axes"} <= recording.static()
    assert not [path for path in recording.static() if path.startswith((f"{BODY}/quaternion", f"{BODY}/ahrs2"))]
    assert labels(recording, "/legend") == ["Euler", "body rates"]
    _, tags = recording.rows(f"{BODY}/name", "Points3D:labels")
    assert tags[0] == ["1.1"]


def test_the_airframe_is_that_of_the_type(tmp_path: Path) -> None:
    """A boat's HEARTBEAT draws a boat: as many triangles' corners as its solid has, and a nose in yellow."""
    recording, _ = drawn(steady((0, 0, 0), vehicle=mavlink.MAV_TYPE_SURFACE_BOAT), tmp_path / "a.rrd")
    looks = airframe_of("boat", (143, 163, 181))
    found = static(recording, f"{BODY}/quaternion/airframe", "Mesh3D:vertex_positions")
    assert np.array(found) == pytest.approx(looks.corners.reshape(-1, 3), abs=1e-6)


def test_the_type_is_known_long_after_it_was_said() -> None:
    """Told once, in the first second: whoever begins to look later, as an alarm's window does, still knows it."""
    types: list[str] = []
    monitor = Monitor(observer=lambda observation: types.append(observation.type))
    data = steady((0, 0, 0), vehicle=mavlink.MAV_TYPE_SURFACE_BOAT)
    for cut in np.array_split(np.frombuffer(data, np.uint8), 10):
        monitor.feed_recording(cut.tobytes())
    assert len(types) >= 9
    assert set(types) == {"surface_boat"}


def static(recording: Drawn, entity: str, component: str) -> list[object]:
    """A part that never changes, as it was drawn last."""
    values = []
    for chunk in recording._chunks:
        batch = chunk.to_record_batch()
        if chunk.entity_path == entity and chunk.is_static and component in batch.schema.names:
            values += batch.column(component).to_pylist()
    return list(values[-1])


def labels(recording: Drawn, entity: str) -> list[object]:
    return static(recording, entity, "Points3D:labels")


def test_each_type_of_mavlink_has_a_shape() -> None:
    """All of MAV_TYPE that names a kind of airframe, by the names that the report uses; the rest is a dart."""
    names = {entry.name.removeprefix("MAV_TYPE_").lower() for entry in mavlink.enums["MAV_TYPE"].values()}
    shapes = {name: shape_of(name) for name in names}
    assert {shapes[name] for name in ("fixed_wing", "flapping_wing")} == {"plane"}
    rotors = {"tricopter": 3, "quadrotor": 4, "hexarotor": 6, "octorotor": 8, "decarotor": 10, "dodecarotor": 12}
    assert {shapes[name] for name in rotors} == {f"multirotor {n}" for n in rotors.values()}
    assert [shapes[name] for name in ("ground_rover", "surface_boat", "submarine")] == ["rover", "boat", "submarine"]
    assert {shape for name, shape in shapes.items() if name.startswith("vtol")} == {"vtol", "tailsitter"}
    assert shape_of("vtol_tailsitter_duorotor") == shape_of("vtol_tailsitter") == "tailsitter"
    assert {shapes[name] for name in ("generic", "gcs", "balloon") if name in shapes} == {"other"}


@pytest.mark.parametrize("shape", one_in(3, SHAPES, swept=False))
def test_front_back_top_and_bottom_look_unlike(shape: str) -> None:
    """What lies furthest forward is yellow, nothing behind is; left is like right; a bottom is darker than a top."""
    grey = (143, 163, 181)
    looks = airframe_of(shape, grey)
    yellow = looks.colours[:, 2] < 0.4 * looks.colours[:, 0]
    middles = looks.corners.mean(axis=1)
    reach = looks.corners[..., 0].max()
    assert 0.5 < reach < 1.0
    assert looks.corners[yellow][..., 0].max() == reach
    assert middles[yellow][:, 0].min() > -0.1
    corners = {tuple(np.round(corner, 3) + 0.0) for corner in looks.corners.reshape(-1, 3)}
    mirrored = {(x, -y + 0.0, z) for x, y, z in corners}
    assert len(corners ^ mirrored) < 0.5 * len(corners)  # a helicopter's tail rotor is on one side
    a, b, c = looks.corners.swapaxes(0, 1)
    up = -np.cross(b - a, c - a)[:, 2] / np.linalg.norm(np.cross(b - a, c - a), axis=1)
    bright = looks.colours.max(axis=1)
    assert bright[~yellow & (up > 0.9)].max() > 1.5 * bright[~yellow & (up < -0.9)].max()
    assert np.abs(looks.corners).max() < 1.15  # the triad can be seen beyond


def test_the_rose_names_the_bearings() -> None:
    """N lies north, E east, …, each 45° on; no sign lies on another, and all can be read by who looks north."""
    lines = dict(rose(1.0))
    boxes = [(line[:, :2].min(axis=0), line[:, :2].max(axis=0)) for line in lines["points"]]
    assert all(line[:, 2].tolist() == [1.0] * len(line) for part in lines.values() for line in part)
    bearings = np.degrees([math.atan2(*(low + high)[::-1]) for low, high in boxes]) % 360
    assert sorted(set(np.round(bearings / 45).astype(int) % 8)) == list(range(len(POINTS)))
    for (low, high), (other_low, other_high) in itertools.combinations(boxes, 2):
        apart = np.maximum(other_low - high, low - other_high).max()
        assert apart > 0 or _same_sign(low, high, other_low, other_high)
    north = lines["points"][0]  # the strokes of N: up on the left, across, up on the right
    assert north[:, 0].argmin() == 0
    assert north[0, 1] < north[2, 1]


def _same_sign(*corners: Array) -> bool:
    """Of one sign are strokes (E has two)."""
    low, high, other_low, other_high = corners
    return bool(np.linalg.norm((low + high) / 2 - (other_low + other_high) / 2) < 0.15)


@pytest.mark.parametrize(
    ("vehicles", "size"),
    [
        (1, (533, 281)),  # with an alarm
        (1, (533, 305)),
        (2, (548, 394)),
        (3, (548, 374)),
        (5, (698, 338)),
        *((vehicles, (1100, 620)) for vehicles in (1, 2, 3, 5, 6)),
    ],
)
def test_no_text_covers_another(vehicles: int, size: tuple[int, int]) -> None:
    """The places of all texts as a camera of 55° sees them, apart and within the picture: of 1280 by 800, and larger.

    A text is 22 px high, below its place, and of 6.3 px a letter with margins of 10 px, as measured in pictures: in the
    light theme they are boxes.
    """
    eye, places = eye_of(vehicles), written_places(vehicles)
    texts: list[tuple[Any, str]] = [
        (place, text) for place, (text, _) in zip(places.legend, LEGEND.values(), strict=True)
    ]
    texts += zip(places.tips, ("north", "east", "down"), strict=True)
    for number in range(vehicles):
        stands = np.array(place_of(number))
        texts.append((stands + NAME_AT + lift_of(number), "1.1 NO COMPARE"))
        if not number:  # several with a diagnosis at once may have no room
            texts.append((stands + UNDONE_AT, "yaw_offset 25.0° undone"))
    boxes: list[tuple[str, float, float, float, float]] = []
    for place, text in texts:
        x, y = seen(np.array(place), np.array(eye.position), np.array(eye.target), size)
        half = 3.15 * len(text) + 5
        boxes.append((text, x - half, x + half, y + 2, y + 24))
    for (text, x0, x1, y0, y1), (other, u0, u1, v0, v1) in itertools.combinations(boxes, 2):
        assert max(u0 - x1, x0 - u1, v0 - y1, y0 - v1) >= 0, (text, other)
    for text, *edges in boxes:
        assert edges == pytest.approx(np.clip(edges, 0, [size[0], size[0], size[1], size[1]]), abs=1e-9), text


def seen(point: Array, eye: Array, target: Array, size: tuple[int, int]) -> tuple[float, float]:
    """Where a point is in a picture of this size, px from the upper left."""
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross((0.0, 0.0, 1.0), ahead)  # down is z, so this is to the right
    right = right / np.linalg.norm(right)
    down: Array = np.cross(ahead, right)
    scale = size[1] / 2 / math.tan(math.radians(55 / 2)) / float((point - eye) @ ahead)
    return size[0] / 2 + scale * float((point - eye) @ right), size[1] / 2 + scale * float((point - eye) @ down)


@pytest.mark.slow
@can_draw
def test_in_a_right_turn_the_right_wing_is_down(tmp_path: Path) -> None:
    """Rerun's own picture of a plane that flies north, banked by 40°: its outline goes down to the right.

    And of a left turn up.
    """
    for roll_deg in (40.0, -40.0):
        path = tmp_path / f"{roll_deg}.rrd"
        drawn(steady((roll_deg, 0, 0), vehicle=mavlink.MAV_TYPE_FIXED_WING), path)
        with headless(path, free_port(HEADLESS_PORT)) as viewer:
            viewer.wait_for("boot", 2_960_000)
            viewer.go_to(2_960_000)
            R_nb = viewer.matrix(f"{BODY}/quaternion")
            assert R_nb == pytest.approx(Rotation.from_euler("x", roll_deg, degrees=True).as_matrix(), abs=1e-6)

            def wing_is_down(picture: Picture, sign: float = math.copysign(1, roll_deg)) -> None:
                outline = np.argwhere(np.abs(picture - (255, 175, 60)).max(axis=2) < 60)
                outline = outline[outline[:, 1] > 0.42 * picture.shape[1]]  # of the body, not of the legend
                assert len(outline) > 100
                left, right = np.quantile(outline[:, 1], (0.1, 0.9))
                wings = [outline[side].mean(axis=0) for side in (outline[:, 1] > right, outline[:, 1] < left)]
                down, across = wings[0] - wings[1]
                assert sign * down > math.tan(math.radians(8)) * across, (down, across)

            viewer.shows(wing_is_down, only="3D")
            assert viewer.errors() == []
