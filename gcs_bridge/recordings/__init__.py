"""Recordings: read as arrays, judged, falsified.

The only place that reads telemetry from files. How anything is judged is not known here.
"""
