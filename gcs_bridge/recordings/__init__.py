"""Recordings: read as arrays, judged, falsified."""
