"""What a firmware does to ATTITUDE on purpose is undone, followed and named; what it does not do is left to be seen."""

from __future__ import annotations

import dataclasses
import json
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

from gcs_bridge.diagnosis.causes import CAUSES
from gcs_bridge.expected import AHRS_TRIM, PITCH_TRIM, VTOL_VIEW, Expected
from gcs_bridge.telemetry.samples import ATTITUDE, ATTITUDE_QUATERNION, AttitudeSamples
from gcs_bridge.telemetry.statements import ModeSet, ParameterSet
from tests.helpers import wire
from tests.helpers.everyday import in_turns, one_in
from tests.helpers.paths import FIXTURES

Floats = npt.NDArray[np.float64]
Int64s = npt.NDArray[np.int64]
News = list[ParameterSet | ModeSet]

AUTOPILOTS = {3: "ardupilot", 12: "px4"}
TYPES = {1: "fixed_wing", 2: "quadrotor", 19: "vtol_duorotor"}
BAD_DEG = 0.5  # from here on a pair of one instant would vote for an alarm


class Flight(NamedTuple):
    """Both streams, and what was told among them."""

    euler: AttitudeSamples
    quaternion: AttitudeSamples
    news: News

    def untold(self) -> Flight:
        return self._replace(news=[say for say in self.news if isinstance(say, ModeSet)])

    def every(self, nth: int) -> Flight:
        """One of `nth` instants alone."""
        kept = np.union1d(self.euler.t_boot_us, self.quaternion.t_boot_us)[::nth]
        e, q = np.isin(self.euler.t_boot_us, kept), np.isin(self.quaternion.t_boot_us, kept)
        return Flight(self.euler[e], self.quaternion[q], self.news)

    def with_fault(self, name: str, *value: float, from_s: float = 0.0) -> Flight:
        """The same with a mistake in it, from a boot time on."""
        cause = CAUSES[name]
        assert cause.falsify is not None
        if cause.acts_on == "quaternion":
            q, since = self.quaternion.q_nb.copy(), self.quaternion.t_boot_us >= from_s * 1e6
            q[since] = np.float32(cause.falsify(q[since], value))
            return self._replace(quaternion=dataclasses.replace(self.quaternion, q_nb=q))
        assert self.euler.rpy_rad is not None
        rpy, since = self.euler.rpy_rad.copy(), self.euler.t_boot_us >= from_s * 1e6
        rpy[since] = np.float32(cause.falsify(rpy[since], value))
        return self._replace(euler=dataclasses.replace(self.euler, rpy_rad=rpy, q_nb=wxyz(from_rpy(rpy))))


class Seen(NamedTuple):
    """What came of a flight: per pair of one instant its boot time, ms, and how far the two forms are apart, deg."""

    q_nb: Floats
    causes: npt.NDArray[np.uint8]
    t_ms: Int64s
    apart_deg: Floats
    pair_causes: npt.NDArray[np.uint8]
    explanations: list[dict[str, Any]]
    untold: npt.NDArray[np.uint8]  # per sample of ATTITUDE, as are `q_nb` and `causes`

    @property
    def longest_bad_s(self) -> float:
        """From the first to the last of bad pairs that follow each other."""
        longest, since = 0.0, None
        for t_ms, bad in zip(self.t_ms.tolist(), self.apart_deg > BAD_DEG, strict=True):
            since = (t_ms if since is None else since) if bad else None
            longest = longest if since is None else max(longest, (t_ms - since) / 1e3)
        return longest

    def bad_share(self, from_s: float = 0.0) -> float:
        return float((self.apart_deg[self.t_ms >= from_s * 1e3] > BAD_DEG).mean())


def wxyz(rotation: Rotation) -> Floats:
    return np.asarray(rotation.as_quat()[:, [3, 0, 1, 2]])


def from_rpy(rpy_rad: Floats) -> Rotation:
    return Rotation.from_euler("ZYX", rpy_rad[:, ::-1])


def samples(
    frame_index: Int64s, t_us: Int64s, q_nb: Floats, w: Floats, rpy_rad: Floats | None = None
) -> AttitudeSamples:
    return AttitudeSamples(
        frame_index=frame_index,
        boot=np.zeros_like(t_us),
        t_boot_us=t_us,
        t_rx_us=np.full_like(t_us, -1),
        q_nb=np.array(q_nb, order="C"),
        w_nb_b_rad_s=np.array(w, order="C"),
        valid=np.asarray(np.isfinite(q_nb).all(axis=1)),
        source=ATTITUDE_QUATERNION if rpy_rad is None else ATTITUDE,
        rpy_rad=None if rpy_rad is None else np.array(rpy_rad, order="C"),
    )


