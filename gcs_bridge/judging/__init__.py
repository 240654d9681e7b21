"""Wires the stages: from bytes of links to judged vehicles, events and a report.

Links, vehicles and their boots; what is kept for the doctor and as evidence. The only place that knows all stages; it
must not know files, sockets or clocks: time is an argument.
"""
