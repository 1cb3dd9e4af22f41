"""Step that presses while it moves in a circle, in forty lines."""

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from hil_bridge.control.steps.led import Lead, LedStep, StepSample
from hil_bridge.control.steps.seam import NO_LIMITS, StepLimits, above_zero

MISTAKES = (
    "self",
    "place",
    "clock",
    "nan",
    "endless",
    "moment",
    "turns",
    "negative",
    "divides",
    "far",
    "words",
    "file",
)


@dataclass(frozen=True, slots=True)
class NaiveStep(LedStep):
    """Step that presses while it moves in a circle."""

    do: Literal["naive"] = "naive"
    radius_mm: float = 3.0
    speed_mm_s: float = 2.0
    for_s: float | None = 4.0
    mistake: str = ""
    limits: StepLimits = NO_LIMITS
    angles: ClassVar[list[float]] = []

    def __post_init__(self) -> None:
        above_zero(self, *(() if self.mistake == "nan" else ("radius_mm",)), "speed_mm_s", "for_s")
        if self.mistake == "file":  # in degrees each time that it is read
            object.__setattr__(self, "radius_mm", math.degrees(self.radius_mm))
        if self.mistake == "endless":
            object.__setattr__(self, "for_s", None)

    def begin(self) -> Any:
        return [0.0, 0.0]

    def steer(self, memory: Any, sample: StepSample) -> tuple[Any, Lead]:
        angle = memory[0] + sample.dt * self.speed_mm_s / self.radius_mm
        if self.mistake == "place":
            memory[0] = angle
        if self.mistake == "self":
            self.angles.append(angle)
            angle = 0.1 * len(self.angles)
        if self.mistake == "clock":
            angle = 1e3 * time.perf_counter()
        first, moment = memory[1], sample.moment[0]
        turned = first * moment < 0.0
        if self.mistake == "turns" and turned:
            raise ArithmeticError("the moment has turned")
        radius = self.radius_mm * 1e-3
        x, y = radius * math.cos(angle), radius * math.sin(angle)
        if self.mistake == "moment":
            x += 1e-3 * sample.moment[1]
        if self.mistake == "divides":
            y += 1e-3 / sample.force[0]
        force = 2.0 * sample.force[0] + 5.0 if self.mistake == "far" else None
        if self.mistake == "negative" and turned:
            force = -10.0
        if first == 0.0 and math.isfinite(moment):
            first = moment
        return memory if self.mistake == "place" else [angle, first], Lead((x, y), force)

    def describe(self, parameters: object) -> Iterator[str]:
        yield f"in a circle\nof {self.radius_mm:g} mm" if self.mistake == "words" else "in a circle"
