"""The boot clock, told as stories: what the milliseconds do, and what time it then is; numbers worked by hand."""

import time
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_bridge.mavlink.dialect import load_dialect
from gcs_bridge.mavlink.scan import FRAME
from gcs_bridge.telemetry.clocks import BOOT, FRAME_INDEX, RECEIVED, T_BOOT_US, BootClock
from gcs_bridge.telemetry.sorting import FrameSorter
from tests.helpers.everyday import searched

START_US = 1_700_000_000_000_000
DAY_MS = 86_400_000
UNKNOWN = -1


class Statement:
    """What the clock says of a list of milliseconds, one message each, cut at `cuts`."""

    def __init__(self, ms: list[int], rx_us: list[int] | None = None, cuts: tuple[int, ...] = ()) -> None:
        sorter, clock = FrameSorter(load_dialect()), BootClock(load_dialect())
        rx = rx_us if rx_us is not None else [UNKNOWN] * len(ms)
        self.boot: list[int | None] = [None] * len(ms)  # None: the message is not believed
        self.t_us: list[int | None] = [None] * len(ms)
        self.late: list[int] = []  # messages that were doubted at first, and believed with the next one
        self.changes: list[tuple[int, int, str, int, int]] = []
        for lo, hi in pairwise([0, *cuts, len(ms)]):
            if lo == hi:
                continue
            frames = np.zeros(hi - lo, FRAME)
            frames["payload"], frames["length"] = 4 * np.arange(hi - lo), 4
            frames["msgid"], frames["t_rx_us"] = load_dialect()["ATTITUDE"].msgid, rx[lo:hi]
            batch = sorter.sort(np.array(ms[lo:hi], "<u4").view(np.uint8), frames)
            timed, changes = clock.read(batch, batch.shares[0], received=lo)
            for i in range(timed.columns.shape[1]):
                message, by = int(timed.columns[RECEIVED, i]), int(timed.columns[FRAME_INDEX, i])
                self.boot[message], self.t_us[message] = timed.columns[[BOOT, T_BOOT_US], i].tolist()
                assert by in (message, message + 1)
                if message != by:
                    self.late.append(message)
            self.changes += [(c.frame_index, c.boot, c.kind, c.t_boot_us, c.step_us) for c in changes]

    @property
    def believed(self) -> list[bool]:
        return [t_us is not None for t_us in self.t_us]

    @property
    def kinds(self) -> list[str]:
        return [kind for _, _, kind, _, _ in self.changes]


def live(ms: list[int]) -> list[int]:
    """Receive times of messages that each came at once."""
    return [START_US + 1000 * (t - ms[0]) for t in ms]


def steps(t_us: list[int | None]) -> list[int]:
    """From each time to the next; all of them are known."""
    return [after - before for before, after in pairwise(t for t in t_us if t is not None)]


def test_milliseconds_become_microseconds_since_boot() -> None:
    """An ordinary stretch of flight: every time is believed, in one boot."""
    told = Statement([1000, 1040, 1080])
    assert (told.t_us, told.boot, told.believed) == ([1_000_000, 1_040_000, 1_080_000], [0, 0, 0], [True] * 3)
    assert told.changes == []


def test_the_wrap_after_49_days_is_a_step_of_eleven_milliseconds() -> None:
    """4294967290 to 5: the counter has 32 bits, the vehicle flew on."""
    told = Statement([4_294_967_290, 5, 45])
    assert steps(told.t_us) == [11_000, 40_000]
    assert (told.boot, told.believed, told.changes) == ([0, 0, 0], [True] * 3, [])


def test_a_frame_from_before_the_wrap_may_come_late() -> None:
    """Reordered across the wrap: it belongs before, and those behind it go on."""
    told = Statement([4_294_967_200, 4_294_967_250, 10, 4_294_967_290, 50, 90])
    assert steps(told.t_us) == [50_000, 56_000, -16_000, 56_000, 40_000]
    assert (set(told.boot), all(told.believed), told.changes) == ({0}, True, [])


def test_a_frame_may_come_late_right_before_the_wrap_and_the_first_behind_it_alone() -> None:
    """10 ms past the wrap, back to before it, and on: no message is doubted, none is off by 49 days."""
    told = Statement([4_294_967_290, 10, 4_294_967_292, 4_294_967_294, 12])
    assert steps(told.t_us) == [16_000, -14_000, 2_000, 14_000]
    assert told.believed == [True] * 5


def test_two_wraps_are_99_days() -> None:
    """Aircraft on a mast have been up that long; the link was looked at every ten days."""
    true_ms = [k * 10 * DAY_MS for k in range(11)]
    told = Statement([t % 2**32 for t in true_ms], live(true_ms))
    assert told.t_us == [1000 * t for t in true_ms]
    assert (set(told.boot), told.changes) == ({0}, [])


