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
USED = (*TIMED, *(name for name in IMU_MESSAGES if name not in TIMED), AHRS2, "LOCAL_POSITION_NED", *STATEMENTS)
KIND = {name: kind for kind, name in enumerate(USED)}
KINDS = len(USED) + 1
OTHER = len(USED)  # the kind of all other messages
UNTIMED = len(TIMED)  # from here on: kinds without a time_boot_ms that keeps the clock
IMU_KINDS = range(KIND["SCALED_IMU"], KIND["HIGHRES_IMU"] + 1)
STATEMENT_KINDS = range(KIND[STATEMENTS[0]], OTHER)


@cache
def kind_of_id(dialect: Dialect) -> npt.NDArray[np.int8]:
    """The kind of each message by its id, as far as the dialect has ids."""
    kinds = np.full(len(dialect.tables.row_of_id), OTHER, np.int8)
    for name, kind in KIND.items():
        if name in dialect:
            kinds[dialect[name].msgid] = kind
    return kinds