@cache
def recorded(name: str, sysid: int = 1) -> Flight:
    """A bundled recording, as pymavlink reads it."""
    data = (FIXTURES / f"{name}.tlog").read_bytes()
    euler: list[list[float]] = []
    quaternion: list[list[float]] = []
    news = News()
    for frame_index, _, message in wire.messages(data, "ATTITUDE", "ATTITUDE_QUATERNION", "PARAM_VALUE", "HEARTBEAT"):
        if (message.get_srcSystem(), message.get_srcComponent()) != (sysid, 1):
            continue
        kind = message.get_type()
        if kind in ("ATTITUDE", "ATTITUDE_QUATERNION"):
            form = ("roll", "pitch", "yaw") if kind == "ATTITUDE" else ("q1", "q2", "q3", "q4")
            rates = ("rollspeed", "pitchspeed", "yawspeed")
            row = [frame_index, message.time_boot_ms, *(getattr(message, field) for field in (*form, *rates))]
            (euler if kind == "ATTITUDE" else quaternion).append(row)
        elif kind == "PARAM_VALUE":
            news.append(ParameterSet(frame_index, message.param_id, message.param_value))
        elif kind == "HEARTBEAT":
            autopilot, type_ = AUTOPILOTS[message.autopilot], TYPES[message.type]
            news.append(ModeSet(frame_index, autopilot, type_, message.custom_mode, armed=True))
    e, q = np.array(euler), np.array(quaternion)
    rpy = np.ascontiguousarray(e[:, 2:5])
    return Flight(
        samples(e[:, 0].astype(np.int64), (e[:, 1] * 1000).astype(np.int64), wxyz(from_rpy(rpy)), e[:, 5:8], rpy),
        samples(q[:, 0].astype(np.int64), (q[:, 1] * 1000).astype(np.int64), q[:, 2:6].copy(), q[:, 6:9]),
        news,
    )


def flown(
    attitude: Rotation, sent: Rotation | Floats | None = None, news: News | None = None, *, hz: float = 25.0
) -> Flight:
    """A flight through `attitude`, ATTITUDE just before ATTITUDE_QUATERNION; `sent` is what ATTITUDE shows, or says."""
    n = len(attitude)
    t_us = (np.arange(n) * 1e6 / hz).astype(np.int64) // 1000 * 1000 + 10_000_000
    w = np.zeros((n, 3))
    if n > 1:
        w[:-1] = (attitude[:-1].inv() * attitude[1:]).as_rotvec() * hz
    rpy = sent if isinstance(sent, np.ndarray) else (attitude if sent is None else sent).as_euler("ZYX")[:, ::-1]
    rpy = np.asarray(rpy, np.float32).astype(np.float64)
    return Flight(
        samples(10 + 2 * np.arange(n), t_us, wxyz(from_rpy(rpy)), w, rpy),
        samples(11 + 2 * np.arange(n), t_us, wxyz(attitude).astype(np.float32).astype(np.float64), w),
        [] if news is None else news,
    )


def weaving(n: int = 300, roll_deg: float = 30.0, pitch_deg: float = 5.0) -> Floats:
    """Roll, pitch and yaw of a winding flight, rad."""
    t = np.arange(n) / 25.0
    return np.radians(np.column_stack((roll_deg * np.sin(t), pitch_deg * np.sin(0.7 * t + 0.3), 10.0 * t)))


def mode(custom_mode: int, frame_index: int = 1, type_: str = "fixed_wing", autopilot: str = "ardupilot") -> ModeSet:
    return ModeSet(frame_index, autopilot, type_, custom_mode, armed=True)


