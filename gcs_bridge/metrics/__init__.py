"""What Prometheus reads of a live run: one snapshot at a time, as text, at a port of this machine.

How anything was judged is not known here.
"""
