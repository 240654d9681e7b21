"""What stands for one vehicle, beside its two attitudes: its airframe, second estimate, body rates, magnetic field.

Nothing is drawn of what is unknown: until its first sample, and where a number is none. How the input was cut does not
change what is drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from gcs_bridge import attitude
from gcs_bridge.columns import Floats
from gcs_bridge.judging.observation import Observation
from gcs_bridge.pairing.references import ImuWithAttitude
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.telemetry.samples import Ahrs2Samples, AttitudeSamples, finite
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

    def attitudes(self, source: Source, samples: AttitudeSamples) -> Iterator[New | Rows]:
        """What comes with attitudes of a source: the airframe from the first one on, rates, the turn for displays."""
        valid = samples.where(samples.valid)
        if len(valid) and source not in self._known:
            self._known.add(source)
            yield New([*source_parts(self._key, source), *self._look(source)], frozenset({source}))
        known = valid.where(finite(valid.w_nb_b_rad_s))
        if len(known):
            yield from self._named("rates", lambda: ())
            arrows = RATE_M_PER_RAD_S * known.w_nb_b_rad_s
            arrows *= MOST_RATE_M / np.maximum(np.linalg.norm(arrows, axis=1, keepdims=True), MOST_RATE_M)
            yield Rows(_times(known), arrows={path_of(self._key, "body", source, "rates"): arrows})
        yield from self._turn(samples)

    def others(self, observations: Sequence[Observation]) -> Iterator[New | Rows]:
        """The second estimate's attitudes, as sent; where the magnetic field points, by the attitude of its time."""
        secondary = [one.flight.secondary for one in observations if len(one.flight.secondary)]
        if secondary:
            samples = Ahrs2Samples.joined(secondary)
            samples = samples.where(samples.valid)
            if len(samples):
                yield from self._named("ahrs2", lambda: source_parts(self._key, "ahrs2"))
                attitudes = {path_of(self._key, "body", "ahrs2"): attitude.xyzw_from_wxyz(samples.q_nb)}
                yield Rows(_times(samples), attitudes=attitudes)
        inertial = [one.flight.imu_with_attitude for one in observations if len(one.flight.imu_with_attitude)]
        if inertial:
            yield from self._field(observations[0].segment.boot, ImuWithAttitude.joined(inertial))

    def _field(self, boot: int, seen: ImuWithAttitude) -> Iterator[New | Rows]:
        size = np.linalg.norm(seen.m_b_gauss, axis=1)
        measured = np.isfinite(size) & (size > 0)
        if not measured.any():
            return
        yield from self._named("field", lambda: field_parts(self._key))
        m_b = attitude.rotate(attitude.quaternion_from_rotvec(seen.trim_b_rad), seen.m_b_gauss)[measured]
        m_n = attitude.rotate(attitude.normalise(seen.q_nb[measured]), m_b) / size[measured, None]
        times = Times(boot=boot, t_boot_us=seen.t_boot_us[measured], t_rx_us=seen.t_rx_us[measured])
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
        xyzw = attitude.xyzw_from_wxyz(asked[changes])
        for source in ("euler", "quaternion"):
            yield Rows(_times(samples[changes]), {path_of(self._key, "body", source, "airframe"): xyzw})


def as_displayed(samples: AttitudeSamples) -> Floats:
    """Attitudes as displays are to show them: unit quaternions (n, 4), world from body, turned where that is asked."""
    q_nb = attitude.normalise(samples.q_nb)
    offsets = samples.repr_offset_q
    return q_nb if offsets is None or not offsets.any() else attitude.multiply(q_nb, _asked(offsets))


def _asked(offsets: Floats) -> Floats:
    """The turns (n, 4) that a vehicle asks displays to make: none, where it sends no quaternion."""
    size = np.linalg.norm(offsets, axis=1)
    return np.where((size >= _LEAST_OFFSET)[:, None], attitude.normalise(offsets), _AS_IT_IS)


def _times(samples: AttitudeSamples) -> Times:
    return Times(boot=int(samples.boot[0]), t_boot_us=samples.t_boot_us, t_rx_us=samples.t_rx_us)