@pytest.mark.parametrize("uptime_ms", [20_000, 3_600_000, 24 * DAY_MS, 26 * DAY_MS, 49 * DAY_MS])
@pytest.mark.parametrize("start_ms", [0, 900, 5000])
def test_a_reboot_starts_a_new_boot_near_zero(uptime_ms: int, start_ms: int) -> None:
    """After seconds or weeks of uptime: two messages from near zero, and the clock counts from there."""
    ms = [uptime_ms, uptime_ms + 40, start_ms, start_ms + 40, start_ms + 80]
    told = Statement(ms, live([0, 40, 3000, 3040, 3080]))
    assert told.boot == [0, 0, 1, 1, 1]
    assert told.t_us[2:] == [1000 * start_ms, 1000 * (start_ms + 40), 1000 * (start_ms + 80)]
    assert told.late == [2]  # a lone message may be a false frame
    assert Statement(ms[:3], live([0, 40, 3000])).believed == [True, True, False]
    assert told.changes == [(3, 1, "reboot", 1000 * start_ms, 1000 * (start_ms - uptime_ms))]


def test_a_reboot_after_a_wrap_starts_at_zero_too() -> None:
    """The wrap's 49 days are no part of the new boot."""
    told = Statement(
        [4_294_967_290, 10, 100_000, 2_000, 2_040, 2_080], live([0, 16, 100_006, 103_000, 103_040, 103_080])
    )
    assert told.kinds == ["reboot"]
    assert (told.boot[-1], told.t_us[-1]) == (1, 2_080_000)


def test_three_reboots_are_three() -> None:
    """A bad power lead: each boot has its number."""
    told = Statement([t for _ in range(4) for t in range(1000, 20_000, 500)])
    assert told.kinds == ["reboot"] * 3
    assert told.boot[-1] == 3


def test_what_comes_of_the_boot_before_is_no_boot() -> None:
    """Between the messages of the new one, going on where the old one had come to: not used, and nothing restarts."""
    old, new = list(range(600_000, 604_000, 100)), list(range(2000, 6000, 100))
    mixed = [*old[:10], *(t for pair in zip(old[10:], new[:30], strict=True) for t in (pair[1], pair[1] + 50, pair[0]))]
    told = Statement([*mixed, *new[30:]])
    assert told.kinds == ["reboot"]
    assert [ms for ms, boot in zip([*mixed, *new[30:]], told.boot, strict=True) if boot is None] == old[10:]
    assert {boot for ms, boot in zip([*mixed, *new[30:]], told.boot, strict=True) if ms < 100_000} == {1}


def test_a_clock_that_only_ever_comes_between_another_ones_messages() -> None:
    """Strictly in turn no two of it confirm each other: with the fifth it is believed, and the old one is late."""
    old, new = range(600_000, 603_000, 100), range(2000, 5000, 100)
    told = Statement([t for pair in zip(old, new, strict=True) for t in pair])
    assert told.kinds == ["reboot"]
    assert told.boot[:9] == [0, None] * 4 + [0]
    assert told.boot[9:] == [1, None] * 25 + [1]


def test_one_and_the_same_wrong_time_is_no_clock() -> None:
    """A sender that leaves the time at 0, beside messages that go on: not believed, however often it comes."""
    told = Statement([t for ms in range(500_000, 520_000, 100) for t in (ms, 0, 0)])
    assert (told.kinds, {boot for boot in told.boot if boot is not None}) == ([], {0})
    assert told.believed == [True, False, False] * 200


@pytest.mark.parametrize("lasted_ms", [7500, 9000, 30_000])
def test_the_third_boot_is_not_taken_for_the_first(lasted_ms: int) -> None:
    """A vehicle that restarts again and again, each time near zero."""
    told = Statement([t for last in (lasted_ms, 12_000, 20_000) for t in range(1000, last, 100)])
    assert told.kinds == ["reboot"] * 2
    assert all(told.believed)


@pytest.mark.parametrize("late_ms", [1, 40, 1000, 4700])
def test_what_comes_late_stays_in_its_boot(late_ms: int) -> None:
    """Frames reordered by up to 4.7 s were seen: they have their own time, and nothing has rebooted."""
    told = Statement([50_000, 50_040, 50_040 - late_ms, 50_041 - late_ms, 50_080])
    assert told.t_us == [50_000_000, 50_040_000, 50_040_000 - 1000 * late_ms, 50_041_000 - 1000 * late_ms, 50_080_000]
    assert (set(told.boot), all(told.believed), told.changes) == ({0}, True, [])


