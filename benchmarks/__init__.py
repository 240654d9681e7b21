"""Measurements beside other tools, and of what the bridge can be trusted with; run from the top of a checkout."""

COMPARED = ("ATTITUDE", "ATTITUDE_QUATERNION", "RAW_IMU")  # what every reader of a benchmark is asked for
