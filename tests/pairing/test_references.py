"""The attitude and the inertial sensor that others are compared with."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import pytest

from gcs_bridge import Monitor
from gcs_bridge.judging.dead_reckoning import MotionTracker
from gcs_bridge.judging.observation import Observation
from gcs_bridge.settings import AlignmentSettings, load_settings
from tests.helpers.craft import BOOT_S, Craft, ahrs2, check, highres_imu
from tests.helpers.wire import tlog

APART_S = 0.2  # from attitude to attitude


def recording(seconds: float) -> bytes:
    """Attitudes at 5 Hz, and right between them an inertial sample and an AHRS2."""
    craft = Craft(hz=1 / APART_S)
    between_s = np.arange(APART_S / 2, seconds - APART_S, APART_S).round(3).tolist()
    also: list[tuple[float, Any]] = []
    for t_s in between_s:
        state = craft.state(t_s)
        also += [(t_s, make(round(1000 * (BOOT_S + t_s)), state)) for make in (highres_imu, ahrs2)]
    return tlog(Craft(hz=1 / APART_S, also=also).records(seconds))


@pytest.mark.parametrize(("max_gap_s", "bridged"), [(1.0, True), (0.25, True), (0.15, False)])
def test_no_attitude_is_known_between_samples_further_apart_than_the_settings_allow(
    max_gap_s: float, bridged: bool
) -> None:
    """`alignment.max_gap_s` holds for inertial samples and the second estimate as it does for pairs."""
    moved: list[int] = []
    tracker = MotionTracker()
    settings = msgspec.structs.replace(load_settings(), alignment=AlignmentSettings(max_gap_s=max_gap_s))
    monitor = Monitor(
        settings=settings,
        observer=lambda seen: moved.append(
            len(motion) if (motion := tracker.feed(seen.flight.imu_with_attitude)) else 0
        ),
    )
    monitor.feed_recording(recording(50.0))
    (vehicle,) = monitor.close().to_dict()["files"][0]["vehicles"]
    for name in ("gravity", "gyro", "secondary_estimate"):
        assert (check(vehicle, name)["pairs"] > 50) == bridged, name
        assert bridged or check(vehicle, name)["pairs"] == 0
    assert (sum(moved) > 200) == bridged


@pytest.mark.parametrize(("max_gap_s", "known"), [(1.0, True), (0.3, False)])
def test_a_motion_is_not_known_across_a_longer_gap(max_gap_s: float, known: bool) -> None:
    """An inertial sensor that is silent for 0.5 s: what the vehicle did then nobody knows."""
    craft = Craft(imu=lambda t_s, state: None if 8.0 <= t_s < 8.5 else state, hz=20.0, force=lambda t_s, _: pushed(t_s))
    settings = msgspec.structs.replace(load_settings(), alignment=AlignmentSettings(max_gap_s=max_gap_s))
    tracker, velocity = MotionTracker(), [np.empty((0, 3))]

    def observe(observation: Observation) -> None:
        moved = tracker.feed(observation.flight.imu_with_attitude)
        velocity.append(velocity[0] if moved is None else moved.v_h_m_s)

    monitor = Monitor(settings=settings, observer=observe)
    monitor.feed_recording(tlog(craft.records(10.0)))
    last = np.concatenate(velocity)[-5:]
    assert np.isfinite(last).all() == known


def pushed(t_s: float) -> list[float]:
    """At rest for 7 s, then pushed on."""
    return [2.0 if t_s >= 7.0 else 0.0, 0.0, -9.80665]
