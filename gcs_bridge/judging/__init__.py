"""Wires the stages: links, vehicles, boots; checks and alarms; what is kept for the doctor and as evidence."""