@pytest.mark.parametrize("wrong_ms", [0, 3, 2**31, 2**32 - 1, 20_000_000])
def test_a_time_that_stands_alone_is_not_believed(wrong_ms: int) -> None:
    """One false frame in noise: not believed, no reboot, and the messages around it are untouched."""
    told = Statement([10_000_000, 10_000_040, wrong_ms, 10_000_080, 10_000_120])
    assert told.believed == [True, True, False, True, True]
    assert [told.t_us[i] for i in (0, 1, 3, 4)] == [10_000_000_000, 10_000_040_000, 10_000_080_000, 10_000_120_000]
    assert (told.boot, told.late, told.changes) == ([0, 0, None, 0, 0], [], [])


def test_several_wrong_times_that_disagree_are_each_alone() -> None:
    """Wrong ones that do not confirm each other change nothing, even one behind the other."""
    told = Statement([10_000_000, 5, 10_000_040, 400_000, 90_000_000, 10_000_080, 7, 10_000_120])
    assert told.believed == [True, False, True, False, False, True, False, True]
    assert told.changes == []


def test_a_long_silence_that_the_receiver_saw_too_is_no_step() -> None:
    """Ten minutes out of range: boot time and receive time both went on."""
    ms = [1000, 1040, 601_040, 601_080]
    told = Statement(ms, live(ms))
    assert (told.believed, told.changes) == ([True] * 4, [])


def test_a_jump_that_the_receiver_did_not_see_needs_a_second_message() -> None:
    """Without a receive time, or against it, ten minutes at once are a step of the clock, once confirmed."""
    ms = [1000, 1040, 601_040, 601_080, 601_120]
    for rx in (None, [START_US + 40_000 * i for i in range(5)]):
        told = Statement(ms, rx)
        assert told.late == [2]
        assert told.kinds == ["clock_step"]
        assert told.boot == [0] * 5
        assert told.t_us[2:] == [601_040_000, 601_080_000, 601_120_000]


def test_the_receivers_clock_may_run_as_it_likes() -> None:
    """25 times too fast, backwards, or in bursts: a recording's boot times do not care."""
    ms = list(range(5000, 9000, 40))
    plain = Statement(ms).t_us
    for rx in (
        [START_US + 25 * 40_000 * i for i in range(len(ms))],
        [START_US - 40_000 * i for i in range(len(ms))],
        [START_US + 1_000_000 * (i // 25) for i in range(len(ms))],
    ):
        told = Statement(ms, rx)
        assert (told.t_us, all(told.believed), told.changes) == (plain, True, [])


def test_nothing_read_is_nothing_told() -> None:
    """An empty batch, first or later, changes nothing."""
    told = Statement([1000, 1040], cuts=(0, 0, 1, 1, 2))
    assert (told.t_us, told.changes) == ([1_000_000, 1_040_000], [])


@pytest.mark.slow
@pytest.mark.parametrize("jump_ms", [60_000, 20_000_000])
def test_two_clocks_under_one_id_do_not_take_for_ever(jump_ms: int) -> None:
    """Two autopilots with one id on merged links: every message is odd, and 40,000 are still read within seconds."""
    ms = [t + jump_ms * (i % 2) * 10 for i, t in enumerate(range(40_000))]
    started = time.process_time()
    Statement(ms)
    assert time.process_time() - started < 4


# Milliseconds as links bring them: going on, late, lone, rebooted, wrapped, silent.
_moves = st.lists(
    st.one_of(
        st.integers(0, 200),
        st.sampled_from([-40, -4700, -6001, 59_000, 61_000, -100_000, 700_000]),
        st.sampled_from([-(2**31), 2**31, 2**32 - 500, 500 - 2**32]),
    ),
    min_size=1,
    max_size=60,
)


@pytest.mark.slow
@searched(300)
@given(
    st.sampled_from([0, 5000, 2**31, 2**32 - 2000, 2**32 - 1]),
    _moves,
    st.lists(st.sampled_from([0, 40_000, -1_000_000, 700_000_000, 3 * 86_400_000_000]), max_size=60),
    st.lists(st.integers(0, 60), max_size=12),
)
def test_the_cut_into_batches_changes_nothing(
    first: int, moves: list[int], rx_steps: list[int], cuts: list[int]
) -> None:
    """Whole, in any pieces, or one by one: boots, times, beliefs and changes are the same."""
    ms = ((first + np.cumsum([0, *moves])) % 2**32).tolist()
    rx_steps = (rx_steps + [40_000] * len(ms))[: len(ms)]
    rx = (START_US + np.cumsum(rx_steps)).tolist()
    whole = vars(Statement(ms, rx))
    assert vars(Statement(ms, rx, tuple(sorted(min(c, len(ms)) for c in cuts)))) == whole
    assert vars(Statement(ms, rx, tuple(range(1, len(ms))))) == whole
    boots = [boot for boot in whole["boot"] if boot is not None]
    assert boots[0] == 0
    assert boots == sorted(boots)
