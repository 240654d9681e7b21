"""Alignment against a motion that is known at every instant: SciPy's spline is the truth, its Slerp the simpler way."""

from collections.abc import Sequence
from dataclasses import fields
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from gcs_bridge.pairing.pairs import Aligner, Pairs
from gcs_bridge.settings import AlignmentSettings, ResetSettings
from gcs_bridge.telemetry.samples import ATTITUDE, ATTITUDE_QUATERNION, AttitudeSamples
from tests.helpers import wire
from tests.helpers.everyday import one_in, searched

Array = NDArray[np.float64]
EULER, QUATERNION = 0, 1


class Sample(NamedTuple):
    """One attitude as it came: its stream, stamp, [w, x, y, z] and body rates."""

    stream: int
    t_us: int
    q: Array
    w: Array


def samples(motion: wire.Motion, stream: int, times_ms: Sequence[int] | NDArray[np.int64]) -> list[Sample]:
    ms = np.asarray(times_ms, np.int64)
    q, w = motion.wxyz(ms / 1000.0), motion.rates(ms / 1000.0)
    return [Sample(stream, int(t) * 1000, q[i], w[i]) for i, t in enumerate(ms)]


def every(step_ms: float, seconds: float, first_ms: int = 0) -> NDArray[np.int64]:
    return np.arange(first_ms, 1000 * seconds, step_ms).astype(np.int64)


def in_time(*streams: list[Sample]) -> list[Sample]:
    """As they come where nothing is late: by stamp, ATTITUDE first."""
    return sorted((s for stream in streams for s in stream), key=lambda s: (s.t_us, s.stream))


def packed(arrived: Sequence[Sample], stream: int, first: int) -> AttitudeSamples:
    """Those of one stream; the frame that brings each is its place, counted from `first`."""
    mine = [s for s in arrived if s.stream == stream]
    n = len(mine)
    t = np.array([s.t_us for s in mine], np.int64)
    q = np.array([s.q for s in mine]).reshape(n, 4)
    w = np.array([s.w for s in mine]).reshape(n, 3)
    source = (ATTITUDE, ATTITUDE_QUATERNION)[stream]
    return AttitudeSamples(
        frame_index=np.array([first + i for i, s in enumerate(arrived) if s.stream == stream], np.int64),
        boot=np.zeros(n, np.int64),
        t_boot_us=t,
        t_rx_us=wire.START_US + t,
        q_nb=q,
        w_nb_b_rad_s=w,
        valid=np.ones(n, np.bool_),
        source=source,
    )


def paired(arrived: Sequence[Sample], cuts: Sequence[int] = ()) -> Pairs:
    """All pairs of what arrived, in batches cut at `cuts`."""
    aligner = Aligner(AlignmentSettings(), ResetSettings())
    parts = []
    for lo, hi in pairwise([0, *cuts, len(arrived)]):
        batch = arrived[lo:hi]
        streams = np.array([s.stream for s in batch], np.int64)
        parts.append(aligner.pair(packed(batch, EULER, lo), packed(batch, QUATERNION, lo), streams).pairs)
    return Pairs.joined(parts)


def degrees_between(a: Array, b: Array) -> Array:
    """Angle of the rotation between [w, x, y, z] and [w, x, y, z], by SciPy."""
    to = [1, 2, 3, 0]
    angle: Array = np.degrees((Rotation.from_quat(a[:, to]).inv() * Rotation.from_quat(b[:, to])).magnitude())
    return angle


