"""Times of a message's own clock, `time_usec`, on the boot clock."""

from __future__ import annotations

from typing import Any

import numpy as np

from gcs_bridge.jit import helper

OFFSET = np.dtype(
    [
        ("boot", "i8"),
        ("known", "?"),  # whether a message came within this boot
        ("same", "?"),  # whether it is the boot clock
        ("ahead_us", "i8"),  # of the boot clock, at most
    ]
)
SAME_CLOCK_US = 1_000_000


@helper
def on_boot_clock(offset: Any, boot: Any, t_us: Any, latest_us: Any) -> Any:
    """The boot time, µs, of a message at `t_us` on its own clock (`time_usec`), when the boot clock said `latest_us`.

    A clock that is near the boot clock at first is the boot clock: others count from 1970, or from a start seconds to
    hours away. Of these the smallest offset is the nearest to the true one, as no message is heard before its stamp.
    """
    ahead_us = latest_us - t_us
    if not offset.known or offset.boot != boot:
        offset.known, offset.boot = True, boot
        offset.same, offset.ahead_us = abs(ahead_us) < SAME_CLOCK_US, ahead_us
    offset.ahead_us = max(offset.ahead_us, ahead_us)
    return t_us if offset.same else t_us + offset.ahead_us
