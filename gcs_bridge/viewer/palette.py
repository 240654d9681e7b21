"""Colours that mean the same wherever they are drawn: told apart by people who see no red or no green, too."""

from __future__ import annotations

__all__ = ["ALARM", "EULER", "GREY", "LEVEL_AXES", "NOT_YET", "OK", "QUATERNION", "UNKNOWN", "WARNING", "Colour"]

Colour = tuple[int, int, int]

QUATERNION: Colour = (90, 200, 250)
EULER: Colour = (255, 175, 60)
GREY: Colour = (150, 150, 150)
LEVEL_AXES: tuple[Colour, Colour, Colour] = ((224, 64, 56), (90, 217, 99), (70, 130, 255))  # forward, right, down

OK: Colour = (67, 160, 71)
WARNING: Colour = (245, 124, 0)
ALARM: Colour = (225, 47, 38)
UNKNOWN: Colour = (255, 179, 0)
NOT_YET: Colour = (97, 97, 97)
