"""Wrist of the samples while a program turns the tool."""

import math
from typing import Any, cast

from hil_bridge.control import Peaks
from hil_bridge.runs.sampling import Sampler
from hil_bridge.settings.configuration import read_config
from protocol.geometry import Quaternion, product, turn_about

APPROACH = (0.0, 0.0, -1.0)
DOWN = (0.0, 1.0, 0.0, 0.0)
SCALES = (0.01, 0.01, 0.01, 0.001, 0.001, 0.001)


class Sensor:
    """The part of a force sensor that the wrist of the samples needs."""

    class facts:
        scales = SCALES


def sampler_of(mass_kg: float) -> Sampler:
    parts = cast(Any, None)
    return Sampler(read_config({"tool": {"mass_kg": mass_kg}}), parts, parts, cast(Any, Sensor()), parts)


def turned(degrees: float) -> Quaternion:
    return product(turn_about((1.0, 0.0, 0.0), math.radians(degrees)), DOWN)


def test_wrist_is_kept_for_tiny_rotation() -> None:
    sampler = sampler_of(1.0)
    sampler.expect_turns()
    wrist = sampler.wrist_at(DOWN)
    assert sampler.wrist_at(turned(0.04)) is wrist
    assert sampler.wrist_at(turned(0.06)) is not wrist


def test_peaks_follow_rotated_tool() -> None:
    """The weight of the tool is subtracted in its current orientation."""
    sampler = sampler_of(1.0)
    sampler.expect_turns()
    sampler.peaks = Peaks(sampler.wrist_at(DOWN), SCALES)
    level = sampler.wrist_at(turned(90.0))
    weight = [-round(value / scale) for value, scale in zip(level.offset, SCALES, strict=True)]
    sampler.peaks.frame(weight)
    force, resultant, _, _ = sampler.peaks.take()
    assert abs(force) < 0.02
    assert resultant < 0.02