def follow(flight: Flight, cuts: list[int] | None = None, expected: Expected | None = None) -> Seen:
    """Correct a flight, cut behind the frames `cuts`, and measure with SciPy what is left."""
    expected = Expected() if expected is None else expected
    q_nb, causes, untold = [], [], []
    edges = [-1, *(cuts or []), 1 << 60]
    for first, last in pairwise(edges):
        euler, quaternion = (of.frames(first + 1, last + 1) for of in (flight.euler, flight.quaternion))
        expected.told([say for say in flight.news if first < say.frame_index <= last])
        corrected = expected.correct(euler, quaternion)
        q_nb.append(corrected.q_nb)
        causes.append(corrected.causes)
        untold.append(corrected.untold)
    corrected_q, bits = np.concatenate(q_nb), np.concatenate(causes)
    t_us, at_e, at_q = np.intersect1d(flight.euler.t_boot_us, flight.quaternion.t_boot_us, return_indices=True)
    seen = Rotation.from_quat(np.roll(corrected_q[at_e], -1, axis=1))
    right = Rotation.from_quat(np.roll(flight.quaternion.q_nb[at_q], -1, axis=1))
    apart = np.degrees((seen.inv() * right).magnitude())
    return Seen(corrected_q, bits, t_us // 1000, apart, bits[at_e], explanations(expected), np.concatenate(untold))


def explanations(expected: Expected) -> list[dict[str, Any]]:
    """As a report shows them."""
    return [json.loads(msgspec.json.encode(one)) for one in expected.explanations()]


def explained(cause: str, value: Any, *, estimated: bool, alternatives: tuple[str, ...] = ()) -> dict[str, Any]:
    tolerance = 0.3 if estimated else 0.1
    value = pytest.approx(value, abs=tolerance)
    return {"cause": cause, "value": value, "unit": "deg", "estimated": estimated, "alternatives": list(alternatives)}


# --- by hand ---------------------------------------------------------------------------------------------------------


def once(parameters: dict[str, float], rpy_deg: list[float], custom_mode: int = 5) -> Floats:
    """What one sample of a plane stands for, once its parameters are told."""
    news: News = [mode(custom_mode), *(ParameterSet(1, name, value) for name, value in parameters.items())]
    level = Rotation.identity(1)
    q_nb: Floats = follow(flown(level, np.radians([rpy_deg]), news)).q_nb[0]
    return q_nb


def test_a_pitch_trim_by_hand() -> None:
    """A plane that sends level with a trim of 30° has its nose 30° up: (cos 15°, 0, sin 15°, 0)."""
    nose_up = [0.9659258, 0.0, 0.2588190, 0.0]
    np.testing.assert_allclose(once({"PTCH_TRIM_DEG": 30.0}, [0.0, 0.0, 0.0]), nose_up, atol=1e-7)
    np.testing.assert_allclose(once({"TRIM_PITCH_CD": 3000.0}, [0.0, 0.0, 0.0]), nose_up, atol=1e-7)


def test_a_pitch_trim_may_be_left_in() -> None:
    """FLIGHT_OPTIONS bit 8 says that nothing was subtracted, other bits do not."""
    told = {"PTCH_TRIM_DEG": 30.0}
    np.testing.assert_allclose(once(told | {"FLIGHT_OPTIONS": 256.0}, [0.0, 0.0, 0.0]), [1, 0, 0, 0])
    assert once(told | {"FLIGHT_OPTIONS": 255.0}, [0.0, 0.0, 0.0])[2] > 0.2


def test_a_tailsitter_by_hand() -> None:
    """A tailsitter that hovers upright sends level, and its nose points up: (√½, 0, √½, 0)."""
    upright = once({"Q_TAILSIT_ENABLE": 1.0, "Q_TRIM_PITCH": 0.0}, [0.0, 0.0, 0.0], custom_mode=18)
    np.testing.assert_allclose(upright, [0.5**0.5, 0, 0.5**0.5, 0], atol=1e-12)


def test_a_hovering_quadplane_shows_its_view_and_no_pitch_trim() -> None:
    """In a VTOL mode Q_TRIM_PITCH is undone instead of PTCH_TRIM_DEG: level sent is 10° up."""
    told = {"Q_ENABLE": 1.0, "Q_TAILSIT_ENABLE": 0.0, "Q_TRIM_PITCH": 10.0, "PTCH_TRIM_DEG": 30.0}
    ten_up = [0.9961947, 0.0, 0.0871557, 0.0]
    np.testing.assert_allclose(once(told, [0.0, 0.0, 0.0], custom_mode=19), ten_up, atol=1e-7)


def test_trims_of_the_sensors_by_hand() -> None:
    """At 60° of roll, TRIM_Y of 2° puts both forms 2.00° apart: pitch by 2° about a level axis, and about the wing."""
    trim = np.radians(2.0)
    attitude = from_rpy(np.radians([[60.0, 0.0, 0.0]]))
    sent = np.radians([[60.0, -2.0, 0.0]])
    flight = flown(attitude * Rotation.from_rotvec([0.0, -trim, 0.0]), sent, [mode(5, type_="quadrotor")])
    assert follow(flight).apart_deg[0] == pytest.approx(2.0, abs=1e-3)
    told: News = [ParameterSet(2, "AHRS_TRIM_X", 0.0), ParameterSet(3, "AHRS_TRIM_Y", trim)]
    seen = follow(flight._replace(news=flight.news + told))
    assert seen.apart_deg[0] < 1e-4
    assert seen.pair_causes[0] == AHRS_TRIM


# --- recordings ------------------------------------------------------------------------------------------------------

TOLD = [
    ("k16_plane_trim_changes", 1, ["pitch_trim", "pitch_trim"], [-3.0, 2.0]),
    ("k1_copter_trim", 1, ["ahrs_trim"], [[-2.0, 3.0]]),
    ("k5_three_vehicles", 7, ["ahrs_trim"], [[0.0, 2.0]]),
    ("k4_quadplane", 1, ["vtol_view"], [4.0]),
]
UNTOLD = [
    ("d_plane_pitchtrim3", 1, ["pitch_trim"], [3.0]),
    ("j_ahrs_trim5", 1, ["ahrs_trim"], [[5.0, -3.0]]),
    ("d_tailsitter", 1, ["vtol_view"], [90.0]),
    ("d_tailsitter_tumble", 1, ["vtol_view"], [90.0]),
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "sysid", "causes", "values"), TOLD)
def test_what_was_told_is_undone(name: str, sysid: int, causes: list[str], values: list[Any]) -> None:
    """With its parameters told, a recording shows no difference, and the numbers are the parameters'."""
    seen = follow(recorded(name, sysid))
    assert np.median(seen.apart_deg) < 1e-4
    assert seen.apart_deg.max() < 0.1  # before the parameters came the trims were smaller than that, near level
    assert seen.explanations == [explained(*one, estimated=False) for one in zip(causes, values, strict=True)]


@pytest.mark.parametrize("nth", one_in(3, [1, 3, 6], swept=False))
@pytest.mark.parametrize(("name", "sysid", "causes", "values"), one_in(4, TOLD + UNTOLD))
def test_what_was_not_told_is_fitted(name: str, sysid: int, causes: list[str], values: list[Any], nth: int) -> None:
    """Without parameters, at 25 to 4 Hz, the numbers are found before anything could be alarming, and are right."""
    seen = follow(recorded(name, sysid).untold().every(nth))
    assert np.median(seen.apart_deg) < 1e-3
    assert seen.longest_bad_s < 1.0
    assert seen.explanations == [explained(*one, estimated=True) for one in zip(causes, values, strict=True)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "forward_ms"),
    [
        ("d_tailsitter", [(91139, 108940)]),
        ("d_tailsitter_tumble", [(164821, 999999)]),
        ("k4_quadplane", [(0, 26741), (63662, 88259)]),
    ],
)
def test_the_view_changes_at_its_sample(name: str, forward_ms: list[tuple[int, int]]) -> None:
    """From the very sample at which the firmware changes its view, however late behind the mode, so do we."""
    facts = json.loads((FIXTURES / f"{name}.facts.json").read_text())
    assert {event["boot_ms"] for event in facts["events"]} >= {
        at for span in forward_ms for at in span if 0 < at < 999999
    }
    seen = follow(recorded(name))
    fitted = seen.t_ms >= seen.t_ms[0] + 600  # mode and view are known by then
    forward = np.logical_or.reduce([(seen.t_ms >= first) & (seen.t_ms < last) for first, last in forward_ms])
    np.testing.assert_array_equal(seen.pair_causes[fitted] == VTOL_VIEW, ~forward[fitted])


