"""A vehicle that has restarted and sends no attitude yet: known by what else it sends.

By times of other messages that went with its clock before, by a sequence that begins anew behind a silence, or by a
heartbeat that says that it boots.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from gcs_bridge.columns import Int64s
from gcs_bridge.jit import helper
from gcs_bridge.mavlink.decode import place_of
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.telemetry.boot_time import GOES_ON, JUMP_US, REBOOT, REORDER_US, WRAP_US, start_boot
from gcs_bridge.telemetry.link_clock import HEARD_US
from gcs_bridge.telemetry.messages import TIMED

# Behind a silence of its own, which is longer than from one heartbeat to the next, a sequence that begins anew; behind
# a longer one some of its first frames may be missing.
_RESTART_SILENCE_US, _RESTART_SEQ = 1_500_000, 5
_LONG_SILENCE_US, _EARLY_SEQ = 2_500_000, 31
_RESTARTED_US = 10_000_000  # and so long nothing that tells a time: it has restarted
_BOOT = 1  # MAV_STATE_BOOT; 0: not initialised
_SURE = 2**40  # frames: no loss says otherwise
# Messages with a time of their own that fell back to near zero, and for how long, before they are believed.
_WITNESSES, _WITNESSED_US = 3, 1_000_000
_WITNESS_SLACK_US = 10_000_000  # that a receiver's clock may be wrong by
WITNESS = np.dtype([("t_us", "i8"), ("same", "?")])  # of one message: whether its time went with the vehicle's clock


class OtherTimes(NamedTuple):
    """Where messages have a time that does not keep the clock: by message id (−1: nowhere) the row in the others.

    Per row where the time begins in the payload, how many bytes it has, and how many µs its unit has.
    """

    row_of_id: Int64s
    offset: Int64s
    size: Int64s
    scale: Int64s


@cache
def other_times(dialect: Dialect) -> OtherTimes:
    """Of all messages with `time_boot_ms` or `time_usec`, but those that keep the clock."""
    rows = [
        (dialect[name].msgid, *place_of(dialect[name], field), scale)
        for field, scale in (("time_boot_ms", 1000), ("time_usec", 1))
        for name in dialect.with_field(field)
        if name not in TIMED
    ]
    ids, *columns = np.array(rows, np.int64).reshape(-1, 4).T.copy()
    row_of_id = np.full(len(dialect.tables.row_of_id), -1, np.int64)
    row_of_id[ids] = np.arange(len(ids))
    return OtherTimes(row_of_id, *columns)


@helper
def suspect_restart(clock: Any, frame: Any, rx_us: Any) -> Any:
    """Whether the vehicle has restarted, as its frames alone show; whether it may have is kept."""
    seq, silent_us = np.int64(frame.seq), max(rx_us - clock.frame_rx_us, 0) if clock.frame_rx_us >= 0 else 0
    if clock.restarting:
        clock.restart_came += 1
        clock.restarting_us += min(silent_us, HEARD_US)
        if frame.lost - clock.restart_lost > clock.restart_came:  # no counter that began anew
            clock.restarting = False
    elif silent_us > _RESTART_SILENCE_US and seq != (clock.seq + 1) % 256:
        early = seq <= _EARLY_SEQ if silent_us > _LONG_SILENCE_US else seq <= _RESTART_SEQ
        if early:
            _begin_restart(clock, frame)
    clock.frame_rx_us, clock.seq = rx_us, seq
    return clock.restarting and clock.restarting_us >= _RESTARTED_US and clock.latest_us >= 0


@helper
def _begin_restart(clock: Any, frame: Any) -> Any:
    """From here on it may have restarted."""
    clock.restarting, clock.restarting_us = True, 0
    clock.restart_lost, clock.restart_came = frame.lost, 0


@helper
def hear_status(clock: Any, status: Any, frame: Any) -> Any:
    """Take the MAV_STATE of the next heartbeat: what did not boot before, and does now, has restarted."""
    if status <= _BOOT < clock.status:
        if not clock.restarting:
            _begin_restart(clock, frame)
        clock.restart_came = _SURE
    clock.status = status


@helper
def hear_witness(clock: Any, witness: Any, frame: Any, own_us: Any, rx_us: Any) -> Any:
    """What a message with another time than the clock's own says of it, as `read_time` does, −1: nothing."""
    witness.t_us = own_us
    if clock.latest_us < 0:
        if not (clock.by_witness and witness.same):
            return -1
        clock.latest_us, clock.rx_us, clock.restarting = own_us, rx_us, False
        return GOES_ON
    latest_us = clock.latest_us - clock.epoch_us
    ahead_us = own_us - latest_us
    if clock.by_witness and witness.same and -REORDER_US <= ahead_us <= JUMP_US:
        clock.latest_us, clock.rx_us = max(clock.latest_us, own_us + clock.epoch_us), rx_us
        return GOES_ON
    if abs(ahead_us) <= REORDER_US or abs(ahead_us + WRAP_US) <= REORDER_US:
        witness.same = True
        clock.witnesses, clock.restarting = 0, False  # the vehicle goes on
        return -1
    elapsed_us = rx_us - clock.rx_us if rx_us >= 0 and clock.rx_us >= 0 else JUMP_US
    if not witness.same or ahead_us > 0 or own_us > elapsed_us + _WITNESS_SLACK_US:
        return -1
    if not clock.witnesses or own_us < clock.witness_us:
        clock.witnesses, clock.witness_us = 0, own_us
        if not clock.restarting:
            _begin_restart(clock, frame)
    clock.witnesses += 1
    if clock.witnesses < _WITNESSES or own_us - clock.witness_us < _WITNESSED_US:
        return -1
    start_boot(clock, clock.latest_us)
    clock.latest_us, clock.epoch_us, clock.doubted_us, clock.rx_us = own_us, 0, -1, rx_us
    clock.by_witness, clock.restarting = True, False
    return REBOOT
