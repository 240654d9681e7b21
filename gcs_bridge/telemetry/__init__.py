"""From a link's frames to one vehicle's samples: clock, identity, statements.

Here the numbers of the wire acquire a frame and a unit. Nothing is judged here.
"""