@pytest.mark.slow
def test_a_trim_is_followed_as_it_changes() -> None:
    """The two changes in flight take effect at the very samples at which the firmware's own do."""
    seen = follow(recorded("k16_plane_trim_changes"))
    assert seen.apart_deg.max() < 1e-4
    assert seen.t_ms[seen.pair_causes == PITCH_TRIM][0] == 38664


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "sysid"), [("k13b_px4_tailsitter_fw", 1), ("a_copter_square", 1), ("k5_three_vehicles", 3)]
)
def test_nothing_is_undone_where_nothing_was_done(name: str, sysid: int) -> None:
    """A PX4 tailsitter and copters without trims keep their samples as they are, not even copied."""
    flight = recorded(name, sysid)
    expected = Expected()
    expected.told(flight.news)
    assert expected.correct(flight.euler, flight.quaternion).q_nb is flight.euler.q_nb
    assert expected.explanations() == []


# --- faults ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("share", "told"), one_in(3, [(0.0, False), (0.5, True), (0.5, False)], swept=False))
@pytest.mark.parametrize(
    ("fault", "value"),
    one_in(
        2,
        [
            ("yaw_offset", (5.0,)),
            ("yaw_offset", (1.5,)),
            ("mount_offset", (0.0, 90.0, 0.0)),
            ("mount_offset", (4.0, 0.0, 0.0)),
            ("mount_offset", (0.0, 0.0, 2.0)),
            ("quaternion_conjugate", ()),
            ("quaternion_xyzw", ()),
            ("euler_degrees", ()),
        ],
    ),
)
@pytest.mark.parametrize(("name", "sysid"), one_in(8, [(name, sysid) for name, sysid, *_ in [*TOLD, *UNTOLD]]))
def test_a_fault_is_not_explained(
    name: str, sysid: int, fault: str, value: tuple[float, ...], share: float, told: bool
) -> None:
    """A mistake on top of a trim or a view stays as large as it is, from the start and from the middle on."""
    flight = recorded(name, sysid)
    t_s = flight.euler.t_boot_us / 1e6
    since_s = t_s[0] + share * (t_s[-1] - t_s[0])
    seen = follow((flight if told else flight.untold()).every(3).with_fault(fault, *value, from_s=since_s))
    # A second 90° looks like a view that lags behind its mode, for as long as a view may lag.
    if name == "k4_quadplane" and value == (0.0, 90.0, 0.0) and not told and not share:
        since_s = 63.0  # It hovers at once, and might be a tailsitter, until it flies forward pitched like that.
        assert seen.explanations == []
    assert seen.bad_share(since_s) > (0.4 if name == "d_tailsitter_tumble" else 0.75)


@pytest.mark.parametrize("told", [True, False])
def test_a_mount_offset_in_a_banked_plane_is_no_trim(told: bool) -> None:
    """4° about the wing differ from a trim of 4° by 4°·sin(bank), and no mixture of trims may explain them."""
    flight = recorded("k16_plane_trim_changes")
    seen = follow((flight if told else flight.untold()).with_fault("mount_offset", 0.0, 4.0, 0.0, from_s=42.0))
    assert seen.bad_share(42.2) == 1.0


@pytest.mark.parametrize("axis", [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.6, 0.8]])
def test_a_turn_about_another_axis_never_fits(axis: list[float]) -> None:
    """A constant turn that is not about the wing is no trim, even of a plane that stands still."""
    still = from_rpy(np.tile(np.radians([0.3, 1.0, 40.0]), (200, 1)))
    flight = flown(still * Rotation.from_rotvec(np.radians(2.0) * np.array(axis)), still, [mode(5)])
    assert follow(flight).bad_share() == 1.0


def trimmed(rpy: Floats, *trim_deg: float) -> Flight:
    """A copter's flight with AHRS_TRIM_X and AHRS_TRIM_Y, untold."""
    x, y = np.radians(trim_deg)
    attitude = from_rpy(rpy) * Rotation.from_rotvec([-x, -y, 0.0])
    return flown(attitude, rpy - np.array([x, y, 0.0]), [mode(5, type_="quadrotor")])


def test_trims_of_the_sensors_are_fitted_as_soon_as_a_copter_leans() -> None:
    """Both numbers come out of a second of winding flight; of one that stands still they cannot."""
    seen = follow(trimmed(weaving(25, 5.0), 4.0, -3.0))
    assert seen.explanations == [explained("ahrs_trim", [4.0, -3.0], estimated=True)]
    drifting = np.linspace([0.0, 0.0, 0.0], [1e-3, 0.0, 0.0], 1000)  # 3° · 1e-3 in forty seconds, thirty noises
    assert follow(trimmed(drifting, 4.0, -3.0)).explanations == [explained("ahrs_trim", [4.0, -3.0], estimated=True)]
    for wobble_rad in (1e-6, 1e-5):
        still = np.random.default_rng(3).normal(0.0, wobble_rad, (200, 3))
        assert follow(trimmed(still, 4.0, -3.0)).explanations == []


