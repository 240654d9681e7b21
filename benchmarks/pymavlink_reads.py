"""The peer: pymavlink reads three messages of a recording, as its users do, and does nothing with them."""

import sys
from collections import Counter

from pymavlink import mavutil

log = mavutil.mavlink_connection(sys.argv[1])
counts: Counter[str] = Counter()
while (message := log.recv_match(type=["ATTITUDE", "ATTITUDE_QUATERNION", "RAW_IMU"])) is not None:
    counts[message.get_type()] += 1
print(*(f"{name}={count}" for name, count in sorted(counts.items())))
