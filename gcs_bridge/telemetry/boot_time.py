"""What the next time of a vehicle does to its boot clock: it goes on, wraps, steps, starts anew, or is doubted.

Milliseconds since boot wrap after 49.7 days (a step of about −2³²), restart near zero with a reboot, and step back by a
few seconds where frames were reordered. What comes late of the boot before, as from a buffer that is sent beside what
is new, is no boot of its own, and is not used.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gcs_bridge.jit import helper

WRAP_US = 2**32 * 1000
REORDER_US = 6_000_000  # seen: 4.7 s in a recording that is otherwise good
YOUNG_US = 15_000_000  # a boot this young that falls silent and comes back earlier was a restart, not reordered frames
YOUNG_REORDER_US = 500_000
RESTART_SILENCE_US = 1_000_000
JUMP_US = 60_000_000  # a longer step forward needs the receive time, or a second message, to be believed

# A sample of the boot before may come so much earlier than its last one, and for so long nothing but such samples: a
# vehicle that restarts for the third time begins near zero, and goes on.
_EARLIER_US, _EARLIER_RUN_US = 1_000_000, 10_000_000
_RIVALS = 5  # messages of another clock, each later than the one before, that are believed beside one that goes on

GOES_ON, DOUBTED, REBOOT, STEP, LATE = range(5)  # what a message does to the clock
CLOCK = np.dtype(
    [
        ("boot", "i8"),
        ("latest_us", "i8"),  # latest believed time in this boot, −1: none
        ("epoch_us", "i8"),  # of the wraps so far
        ("rx_us", "i8"),
        ("doubted_us", "i8"),  # by its own milliseconds alone, −1: the last message was believed
        # Of the message that is doubted.
        ("message", "i8"),
        ("row", "i8"),  # in its batch, −1: that is over
        ("t_rx_us", "i8"),
        ("lost", "i8"),
        ("received", "i8"),
        ("in_window", "?"),
        ("unbelieved", "i8", (2,)),  # messages of the two streams so far whose time was not believed
        # The boot before, on its own milliseconds: the latest time, −1: none, and where a run of such messages began.
        ("earlier_us", "i8"),
        ("earlier_run_us", "i8"),
        # Messages of another clock, between those of this one.
        ("rival_us", "i8"),
        ("rivals", "i8"),
        # Whether it may have restarted: by all of its frames.
        ("frame_rx_us", "i8"),  # when the latest one came, −1: none yet
        ("seq", "i8"),
        ("restarting", "?"),
        ("restarting_us", "i8"),  # for how long it was heard since
        ("restart_lost", "i8"),  # frames that were missing then, and that came since
        ("restart_came", "i8"),
        ("status", "i8"),  # MAV_STATE as the latest heartbeat said
        # By messages with a time of their own.
        ("by_witness", "?"),  # no other time was told in this boot
        ("witnesses", "i8"),
        ("witness_us", "i8"),  # the first one's time
    ]
)


@helper
def _goes_on(clock: Any, step_us: Any, silence_us: Any) -> Any:
    """Whether a step of the time needs no closer look: the common case."""
    if clock.doubted_us >= 0 or not -REORDER_US <= step_us <= JUMP_US:
        return False
    return clock.latest_us >= YOUNG_US or silence_us < RESTART_SILENCE_US or step_us >= -YOUNG_REORDER_US


@helper
def _is_of_earlier(clock: Any, own_us: Any) -> Any:
    """Whether a message goes on where the boot before had come to; not where nothing else has come for some time."""
    if clock.earlier_us < 0 or not -_EARLIER_US <= own_us - clock.earlier_us <= JUMP_US:
        return False
    if clock.earlier_run_us < 0:
        clock.earlier_run_us = own_us
    if own_us - clock.earlier_run_us > _EARLIER_RUN_US:
        return False
    clock.earlier_us = max(clock.earlier_us, own_us)
    return True


@helper
def _follow_rival(clock: Any, own_us: Any) -> Any:
    """How many messages have told of another clock that goes on, whatever came between."""
    if clock.rivals and 0 <= own_us - clock.rival_us <= JUMP_US:
        clock.rivals += own_us > clock.rival_us
    else:
        clock.rivals = 1
    clock.rival_us = own_us
    return clock.rivals


@helper
def start_boot(clock: Any, latest_us: Any) -> Any:
    """The vehicle has started anew."""
    clock.boot += 1
    clock.earlier_us = latest_us % WRAP_US if latest_us >= 0 else -1
    clock.earlier_run_us = -1
    clock.rivals = clock.witnesses = 0


@helper
def read_time(clock: Any, message: Any, ms: Any, rx_us: Any) -> Any:
    """Take the next message: what it does to the clock, its time, how far that steps; the time of the one in doubt.

    The first message behind a reboot, or behind a jump, is not believed before a second one confirms it; −1 where that
    was not the message in doubt.
    """
    own_us = ms * 1000
    t_us = own_us + clock.epoch_us
    latest_us = clock.latest_us if clock.latest_us >= 0 else t_us
    if _goes_on(clock, t_us - latest_us, rx_us - clock.rx_us):
        clock.latest_us, clock.rx_us, clock.earlier_run_us = max(latest_us, t_us), rx_us, -1
        return GOES_ON, t_us, t_us - latest_us, 0
    elapsed_us = rx_us - clock.rx_us if rx_us >= 0 and clock.rx_us >= 0 else 0
    furthest_us = max(JUMP_US, 2 * elapsed_us)
    if -REORDER_US <= t_us + WRAP_US - latest_us <= furthest_us:
        t_us += WRAP_US  # past the wrap; the epoch follows once this is believed
    elif clock.epoch_us and -REORDER_US <= t_us - WRAP_US - latest_us <= furthest_us:
        t_us -= WRAP_US  # from before the wrap, late
    step_us, first_us = t_us - latest_us, latest_us
    young = latest_us < YOUNG_US and elapsed_us >= RESTART_SILENCE_US
    said = GOES_ON
    if not -(YOUNG_REORDER_US if young or clock.doubted_us >= 0 else REORDER_US) <= step_us <= furthest_us:
        if _is_of_earlier(clock, own_us):
            clock.doubted_us = -1
            return LATE, t_us, step_us, 0
        rivals = _follow_rival(clock, own_us)
        again = clock.doubted_us >= 0 and -REORDER_US <= own_us - clock.doubted_us <= JUMP_US
        if own_us == clock.doubted_us and message == clock.message:
            again = False  # it says what it said: no clock goes on there
        if not again and (rivals < _RIVALS or step_us >= 0):
            clock.doubted_us = own_us
            return DOUBTED, t_us, step_us, 0
        said, first_us = STEP, clock.doubted_us + t_us - own_us
        if step_us < 0:  # a second message from the past: the vehicle has started anew
            said, first_us, t_us = REBOOT, clock.doubted_us, own_us
            start_boot(clock, latest_us)
        first_us = first_us if again else -1
    clock.doubted_us, clock.rx_us, clock.earlier_run_us = -1, rx_us, -1
    clock.latest_us = max(first_us, t_us)
    clock.epoch_us = clock.latest_us // WRAP_US * WRAP_US
    return said, t_us, step_us, first_us