@pytest.mark.slow
def test_trims_of_the_sensors_are_not_fitted_beside_a_fault() -> None:
    """A turn of a tenth of a degree about the nose, which trims do not make, is enough to fit nothing."""
    flight = trimmed(weaving(), 4.0, -3.0)
    assert follow(flight.with_fault("mount_offset", 0.1, 0.0, 0.0)).explanations == []


def test_a_pitch_offset_of_a_copter_is_a_fault() -> None:
    """Only planes have a pitch trim: the same 3° on a copter stay, and on a plane they are explained."""
    rpy = weaving()
    sent = rpy - np.radians([0.0, 3.0, 0.0])
    assert follow(flown(from_rpy(rpy), sent, [mode(5, type_="quadrotor")])).bad_share() == 1.0
    assert follow(flown(from_rpy(rpy), sent, [mode(5, autopilot="px4")])).bad_share() == 1.0
    assert follow(flown(from_rpy(rpy), sent, [mode(5)])).longest_bad_s < 0.1


def test_a_large_pitch_offset_is_a_fault() -> None:
    """What no trim was ever set to is not fitted: 14° are, 16° are not."""
    rpy = weaving()
    for trim_deg, share in ((14.0, 0.01), (16.0, 1.0)):
        sent = rpy - np.radians([0.0, trim_deg, 0.0])
        assert follow(flown(from_rpy(rpy), sent, [mode(5)])).bad_share() == pytest.approx(share, abs=1e-9)


def test_a_level_mount_offset_is_named_beside_the_trim_and_given_up_with_bank() -> None:
    """Exactly level nobody can tell the two; the first bank can, and from then on it is a fault, level or not."""
    level, banked = np.zeros((100, 3)), weaving(100)
    turn = Rotation.from_euler("y", 4.0, degrees=True)
    on_ground = follow(flown(from_rpy(level) * turn, level, [mode(5)]))
    assert on_ground.explanations == [explained("pitch_trim", 4.0, estimated=True, alternatives=("mount_offset",))]
    assert on_ground.apart_deg[3:].max() < 1e-3
    rpy = np.concatenate((level, banked, level))
    seen = follow(flown(from_rpy(rpy) * turn, rpy, [mode(5)]))
    assert seen.explanations == []
    assert (seen.apart_deg[105:] > 3.9).all()


def test_a_wrong_sign_of_pitch_is_named_beside_the_trim_and_given_up_when_pitch_moves() -> None:
    """Standing still nose up by 2°, minus 2° may be a trim of 4°; it is none as soon as pitch moves."""
    still = np.tile(np.radians([0.3, 2.0, 40.0]), (100, 1))
    sign = np.array([1.0, -1.0, 1.0])
    seen = follow(flown(from_rpy(still), still * sign, [mode(5)]))
    assert seen.explanations == [explained("pitch_trim", 4.0, estimated=True, alternatives=("pitch_sign",))]
    rpy = np.concatenate((still, still[0] + weaving(200)))
    seen = follow(flown(from_rpy(rpy), rpy * sign, [mode(5)]))
    assert seen.explanations == []
    assert seen.bad_share(14.5) > 0.9


def test_what_was_given_up_has_to_be_told_apart_from_then_on() -> None:
    """A mount offset that looked like a trim for three level samples does not fool us with the next three."""
    level, banked = np.zeros((3, 3)), np.tile(np.radians([20.0, 0.0, 0.0]), (4, 1))
    rpy = np.concatenate((level, banked, level, level))
    flight = flown(from_rpy(rpy) * Rotation.from_euler("y", 4.0, degrees=True), rpy, [mode(5)])
    assert follow(flight).explanations == []


def test_a_trim_that_changes_with_pitch_is_none() -> None:
    """With a wrong sign every new pitch looks like another trim: the first change ends it."""
    steps = np.repeat(np.linspace(1.0, 3.0, 20), 4)
    rpy = np.radians(np.column_stack((0 * steps + 0.3, steps, 0 * steps)))
    assert follow(flown(from_rpy(rpy), rpy * np.array([1.0, -1.0, 1.0]), [mode(5)])).explanations == []


def test_pairs_near_the_pole_deny_nothing() -> None:
    """There float32 angles are off by more than a pair's noise, and a fit that still is to be proven survives them."""
    pitch = np.where(np.arange(100) < 50, 0.0, 1.55)
    noise = np.where(pitch > 0, np.random.default_rng(5).normal(0.0, 1e-4, 100), 0.0)
    rpy = np.column_stack((0 * pitch, pitch, 0 * pitch))
    sent = rpy + np.column_stack((noise, 0 * pitch - np.radians(3.0), 0 * pitch))
    assert follow(flown(from_rpy(rpy), sent, [mode(5)])).explanations[0]["cause"] == "pitch_trim"


def test_a_sign_that_turns_wrong_while_nothing_moves_is_a_fault() -> None:
    """On a plane that stood in agreement, a sudden 4° is no trim as long as pitch has not moved since."""
    still = np.tile(np.radians([0.3, 2.0, 40.0]), (200, 1))
    flight = flown(from_rpy(still), still, [mode(5)]).with_fault("pitch_sign", from_s=14.0)
    assert follow(flight).bad_share(14.0) == 1.0


