"""From latitude, longitude and altitude to metres north, east and down of a place on the ellipsoid (WGS84)."""

from __future__ import annotations

import math
from typing import NamedTuple

__all__ = ["Geodetic", "Ned", "TangentPlane", "distance_m"]

Geodetic = tuple[float, float, float]  # latitude, longitude: degrees; altitude: m
Ned = tuple[float, float, float]  # m

_EQUATOR_M, _ECCENTRICITY2 = 6_378_137.0, 6.694379990e-3  # WGS84


class TangentPlane(NamedTuple):
    """The world about a place, whose ground is taken for flat."""

    origin: Geodetic

    def ned(self, place: Geodetic) -> Ned:
        """Metres north, east and down of the origin.

        >>> [round(metres) for metres in TangentPlane((0.0, 179.999, 10.0)).ned((0.001, -179.999, 30.0))]
        [111, 223, -20]
        """
        latitude, longitude, altitude_m = self.origin
        sine = math.sin(math.radians(latitude))
        bulge = 1.0 - _ECCENTRICITY2 * sine * sine
        across_m = _EQUATOR_M / math.sqrt(bulge)  # radii of curvature: of the prime vertical, and of the meridian
        along_m = across_m * (1.0 - _ECCENTRICITY2) / bulge
        north = math.radians(place[0] - latitude) * (along_m + altitude_m)
        east_deg = (place[1] - longitude + 180.0) % 360.0 - 180.0  # the short way, across the date line too
        east = math.radians(east_deg) * (across_m + altitude_m) * math.cos(math.radians(place[0]))
        return north, east, altitude_m - place[2]


def distance_m(place: Geodetic, other: Geodetic) -> float:
    """How far apart two places are, about."""
    return math.hypot(*TangentPlane(place).ned(other))