# --- interpolation ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fast_ms", "slow_ms", "speed", "p99_deg"),
    one_in(
        2,
        [(20, 100, 1.0, 0.002), (40, 100, 1.0, 0.02), (100, 250, 1.0, 0.2), (100, 250, 3.0, 0.7), (250, 500, 0.5, 1.0)],
    ),
)
@pytest.mark.parametrize("faster", [EULER, QUATERNION])
def test_the_faster_stream_interpolated_is_near_the_truth(
    faster: int, fast_ms: int, slow_ms: int, speed: float, p99_deg: float
) -> None:
    """At every pair within its bound and half a degree; over all of them at least three times nearer than Slerp."""
    motion = wire.Motion(60, seed=4, speed_rad_s=speed)
    fast_at = every(fast_ms, 60, 3)
    arrived = in_time(samples(motion, faster, fast_at), samples(motion, 1 - faster, every(slow_ms, 59, 7)))
    pairs = paired(arrived)
    between = pairs.interval_id >= 0
    assert between.sum() > 0.9 * 59_000 / slow_ms
    t_s = pairs.t_boot_us[between] * 1e-6
    interpolated = (pairs.q_euler, pairs.q_quaternion)[faster][between]
    error = degrees_between(motion.wxyz(t_s), interpolated)
    assert (error <= np.degrees(pairs.bound_rad[between]) + 0.5).all()
    assert np.percentile(error, 99) < p99_deg
    slerp = wire.wxyz(Slerp(fast_at / 1000.0, motion.rotation(fast_at / 1000.0))(t_s))
    assert np.percentile(error, 99) < np.percentile(degrees_between(motion.wxyz(t_s), slerp), 99) / 3
    assert np.abs(pairs.w_nb_b_rad_s[between] - motion.rates(t_s)).max() < 0.5 * speed


@pytest.mark.parametrize(
    ("fast_rad", "slow_rad", "smallest"), [(0.04, 0.01, "kin"), (0.4, 0.03, "slower"), (0.4, 0.4, "ceiling")]
)
def test_the_bound_is_the_specifications_formula(fast_rad: float, slow_rad: float, smallest: str) -> None:
    """One pair worked by hand for each of its three caps: yaw rate 0 → 1 rad/s in 0.1 s, in the middle of the gap."""
    down = np.array([0.0, 0.0, 1.0])

    def turned(stream: int, ms: int, angle: float, rate: float) -> Sample:
        return Sample(stream, 1000 * ms, np.array([np.cos(angle / 2), 0, 0, np.sin(angle / 2)]), rate * down)

    still = [turned(EULER, t, 0.0, 0.0) for t in range(0, 2001, 100)]
    slower = [turned(QUATERNION, t, 0.0, 0.0) for t in range(50, 1900, 200)]
    last = [turned(EULER, 2100, fast_rad, 1.0), turned(QUATERNION, 2050, slow_rad, 0.3)]
    pairs = paired(in_time(still, slower, last))
    assert pairs.t_boot_us[-1] == 2_050_000
    deg = np.degrees
    rate, change, h = deg(1.0), deg(1.0), 0.1
    limits = {
        "kin": abs(deg(fast_rad) - h * (0 + rate) / 2),
        "slower": abs(deg(slow_rad) - 0.2 * deg(0.3) / 2) + 0.1,  # its own last step: 1850 → 2050 ms
        "ceiling": 0.2 + 0.002 * rate + h * (0.5 * change + 0.1 * rate),
    }
    assert min(limits, key=limits.__getitem__) == smallest
    hermite_rate = 1.5 * deg(fast_rad) / h - 0.25 * rate  # its slope in the middle, by hand
    bound = 0.02 + 0.001 * rate + 0.5 * 1.0 * (limits[smallest] + h * abs(hermite_rate - deg(0.3)))
    assert deg(pairs.bound_rad[-1]) == pytest.approx(bound, rel=1e-9)


def test_samples_of_one_instant_are_compared_as_they_are() -> None:
    """Same stamps: every sample finds its partner, nothing is interpolated, the bound is that of rounding."""
    motion = wire.Motion(20, seed=1, speed_rad_s=7.0)
    pairs = paired(in_time(samples(motion, EULER, every(40, 20)), samples(motion, QUATERNION, every(40, 20))))
    assert len(pairs) == 500
    assert pairs.same_instant.all()
    assert (pairs.interval_id == -1).all()
    assert degrees_between(pairs.q_euler, pairs.q_quaternion).max() < 1e-6
    assert np.degrees(pairs.bound_rad) == pytest.approx(0.02)
    assert pairs.t_boot_us.tolist() == (1000 * every(40, 20)).tolist()


@pytest.mark.parametrize("first", [EULER, QUATERNION])
def test_which_message_is_sent_first_does_not_matter(first: int) -> None:
    """ArduPilot sends ATTITUDE first, others the quaternion: the same pairs."""
    motion = wire.Motion(20, seed=1)
    arrived = sorted(
        samples(motion, EULER, every(40, 20)) + samples(motion, QUATERNION, every(40, 20)),
        key=lambda s: (s.t_us, s.stream != first),
    )
    pairs = paired(arrived)
    assert (len(pairs), bool(pairs.same_instant.all())) == (500, True)