@pytest.mark.parametrize("was_deg", [None, 0.0, -2.0])
@pytest.mark.parametrize(("roll_deg", "share"), [(30.0, 0.05), (0.0, 1.0)])
def test_a_trim_that_changes_untold_is_told_from_a_fault_by_bank(
    was_deg: float | None, roll_deg: float, share: float
) -> None:
    """Behind agreement a new difference is a trim only where bank tells, the old one told or not: level a fault."""
    rpy = weaving(300, roll_deg)
    trim = np.radians(np.where(np.arange(300) < 150, was_deg or 0.0, 3.0))
    sent = rpy - np.column_stack((0 * trim, trim, 0 * trim))
    told: News = [] if was_deg is None else [ParameterSet(2, "PTCH_TRIM_DEG", was_deg)]
    seen = follow(flown(from_rpy(rpy), sent, [mode(5), *told]))
    assert seen.bad_share(16.0) <= share
    assert (seen.bad_share(16.0) == 1.0) == (share == 1.0)
    if share < 1.0:
        assert seen.explanations[-1] == explained("pitch_trim", 3.0, estimated=True)


@pytest.mark.parametrize(("late_s", "is_fault"), [(0.5, False), (2.0, False), (8.0, True)])
def test_a_mode_that_is_told_late_tells_a_view_that_is_not_there_for_long(late_s: float, is_fault: bool) -> None:
    """Its mode alone says that a plane hovers, and heartbeats may be lost; what has been there for long is a fault."""
    rpy = weaving(900, 5.0, 2.0)
    turned = np.where(np.arange(900) < 300, 0.0, -4.0)[:, None] * [0.0, 1.0, 0.0]
    view = from_rpy(rpy) * Rotation.from_rotvec(np.radians(turned))
    told: News = [mode(5), mode(18, 10 + 2 * (300 + round(25 * late_s)))]
    seen = follow(flown(from_rpy(rpy), view, told))
    assert seen.bad_share(10.0 + 12.0 + late_s + 1.5) == (1.0 if is_fault else 0.0)


def test_a_view_that_stays_in_forward_flight_is_a_fault() -> None:
    """90° while hovering may be a tailsitter's view; if they stay long after the mode has changed, they never were."""
    rpy = weaving(1000, 5.0, 2.0)
    turned = from_rpy(rpy) * Rotation.from_euler("y", 90.0, degrees=True)
    modes: News = [mode(18), mode(5, 200)]
    hovering = follow(flown(turned[:90], rpy[:90], modes[:1]))
    assert hovering.explanations == [explained("vtol_view", 90.0, estimated=True, alternatives=("mount_offset",))]
    seen = follow(flown(turned, rpy, modes))
    assert seen.explanations == []
    assert (seen.apart_deg[seen.t_ms > 25_000] > 80.0).all()


def test_a_view_that_appears_without_a_change_of_mode_is_a_fault() -> None:
    """A quadplane that hovered in agreement for long, and then shows 4° more, has a mount that slipped."""
    rpy = weaving(600, 5.0, 2.0)
    slipped = flown(from_rpy(rpy), None, [mode(18)]).with_fault("mount_offset", 0.0, 4.0, 0.0, from_s=25.0)
    assert follow(slipped).bad_share(25.0) == 1.0


def test_a_fault_beside_a_fitted_view_is_seen_alone() -> None:
    """Views are constant: once the vehicle has moved, 3° more about the same axis are 3° of a fault."""
    rpy = weaving(200, 5.0, 2.0)
    view = from_rpy(rpy) * Rotation.from_euler("y", -4.0, degrees=True)
    seen = follow(flown(from_rpy(rpy), view, [mode(18)]).with_fault("mount_offset", 0.0, 3.0, 0.0, from_s=14.0))
    assert seen.explanations == [explained("vtol_view", 4.0, estimated=True, alternatives=("mount_offset",))]
    np.testing.assert_allclose(seen.apart_deg[100:], 3.0, atol=1e-3)


def test_a_view_that_changes_with_pitch_is_none() -> None:
    """With a wrong sign a level hover looks like a view, until it moves: then nothing of it is left."""
    pitch = np.concatenate((np.full(50, 2.0), np.linspace(2.0, 6.0, 50)))
    rpy = np.radians(np.column_stack((0 * pitch, pitch, 0 * pitch)))
    seen = follow(flown(from_rpy(rpy), rpy * np.array([1.0, -1.0, 1.0]), [mode(18)]))
    assert seen.explanations == []
    assert seen.apart_deg[60:].min() > 4.0


def test_a_fault_between_two_views_keeps_its_size() -> None:
    """2.2° beside a view of 4° are not 1.8° beside the other one, however long the view may change."""
    rpy = weaving(200, 5.0, 2.0)
    told: News = [ParameterSet(1, "Q_TRIM_PITCH", 4.0), ParameterSet(2, "Q_TAILSIT_ENABLE", 0.0), mode(18, 3)]
    view = from_rpy(rpy) * Rotation.from_euler("y", -4.0, degrees=True)
    seen = follow(flown(from_rpy(rpy), view, told).with_fault("mount_offset", 0.0, -2.2, 0.0))
    np.testing.assert_allclose(seen.apart_deg[1:], 2.2, atol=1e-3)


