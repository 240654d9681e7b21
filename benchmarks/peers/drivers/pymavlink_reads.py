"""pymavlink reads some messages of a recording, as its users do, and does nothing with them."""

import sys
from collections import Counter

from pymavlink import mavutil

path, *names = sys.argv[1:]
log = mavutil.mavlink_connection(path)
counts: Counter[str] = Counter()
while (message := log.recv_match(type=names)) is not None:
    counts[message.get_type()] += 1
print(*(f"{name}={counts[name]}" for name in names))
