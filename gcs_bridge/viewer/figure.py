"""What stands for one vehicle, beside its two attitudes: its airframe, second estimate, body rates, magnetic field.

Nothing is drawn of what is unknown: until its first sample, and where a number is none. How the input was cut does not
change what is drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np

from gcs_bridge import attitude
from gcs_bridge.columns import Floats
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.telemetry.samples import AttitudeSamples, finite
from gcs_bridge.viewer.rows import Rows
from gcs_bridge.viewer.scene import (
    FIELD_M,
    MOST_RATE_M,
    RATE_M_PER_RAD_S,
    Legend,
    Part,
    Source,
    airframe_parts,
    field_parts,
    path_of,
    source_parts,
    unturned_parts,
)
from gcs_bridge.viewer.stretch import Stretch, times_of
from gcs_bridge.viewer.times import Times

__all__ = ["Figure", "New", "as_displayed"]

_LEAST_OFFSET = 0.5  # the norm from which a `repr_offset_q` is one
_AS_IT_IS = np.array([1.0, 0.0, 0.0, 0.0])


class New(NamedTuple):
    """Parts that never change are drawn from now on, and what the legend calls them."""

    parts: list[Part]
    names: frozenset[Legend] = frozenset()


class Figure:
    """Makes rows and parts of one vehicle."""

    def __init__(self, key: VehicleId, place: int) -> None:
        """Start with nothing drawn of the `place`-th vehicle, from 0."""
        self._key, self._place, self._type = key, place, "unknown"
        self._known: set[Legend] = set()
        self._turned = _AS_IT_IS  # the airframes, as they are drawn
        self._ever_turned = False

    def becomes(self, vehicle_type: str) -> Iterator[New]:
        """Of which type the vehicle is, by now."""
        if vehicle_type != self._type:
            self._type = vehicle_type
            yield New(
                [part for source in ("quaternion", "euler") if source in self._known for part in self._look(source)]
            )
            if self._ever_turned:
                yield New(list(unturned_parts(self._key, self._place, self._type)))

    def appears(self, stretch: Stretch) -> Iterator[New | Rows]:
        """What comes with attitudes: the airframe from a source's first one on, and the turn for displays."""
        for angles in stretch.angles:
            if angles.source not in self._known:
                self._known.add(angles.source)
                parts = [*source_parts(self._key, angles.source), *self._look(angles.source)]
                yield New(parts, frozenset({angles.source}))
        for samples in stretch.sent.values():
            yield from self._turn(samples)

    def second(self, stretch: Stretch) -> Iterator[New | Rows]:
        """The second estimate's attitudes, as sent."""
        samples = stretch.secondary
        if samples is not None and len(samples := samples.where(samples.valid)):
            yield from self._named("ahrs2", lambda: source_parts(self._key, "ahrs2"))
            yield Rows(times_of(samples), {path_of(self._key, "body", "ahrs2"): samples.q_nb})

    def arrows(self, stretch: Stretch) -> Iterator[New | Rows]:
        """Body rates; where the magnetic field points, by the attitude of its time."""
        for angles in stretch.angles:
            known = angles.samples.where(finite(angles.samples.w_nb_b_rad_s))
            if len(known):
                yield from self._named("rates", lambda: ())
                arrows = RATE_M_PER_RAD_S * known.w_nb_b_rad_s
                arrows *= MOST_RATE_M / np.maximum(np.linalg.norm(arrows, axis=1, keepdims=True), MOST_RATE_M)
                yield Rows(times_of(known), arrows={path_of(self._key, "body", angles.source, "rates"): arrows})
        yield from self._field(stretch)

    def _field(self, stretch: Stretch) -> Iterator[New | Rows]:
        seen = stretch.seen
        if seen is None:
            return
        size = np.linalg.norm(seen.m_b_gauss, axis=1)
        measured = np.isfinite(size) & (size > 0)
        if not measured.any():
            return
        yield from self._named("field", lambda: field_parts(self._key))
        m_b = attitude.rotate(attitude.quaternion_from_rotvec(seen.trim_b_rad), seen.m_b_gauss)[measured]
        m_n = attitude.rotate(attitude.normalise(seen.q_nb[measured]), m_b) / size[measured, None]
        times = Times(boot=stretch.boot, t_boot_us=seen.t_boot_us[measured], t_rx_us=seen.t_rx_us[measured])
        yield Rows(times, arrows={path_of(self._key, "body", "field"): FIELD_M * m_n})

    def _named(self, name: Legend, parts: Callable[[], Iterable[Part]]) -> Iterator[New]:
        """What is drawn for the first time, with what never changes of it."""
        if name not in self._known:
            self._known.add(name)
            yield New(list(parts()), frozenset({name}))

    def _look(self, source: Source) -> Iterator[Part]:
        return airframe_parts(self._key, self._place, self._type, source)

    def _turn(self, samples: AttitudeSamples) -> Iterator[New | Rows]:
        """Turn the drawn airframes, and nothing else, where the vehicle asks displays to: PX4's tailsitters do."""
        offsets = samples.repr_offset_q
        if offsets is None:  # angles bring none
            return
        if self._turned is _AS_IT_IS and not offsets.any():  # so with nearly all
            return
        asked = _asked(offsets)
        changes = np.flatnonzero((np.diff(asked, axis=0, prepend=self._turned[None]) != 0).any(axis=1))
        if not len(changes):
            return
        self._turned = asked[-1]
        if not self._ever_turned:
            self._ever_turned = True
            yield New(list(unturned_parts(self._key, self._place, self._type)))
        times, q = times_of(samples[changes]), asked[changes]
        yield Rows(times, {path_of(self._key, "body", source, "airframe"): q for source in ("euler", "quaternion")})


def as_displayed(samples: AttitudeSamples) -> Floats:
    """Attitudes as displays are to show them: unit quaternions (n, 4), world from body, turned where that is asked."""
    q_nb = attitude.normalise(samples.q_nb)
    offsets = samples.repr_offset_q
    return q_nb if offsets is None or not offsets.any() else attitude.multiply(q_nb, _asked(offsets))


def _asked(offsets: Floats) -> Floats:
    """The turns (n, 4) that a vehicle asks displays to make: none, where it sends no quaternion."""
    size = np.linalg.norm(offsets, axis=1)
    return np.where((size >= _LEAST_OFFSET)[:, None], attitude.normalise(offsets), _AS_IT_IS)