def test_ninety_degrees_without_a_vtol_mode_are_a_fault() -> None:
    """A plane that never hovered, and one that was told to be no tailsitter, have no such view."""
    rpy = weaving(300, 5.0, 2.0)
    turned = from_rpy(rpy) * Rotation.from_euler("y", 90.0, degrees=True)
    no_tailsitter: News = [mode(18), ParameterSet(2, "Q_TAILSIT_ENABLE", 0.0), ParameterSet(3, "Q_TRIM_PITCH", 0.0)]
    no_vtol: News = [mode(18), ParameterSet(1, "Q_ENABLE", 0.0)]
    never_vtol: list[News] = [[mode(5)], [mode(10)], no_tailsitter, no_vtol]
    for news in never_vtol:
        assert (follow(flown(turned, rpy, news)).apart_deg > 80.0).all()


def test_a_view_that_the_mode_does_not_tell_is_believed_for_a_second() -> None:
    """Heartbeats may be late: the other view is taken for what it is at once, and for a fault if no mode follows."""
    attitude = from_rpy(weaving(500, 5.0, 2.0) + np.radians([0.0, 45.0, 0.0]))
    view = attitude * Rotation.from_euler("y", -90.0, degrees=True)
    sent = Rotation.concatenate((attitude[:350], view[350:]))
    told: News = [ParameterSet(2, "Q_TAILSIT_ENABLE", 1.0), ParameterSet(3, "Q_TRIM_PITCH", 0.0), mode(18, 4)]
    told += [mode(5, 5), mode(18, 10 + 2 * 370)]
    assert follow(flown(attitude, sent, told)).apart_deg.max() < 1e-3
    silent = follow(flown(attitude, sent, told[:-1]))
    assert silent.apart_deg[:375].max() < 1e-3
    assert silent.apart_deg[378:].min() > 80.0


# --- told and absent -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value", "custom_mode"), [("PTCH_TRIM_DEG", 3.0, 5), ("AHRS_TRIM_Y", 0.05, 5), ("Q_TRIM_PITCH", 4.0, 18)]
)
def test_what_the_stream_denies_is_not_undone(name: str, value: float, custom_mode: int) -> None:
    """A firmware that does nothing with a parameter agrees with itself: three pairs end the correction for good."""
    news: News = [mode(custom_mode), ParameterSet(2, "Q_TAILSIT_ENABLE", 0.0)]
    news += [ParameterSet(frame_index, name, value) for frame_index in (3, 400)]
    seen = follow(flown(from_rpy(weaving(400)), None, news))
    assert (seen.apart_deg > 0.01).sum() <= 3
    assert seen.apart_deg[-10:].max() < 1e-4
    assert seen.explanations == []


def test_an_older_quadplane_subtracts_its_pitch_trim_while_it_hovers() -> None:
    """Where the view was shown by tailsitters alone, what was told of forward flight fits, and is found."""
    rpy = weaving()
    news: News = [mode(18), ParameterSet(2, "Q_TRIM_PITCH", 4.0), ParameterSet(3, "Q_TAILSIT_ENABLE", 0.0)]
    seen = follow(
        flown(from_rpy(rpy), rpy - np.radians([0.0, 3.0, 0.0]), [*news, ParameterSet(4, "PTCH_TRIM_DEG", 3.0)])
    )
    assert seen.longest_bad_s < 0.1
    assert seen.explanations == [explained("pitch_trim", 3.0, estimated=False)]


def test_a_fault_beside_an_absent_trim_stays() -> None:
    """Neither with the trim nor without it does a yaw offset fit, so what was told goes on."""
    attitude = from_rpy(weaving())
    told: News = [mode(5), ParameterSet(2, "PTCH_TRIM_DEG", 3.0)]
    assert follow(flown(attitude, None, told).with_fault("yaw_offset", 5.0)).bad_share() == 1.0


def test_parameters_and_fits_outlive_a_reboot() -> None:
    """After a restart the first sample is corrected by what is known, and by nothing that was only pending."""
    rpy = weaving()
    flight = flown(from_rpy(rpy), rpy - np.radians([0.0, 3.0, 0.0]), [mode(5)])
    expected = Expected()
    follow(flight, expected=expected)
    expected.start_boot()
    assert follow(flight._replace(news=[]), expected=expected).apart_deg.max() < 1e-3


def test_denials_do_not_add_up_over_a_reboot() -> None:
    """Two pairs before it and one behind it are no three in a row."""
    level = np.zeros((50, 3))
    flight = flown(from_rpy(level), level - np.radians([0.0, 3.0, 0.0]), [mode(5)])
    expected = Expected()
    follow(flight.with_fault("yaw_offset", 5.0, from_s=11.9), expected=expected)
    expected.start_boot()
    later = Flight(
        dataclasses.replace(flight.euler, frame_index=flight.euler.frame_index + 1000),
        dataclasses.replace(flight.quaternion, frame_index=flight.quaternion.frame_index + 1000),
        news=[],
    )
    first = later.quaternion.q_nb.copy()
    first[0] = later.with_fault("yaw_offset", 5.0).quaternion.q_nb[0]
    seen = follow(later._replace(quaternion=dataclasses.replace(later.quaternion, q_nb=first)), expected=expected)
    assert (seen.apart_deg > 0.01).sum() == 1
    assert len(seen.explanations) == 1


