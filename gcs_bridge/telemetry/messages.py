"""Which messages are used, and the number of each: its kind. What is in them is not known here."""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt

from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.telemetry.samples import AHRS2, IMU_MESSAGES, STREAMS

# Messages whose time_boot_ms keeps the clock; the first two are the streams that are compared.
TIMED = (*STREAMS, "SYSTEM_TIME", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3")
STATEMENTS = (
    "HEARTBEAT",
    "PARAM_VALUE",
    "EXTENDED_SYS_STATE",
    "STATUSTEXT",
    "EKF_STATUS_REPORT",
    "ESTIMATOR_STATUS",
    "ODOMETRY",
    "SYS_STATUS",
)
# What a vehicle sends of a transfer; parameters, which are read too, have their own kind. Logs that are streamed all
# through a flight (LOGGING_DATA, REMOTE_LOG_DATA_BLOCK) are none: they would excuse every silence.
TRANSFERS = (
    "MISSION_COUNT",
    "MISSION_ITEM",
    "MISSION_ITEM_INT",
    "MISSION_REQUEST",
    "MISSION_REQUEST_INT",
    "MISSION_REQUEST_LIST",
    "MISSION_ACK",
    "FILE_TRANSFER_PROTOCOL",
    "LOG_ENTRY",
    "LOG_DATA",
    "PARAM_EXT_VALUE",
)
REQUESTS = ("REQUEST_DATA_STREAM", "COMMAND_LONG", "COMMAND_INT", "PARAM_SET")  # by which rates are asked for
RADIOS = ("RADIO_STATUS", "RADIO")  # by which autopilots slow their streams
POSITIONS = ("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED", "GPS_RAW_INT")  # the best one first
USED = (
    *TIMED,
    *(name for name in IMU_MESSAGES if name not in TIMED),
    AHRS2,
    *POSITIONS,
    *STATEMENTS,
    *REQUESTS,
    *RADIOS,
)
KIND = {name: kind for kind, name in enumerate(USED)}
TRANSFER = len(USED)  # the kind of all of TRANSFERS
OTHER = len(USED) + 1  # the kind of all other messages
KINDS = len(USED) + 2
UNTIMED = len(TIMED)  # from here on: kinds without a time_boot_ms that keeps the clock
IMU_KINDS = range(KIND["SCALED_IMU"], KIND["HIGHRES_IMU"] + 1)
STATEMENT_KINDS = range(KIND[STATEMENTS[0]], KIND[STATEMENTS[-1]] + 1)
OTHERS_KINDS = range(KIND[REQUESTS[0]], KIND[RADIOS[-1]] + 1)  # what others say that matters to a vehicle


@cache
def kind_of_id(dialect: Dialect) -> npt.NDArray[np.int8]:
    """The kind of each message by its id, as far as the dialect has ids."""
    kinds = np.full(len(dialect.tables.row_of_id), OTHER, np.int8)
    for name, kind in (*KIND.items(), *((name, TRANSFER) for name in TRANSFERS)):
        if name in dialect:
            kinds[dialect[name].msgid] = kind
    return kinds
