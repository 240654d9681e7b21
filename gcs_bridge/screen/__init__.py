"""The view on a terminal: attitude, disagreement and alarms of every vehicle, drawn in place and steered by keys.

What is drawn is made by pure functions from a snapshot and a size; `terminal` alone touches the terminal.
It shows what was judged, and must not judge: limits come with what they were applied to.
"""
