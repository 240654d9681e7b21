"""What is on a link, and what is to be done about it: `gcs-bridge doctor`.

It measures nothing of its own: who sends what is counted in `telemetry.census`, what is wrong with it the monitor has
judged. Here both become an answer for people: what is missing, who is in the way, and the command to type.
"""