def test_some_instants_in_common_are_used_as_such() -> None:
    """25 Hz against 5 Hz on one grid: all pairs of one instant, the other 25 Hz samples interpolate nothing."""
    motion = wire.Motion(20, seed=2)
    pairs = paired(in_time(samples(motion, EULER, every(40, 20)), samples(motion, QUATERNION, every(200, 20))))
    assert (len(pairs), bool(pairs.same_instant.all())) == (100, True)


@pytest.mark.parametrize("faster", [EULER, QUATERNION])
def test_the_slower_streams_samples_are_never_touched(faster: int) -> None:
    """Pairs stand at the slower stream's times, with its attitude as it was sent."""
    motion = wire.Motion(30, seed=3)
    slow = samples(motion, 1 - faster, every(250, 29, 11))
    pairs = paired(in_time(samples(motion, faster, every(40, 30)), slow))
    sent = {s.t_us: s.q for s in slow}
    settled = pairs.t_boot_us > 3_000_000  # which one is slower is known after eight intervals
    assert settled.sum() >= 100
    for t_us, q in zip(pairs.t_boot_us.tolist(), (pairs.q_euler, pairs.q_quaternion)[1 - faster], strict=True):
        assert q == pytest.approx(sent[t_us], abs=1e-15)


def test_a_stream_that_becomes_the_slower_one_is_no_longer_interpolated() -> None:
    """A ground station asks for other rates in flight: the pairs follow."""
    motion = wire.Motion(60, seed=5)
    euler = np.concatenate([every(40, 30), every(250, 59, 30_003)])
    quaternion = np.concatenate([every(250, 30, 7), every(40, 60, 30_010)])
    pairs = paired(in_time(samples(motion, EULER, euler), samples(motion, QUATERNION, quaternion)))
    early = pairs.t_boot_us < 29_000_000
    late = pairs.t_boot_us > 50_000_000
    assert set((pairs.t_boot_us[early] // 1000).tolist()) <= set(quaternion.tolist())
    assert set((pairs.t_boot_us[late] // 1000).tolist()) <= set(euler.tolist())
    assert early.sum() > 100
    assert late.sum() > 30


# --- gaps, resets, missing rates -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("gap_ms", "bridged"), [(960, True), (1000, True), (1040, False), (5000, False)])
def test_nothing_is_interpolated_across_more_than_a_second(gap_ms: int, bridged: bool) -> None:
    """The faster stream is silent for a while: what happened then is unknown."""
    motion = wire.Motion(40, seed=6)
    fast = np.concatenate([every(40, 20.001), np.arange(20_000 + gap_ms, 40_000, 40)])
    pairs = paired(in_time(samples(motion, EULER, fast), samples(motion, QUATERNION, every(100, 39, 7))))
    inside = (pairs.t_boot_us > 20_000_000) & (pairs.t_boot_us < 1000 * (20_000 + gap_ms))
    assert inside.any() == bridged
    assert (pairs.t_boot_us > 1000 * (20_000 + gap_ms)).sum() > 100


def stepped(stream: list[Sample], at_ms: Sequence[int], yaw_deg: float = 30.0) -> list[Sample]:
    """The same with the heading turned by `yaw_deg` from each of these times on; the rates know nothing of it."""
    out = []
    for s in stream:
        turns = sum(s.t_us >= 1000 * t for t in at_ms)
        half = np.radians(yaw_deg * turns / 2)
        w, x, y, z = s.q
        c, d = np.cos(half), np.sin(half)
        out.append(s._replace(q=np.array([c * w - d * z, c * x - d * y, c * y + d * x, c * z + d * w])))
    return out


@pytest.mark.parametrize("faster", [EULER, QUATERNION])
def test_a_lone_step_against_the_rates_is_a_reset_and_its_pairs_are_marked(faster: int) -> None:
    """The estimator's yaw reset moves both streams: only what is interpolated across it is marked."""
    motion = wire.Motion(30, seed=7, speed_rad_s=0.3)
    fast = stepped(samples(motion, faster, every(100, 30)), [15_150])
    slow = stepped(samples(motion, 1 - faster, every(130, 29, 30)), [15_150])
    pairs = paired(in_time(fast, slow))
    across = (pairs.t_boot_us > 15_100_000) & (pairs.t_boot_us < 15_200_000) & ~pairs.same_instant
    assert across.sum() >= 1
    assert (pairs.after_reset == across).all()


def test_two_steps_in_a_row_are_no_reset() -> None:
    """A stream that steps twice is faulty: the pairs behind the second step are judged."""
    motion = wire.Motion(30, seed=7, speed_rad_s=0.3)
    fast = stepped(samples(motion, EULER, every(100, 30)), [15_100, 15_200, 15_300])
    pairs = paired(in_time(fast, samples(motion, QUATERNION, every(130, 29, 7))))
    marked = pairs.t_boot_us[pairs.after_reset]
    assert ((marked > 15_000_000) & (marked < 15_100_000)).all()
    behind = (pairs.t_boot_us > 15_100_000) & (pairs.t_boot_us < 15_300_000)
    assert behind.any()
    assert not pairs.after_reset[behind].any()


def test_ordinary_acro_is_no_reset() -> None:
    """400 degrees a second at 10 Hz: rates explain it, nothing is marked."""
    motion = wire.Motion(30, seed=8, speed_rad_s=7.0)
    fast, slow = samples(motion, EULER, every(40, 30)), samples(motion, QUATERNION, every(100, 29, 7))
    assert not paired(in_time(fast, slow)).after_reset.any()


def without_rates(stream: list[Sample]) -> list[Sample]:
    return [s._replace(w=np.zeros(3)) for s in stream]


def test_a_faster_stream_that_reports_no_rates_bounds_nothing() -> None:
    """Rates of exactly zero on a turning vehicle are not reported ones: a pair between stamps can't be judged."""
    motion = wire.Motion(30, seed=9, speed_rad_s=1.0)
    fast, slow = samples(motion, EULER, every(40, 30)), samples(motion, QUATERNION, every(100, 29, 7))
    pairs = paired(in_time(without_rates(fast), slow))
    turned = degrees_between(motion.wxyz(pairs.t_boot_us * 1e-6 - 0.02), motion.wxyz(pairs.t_boot_us * 1e-6 + 0.02))
    fast_enough = (turned > 1.0) & ~pairs.same_instant
    assert fast_enough.sum() > 100
    assert np.isnan(pairs.bound_rad[fast_enough]).all()
    assert not pairs.after_reset.any()


def test_one_instant_needs_no_rates() -> None:
    """Same stamps are compared whatever the rates: zero, NaN or infinite."""
    motion = wire.Motion(10, seed=9, speed_rad_s=1.0)
    for rate in (0.0, np.nan, np.inf, 1e38):
        arrived = [
            s._replace(w=np.full(3, rate))
            for s in in_time(samples(motion, EULER, every(40, 10)), samples(motion, QUATERNION, every(40, 10)))
        ]
        pairs = paired(arrived)
        assert (len(pairs), bool(pairs.same_instant.all())) == (250, True)
        assert np.degrees(pairs.bound_rad) == pytest.approx(0.02)


@pytest.mark.parametrize("rate", [np.nan, np.inf, -np.inf])
def test_rates_that_are_no_numbers_bound_nothing(rate: float) -> None:
    """An interpolated pair with such a rate is unknown, without a warning, and its neighbours are none the worse."""
    motion = wire.Motion(30, seed=9)
    fast, slow = samples(motion, EULER, every(40, 30)), samples(motion, QUATERNION, every(100, 29, 7))
    fast[300] = fast[300]._replace(w=np.array([0.1, rate, 0.1]))
    pairs = paired(in_time(fast, slow))
    t = fast[300].t_us
    touched = (np.abs(pairs.t_boot_us - t) < 40_000) & ~pairs.same_instant
    assert touched.any()
    assert not (pairs.bound_rad[touched] < np.inf).any()
    assert np.isfinite(pairs.bound_rad[np.abs(pairs.t_boot_us - t) > 200_000]).all()


def test_a_vehicle_at_rest_is_judged() -> None:
    """Level on the ground, rates exactly zero, which is the truth: bounds stay near that of rounding."""
    level, still = np.array([1.0, 0, 0, 0]), np.zeros(3)
    arrived = in_time(
        [Sample(EULER, 1000 * int(t), level, still) for t in every(40, 20)],
        [Sample(QUATERNION, 1000 * int(t), level, still) for t in every(100, 20, 7)],
    )
    pairs = paired(arrived)
    assert len(pairs) > 180
    assert np.degrees(pairs.bound_rad).max() < 0.13


# --- order, once each, the time judged -------------------------------------------------------------------------------


def late(arrived: list[Sample], by: Sequence[int]) -> list[Sample]:
    """The same, some of them so many places later."""
    keys = [i + by[i % len(by)] + 0.5 * (by[i % len(by)] > 0) for i in range(len(arrived))]
    return [arrived[i] for i in sorted(range(len(arrived)), key=keys.__getitem__)]


def test_samples_that_come_late_find_their_partner_all_the_same() -> None:
    """The slower stream's samples reordered by up to half a second: every one has its pair of one instant."""
    motion = wire.Motion(20, seed=10)
    fast, slow = samples(motion, EULER, every(40, 20)), samples(motion, QUATERNION, every(40, 20))
    shift = [0, 0, 0.3, 0, 0.5, 0, 0.04]
    delay = {(QUATERNION, s.t_us): int(1e6 * shift[i % 7]) for i, s in enumerate(slow)}
    pairs = paired(sorted(fast + slow, key=lambda s: (s.t_us + delay.get((s.stream, s.t_us), 0), s.stream)))
    assert (len(pairs), bool(pairs.same_instant.all())) == (500, True)
    assert degrees_between(pairs.q_euler, pairs.q_quaternion).max() < 1e-6


def test_no_sample_goes_unjudged_because_others_came_late() -> None:
    """Both streams reordered: where the partner is not there yet, its neighbours are, and still the bound holds."""
    motion = wire.Motion(20, seed=10)
    arrived = in_time(samples(motion, EULER, every(40, 20)), samples(motion, QUATERNION, every(40, 20)))
    pairs = paired(late(arrived, [0, 0, 7, 0, 0, 23, 0, 1, 0, 0, 0]))
    assert len(pairs) >= 0.98 * 500
    error = degrees_between(pairs.q_euler, pairs.q_quaternion)
    assert error[pairs.same_instant].max() < 1e-6
    assert (error <= np.degrees(pairs.bound_rad) + 0.5).all()


def test_a_sample_whose_partner_was_overtaken_meets_it_after_all() -> None:
    """It was compared with its neighbours by then: each instant has its pair all the same, and its time counts once."""
    motion = wire.Motion(20, seed=10)
    arrived = in_time(samples(motion, EULER, every(40, 20)), samples(motion, QUATERNION, every(40, 20)))
    pairs = paired(late(arrived, [0, 0, 7, 0, 0, 23, 0, 1, 0, 0, 0]))
    same_us = pairs.t_boot_us[pairs.same_instant]
    assert len(same_us) == len(np.unique(same_us)) == 500 < len(pairs)
    assert pairs.duration_us.sum() <= 20e6


@pytest.mark.parametrize("shift", [[0], [0, 0, 3, 0, 11, 0, 0, 0, 30]])
@pytest.mark.parametrize(("euler_ms", "quaternion_ms"), one_in(3, [(40, 40), (40, 100), (250, 40), (100, 130)]))
def test_each_sample_of_the_slower_stream_is_judged_once(euler_ms: int, quaternion_ms: int, shift: list[int]) -> None:
    """However late some come, where no instant is shared: none twice, and in the order in which they were completed."""
    motion = wire.Motion(30, seed=11)
    arrived = in_time(
        samples(motion, EULER, every(euler_ms, 30)), samples(motion, QUATERNION, every(quaternion_ms, 29, 7))
    )
    pairs = paired(late(arrived, shift))
    assert len(np.unique(pairs.t_boot_us)) == len(pairs)
    assert (np.diff(pairs.frame_index) >= 0).all()
    for trigger, t_us in zip(pairs.frame_index.tolist(), pairs.t_boot_us.tolist(), strict=True):
        come = late(arrived, shift)[: trigger + 1] if trigger < 60 else None  # no pair before both of its sides
        assert come is None or t_us in {s.t_us for s in come}


@pytest.mark.parametrize(("euler_ms", "quaternion_ms"), [(40, 40), (40, 100), (250, 40)])
def test_the_time_judged_adds_up_to_the_time_covered(euler_ms: int, quaternion_ms: int) -> None:
    """Steady streams: from the slower one's first paired sample to its last, once."""
    motion = wire.Motion(30, seed=12)
    arrived = in_time(
        samples(motion, EULER, every(euler_ms, 30)), samples(motion, QUATERNION, every(quaternion_ms, 30))
    )
    pairs = paired(arrived)
    slow_ms = max(euler_ms, quaternion_ms)
    covered = pairs.t_boot_us.max() - pairs.t_boot_us.min()
    assert pairs.duration_us.sum() == pytest.approx(covered, abs=1000 * 3 * slow_ms)


def test_a_sample_judges_three_periods_at_the_most() -> None:
    """Ten seconds without the slower stream: the next sample stands for three of its periods, not for ten seconds."""
    motion = wire.Motion(40, seed=13)
    slow = np.concatenate([every(100, 20), every(100, 40, 30_000)])
    pairs = paired(in_time(samples(motion, EULER, every(40, 40)), samples(motion, QUATERNION, slow)))
    assert pairs.duration_us[pairs.t_boot_us == 30_000_000].tolist() == [300_000]
    assert pairs.duration_us.sum() == pytest.approx(30_000_000, abs=500_000)


def test_late_samples_do_not_count_time_twice() -> None:
    """A tenth of the slower stream comes late: what is judged never exceeds the time that there was."""
    motion = wire.Motion(60, seed=14)
    arrived = in_time(samples(motion, EULER, every(40, 60)), samples(motion, QUATERNION, every(40, 60)))
    pairs = paired(late(arrived, [0, 0, 0, 9, 0, 0, 0, 0, 0, 0, 15]))
    assert pairs.duration_us.sum() <= 60_000_000


# --- batches ---------------------------------------------------------------------------------------------------------

_moves = st.lists(
    st.tuples(
        st.sampled_from([EULER, QUATERNION]),
        st.sampled_from([0, 20, 40, 40, 100, 250, 1200]),  # time goes on by this
        st.sampled_from([0, 0, 0, 0, 40, 500, 4700]),  # and this one came so much too late
        st.sampled_from([0.0, 0.0, 0.0, 0.4]),  # and is off by this angle
        st.integers(1, 14),
    ),
    max_size=60,
)
_motion = wire.Motion(200, seed=15, speed_rad_s=2.0)


@pytest.mark.slow
@searched(60)
@given(_moves, st.lists(st.integers(0, 400), max_size=12))
def test_the_cut_into_batches_changes_no_bit(moves: list[tuple[int, int, int, float, int]], cuts: list[int]) -> None:
    """Whole, in pieces, or sample by sample: the same pairs, attitudes, bounds and times, bit for bit."""
    sent: list[tuple[int, int, float]] = []  # stream, boot time, ms, and how far it is off
    now = 5000
    for stream, step, delay, off, count in moves:
        for i in range(count):
            now += step
            sent.append((stream ^ (i % 2), now - delay, off))
    t_s = np.array([ms for _, ms, _ in sent]) / 1000.0 % 199
    off_by = Rotation.from_rotvec(np.array([[off, 0, 0] for *_, off in sent]).reshape(-1, 3))
    empty = np.empty((0, 4)), np.empty((0, 3))
    q, rates = (wire.wxyz(_motion.rotation(t_s) * off_by), _motion.rates(t_s)) if sent else empty
    arrived = [Sample(stream, 1000 * ms, q[i], rates[i]) for i, (stream, ms, _) in enumerate(sent)]
    whole = paired(arrived)
    for pieces in (sorted(min(c, len(arrived)) for c in cuts), list(range(1, len(arrived)))):
        in_pieces = paired(arrived, pieces)
        for field in fields(Pairs):
            assert getattr(in_pieces, field.name).tobytes() == getattr(whole, field.name).tobytes(), field.name


@pytest.mark.slow
def test_two_thousand_samples_in_odd_batches_are_the_same_to_the_bit() -> None:
    """Longer than what is remembered of each stream (1,024 samples), with late ones."""
    motion = wire.Motion(130, seed=16, speed_rad_s=2.0)
    arrived = late(
        in_time(samples(motion, EULER, every(40, 130)), samples(motion, QUATERNION, every(100, 129, 7))),
        [0, 0, 5, 0, 40],
    )
    whole = paired(arrived)
    for size in (1, 7, 1500):
        in_pieces = paired(arrived, list(range(size, len(arrived), size)))
        for field in fields(Pairs):
            assert getattr(in_pieces, field.name).tobytes() == getattr(whole, field.name).tobytes(), field.name
