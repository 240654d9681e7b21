"""The peer: pymavlink's `recv_match` on a UDP port, each message decoded and nothing done with it.

A line of JSON each tenth of a second tells how many there were.
"""

import json
import sys
import time

from pymavlink import mavutil

link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{sys.argv[1]}", dialect="all")
count, told_s = 0, 0.0
while True:
    if link.recv_match(blocking=True, timeout=0.1) is not None:
        count += 1
    if (now_s := time.monotonic()) - told_s > 0.1:
        told_s = now_s
        sys.stdout.write(json.dumps({"count": count}) + "\n")
        sys.stdout.flush()