def test_news_about_something_else_leave_a_fit_alone() -> None:
    """Parameters that say nothing of a fitted trim do not end it, one that tells it does."""
    rpy = weaving()
    others = ("Q_ENABLE", "FLIGHT_OPTIONS", "AHRS_TRIM_X", "AHRS_TRIM_Y")
    news: News = [mode(5), *(ParameterSet(200 + 20 * at, name, 0.0) for at, name in enumerate(others))]
    flight = flown(from_rpy(rpy), rpy - np.radians([0.0, 3.0, 0.0]), news)
    assert (follow(flight).apart_deg > 0.01).sum() == 3
    told = follow(flight._replace(news=[*news, ParameterSet(400, "PTCH_TRIM_DEG", 3.0)]))
    assert (told.apart_deg > 0.01).sum() == 3
    assert told.explanations == [explained("pitch_trim", 3.0, estimated=False)]


def test_what_nobody_could_see_needs_no_explanation() -> None:
    """A trim of 0.01° is undone and not mentioned, one of 0.03° is."""
    for trim_deg, mentioned in ((0.01, 0), (0.03, 1)):
        rpy = weaving()
        sent = rpy - np.radians([0.0, trim_deg, 0.0])
        seen = follow(flown(from_rpy(rpy), sent, [mode(5), ParameterSet(2, "PTCH_TRIM_DEG", trim_deg)]))
        assert seen.apart_deg.max() < 1e-4
        assert len(seen.explanations) == mentioned


def test_invalid_samples_take_no_part() -> None:
    """NaN angles and quaternions change nothing of what the others say."""
    flight = recorded("d_plane_pitchtrim3")
    rpy, q = np.array(flight.euler.rpy_rad), flight.quaternion.q_nb.copy()
    rpy[5::7], q[3::11] = np.nan, np.nan
    euler = dataclasses.replace(flight.euler, rpy_rad=rpy, valid=np.asarray(np.isfinite(rpy).all(axis=1)))
    quaternion = dataclasses.replace(flight.quaternion, q_nb=q, valid=np.asarray(np.isfinite(q).all(axis=1)))
    expected = Expected()
    expected.told(flight.news)
    corrected = expected.correct(euler, quaternion)
    assert explanations(expected) == [explained("pitch_trim", 3.0, estimated=True)]
    assert (np.isnan(corrected.q_nb).any(axis=1) == ~euler.valid)[20:].all()


# --- what may be hidden ----------------------------------------------------------------------------------------------

COPTER = mode(0, type_="quadrotor")
LEVEL_THEN_BANKED = weaving(300) * np.column_stack((np.arange(300) >= 100, np.ones(300), np.ones(300)))


def test_a_trim_may_be_hidden_until_a_bank_denies_it() -> None:
    """Level flight shows no AHRS_TRIM; of agreement in a bank the third pair says that there is none, ever after."""
    flight = flown(from_rpy(LEVEL_THEN_BANKED), news=[COPTER])
    banked = np.abs(LEVEL_THEN_BANKED[:, 0]) > np.radians(5.0)
    first = int(np.flatnonzero(banked)[0])
    untold = follow(flight).untold
    assert (untold[: first + 1] == AHRS_TRIM).all()
    assert (untold[first + 4 :] == 0).all()


def test_what_was_told_is_not_hidden() -> None:
    """Parameters that are told, another autopilot, a fit: nothing is hidden. Half of the parameters tell nothing."""
    level = from_rpy(LEVEL_THEN_BANKED[:100])
    trims = [ParameterSet(2, f"AHRS_TRIM_{axis}", 0.01) for axis in "XY"]
    assert not follow(flown(level, news=[mode(4, type_="quadrotor", autopilot="px4")])).untold.any()
    assert not follow(flown(level, news=[COPTER, *trims])).untold.any()
    assert (follow(flown(level, news=[COPTER, trims[0]])).untold == AHRS_TRIM).all()
    assert (follow(flown(level, news=[mode(5)])).untold == AHRS_TRIM | PITCH_TRIM).all()
    fitted = follow(recorded("j_ahrs_trim5"))
    assert AHRS_TRIM in fitted.untold
    assert fitted.untold[-1] == 0


# --- however it was cut ----------------------------------------------------------------------------------------------


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "sysid", "fault"),
    [(*of, fault) for of, fault in in_turns(1, [one[:2] for one in [*TOLD, *UNTOLD]], [None, "pitch_sign"])],
)
def test_cuts_change_nothing(name: str, sysid: int, fault: str | None) -> None:
    """Whole, in a few pieces or frame by frame, told or not: the same bits and the same explanations."""
    flight = recorded(name, sysid)
    flight = flight.untold() if fault else flight
    if fault:
        flight = flight.with_fault(fault, from_s=float(flight.euler.t_boot_us.mean() / 1e6))
    frames = np.union1d(flight.euler.frame_index, flight.quaternion.frame_index)
    whole = follow(flight)
    rng = np.random.default_rng(7)
    for pieces in (4, 150, len(frames)) if name == "d_tailsitter_tumble" else (4, 150):
        seen = follow(flight, np.sort(rng.choice(frames, pieces, replace=False)).tolist())
        np.testing.assert_array_equal(seen.q_nb, whole.q_nb)
        np.testing.assert_array_equal(seen.causes, whole.causes)
        np.testing.assert_array_equal(seen.untold, whole.untold)
        assert seen.explanations == whole.explanations
