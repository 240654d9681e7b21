"""When what was measured becomes an alarm, and what people are told of it.

Nothing is measured here: samples come rated, and what they are of is not known.
"""
