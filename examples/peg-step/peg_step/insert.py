"""Step `insert`: search for a hole on a spiral, and press the peg into it."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple

from hil_bridge.control.course.limits import Limits
from hil_bridge.control.steps.led import Lead, LedStep, StepSample
from hil_bridge.control.steps.seam import NO_LIMITS, Drawing, StepLimits, above_zero
from protocol.marks import SettingError

_DEAD_SHARE = 0.3
"""Chosen: share of the pressing force up to which a force along the plate counts as friction."""

_POINTS = 48
"""Chosen: points per turn of the spiral on the plan."""


class Memory(NamedTuple):
    """State of the step between samples; immutable."""

    way: float = 0.0
    """Distance along the spiral, m."""
    middle: tuple[float, float] = (0.0, 0.0)
    """Centre of the spiral, or position in the hole, from where the step began, m; it yields to forces along the plate.
    """
    inside: bool = False
    """Whether the peg has dropped into the hole."""


@dataclass(frozen=True, slots=True)
class Insert(LedStep[Memory]):
    """Press lightly, search for a hole on a spiral, and press down into it."""

    depth_mm: float
    """Depth at which the peg is inserted, from the start of the step."""
    do: Literal["insert"] = "insert"
    name: str = ""
    """Name under which the position of the hole is reported; empty for none."""
    radius_mm: float = 5.0
    """Radius at which the spiral ends, from the start of the step."""
    spacing_mm: float = 0.8
    """Distance between two turns of the spiral: at most twice the clearance of peg and hole."""
    fallen_mm: float = 1.5
    """Depth at which the peg has dropped into the hole, from the start of the step; more than the plate yields."""
    search_n: float = 4.0
    """Force of the search."""
    force_n: float | None = None
    """Force in the hole; if not set, the force of the task."""
    yield_mm_ns: float = 0.2
    """Speed at which the tool yields per newton along the plate. More than half of 1 / (stiffness in N/mm × time that
    the robot takes for an order in s) makes it oscillate.
    """
    speed_mm_s: float = 2.0
    """Speed along the spiral, and maximum speed at which the tool yields."""
    for_s: float = 90.0
    """Time after which the step has failed."""
    limits: StepLimits = NO_LIMITS

    def __post_init__(self) -> None:
        names = "depth_mm", "radius_mm", "spacing_mm", "fallen_mm", "search_n", "force_n", "yield_mm_ns"
        above_zero(self, *names, "speed_mm_s", "for_s")
        if self.fallen_mm >= self.depth_mm:
            problem = f"must be below depth_mm, {self.depth_mm:g}, got {self.fallen_mm:g}"
            raise SettingError("fallen_mm", problem)

    # --- before the run

    @property
    def sketch_mm(self) -> tuple[tuple[float, float], ...]:
        """Return the complete spiral."""
        turns = self.radius_mm / self.spacing_mm
        whole, points = math.pi * self.radius_mm * turns * 1e-3, math.ceil(turns * _POINTS)
        places = (self._on_spiral(whole * (k / points) ** 2)[0] for k in range(points + 1))
        return tuple((x * 1e3, y * 1e3) for x, y in places)

    def check(self, pressing: bool, limits: Limits) -> None:
        """Check the force of the search, which only this step has; `force_n` is checked for all steps."""
        LedStep.check(self, pressing, limits)
        if self.search_n >= limits.force_limit_n:
            raise ValueError(
                f"search_n of {self.search_n:g} N must be below its force limit of {limits.force_limit_n:g} N"
            )

    def parameters(self, task: object) -> dict[str, float | None]:
        """Return the parameters of the phase; contact lost in the hole is regained at its bottom or its wall."""
        return {"speed_mm_s": self.speed_mm_s, "search_depth_limit_mm": self.depth_mm + self.fallen_mm}

    # --- in the run

    def begin(self) -> Memory:
        return Memory()

    def steer(self, memory: Memory, sample: StepSample) -> tuple[Memory, Lead]:
        deep = sample.depth * 1e3
        if memory.inside and deep >= self.depth_mm:
            return memory, Lead(memory.middle, done=f"in the hole, {deep:.1f} mm deep", without_contact=True)
        if not memory.inside and deep >= self.fallen_mm:
            memory = Memory(memory.way, sample.place, True)
        memory = self._yielding(memory, sample)
        if memory.inside:
            late = f"only {deep:.1f} mm deep in the hole after {self.for_s:g} s" if sample.last else ""
            return memory, Lead(memory.middle, trouble=late, without_contact=True)
        if sample.in_contact:
            memory = memory._replace(way=memory.way + self.speed_mm_s * 1e-3 * sample.dt)
        (x, y), radius = self._on_spiral(memory.way)
        trouble = ""
        if radius > self.radius_mm * 1e-3:
            trouble = f"no hole within {self.radius_mm:g} mm"
        elif sample.last:
            trouble = f"no hole within {radius * 1e3:.1f} mm after {self.for_s:g} s"
        u, v = memory.middle
        return memory, Lead((u + x, v + y), self.search_n, trouble=trouble)

    def _on_spiral(self, way: float) -> tuple[tuple[float, float], float]:
        """Return the position at this distance along the spiral, m, and its distance from the centre, m."""
        turn = self.spacing_mm * 1e-3 / (2.0 * math.pi)
        angle = math.sqrt(2.0 * way / turn)
        radius = turn * angle
        return (radius * math.cos(angle), radius * math.sin(angle)), radius

    def _yielding(self, memory: Memory, sample: StepSample) -> Memory:
        """Return the centre, moved away from forces along the plate above friction, in both directions."""
        pressed, x, y = sample.force
        length = math.hypot(x, y)
        beyond = length - _DEAD_SHARE * max(pressed, 0.0)
        if not beyond > 0.0:
            return memory
        way = min(self.yield_mm_ns * beyond, self.speed_mm_s) * 1e-3 * sample.dt / length
        u, v = memory.middle
        return memory._replace(middle=(u - way * x, v - way * y))

    # --- words and picture

    def describe(self, parameters: object) -> Iterator[str]:
        yield f"{self.depth_mm:g} mm deep, searched within {self.radius_mm:g} mm with {self.search_n:g} N"

    @property
    def drawing(self) -> Drawing:
        return Drawing("#CC79A7", "-", "insert, at most", 1.2)

    @property
    def band(self) -> str:
        return "#f3dbe8"
