"""Properties of a step that are fixed before the run: stroke, limits, force and path."""

from dataclasses import dataclass
from itertools import pairwise

from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.stroke import Stroke
from hil_bridge.control.geometry.ways import Way


@dataclass(frozen=True, slots=True)
class StepPlan:
    """Stroke, limits, force and path of a step in one pass."""

    number: str
    """Number of the step for the operator, for example "3", or "3.1" within a repeat."""
    stroke: Stroke
    """Stroke with the parameters of the step."""
    limits: Limits
    """Limits of the run, tightened by the step."""
    profile: tuple[tuple[float, float], ...]
    """Pairs of path length, m, and desired force, N."""
    way: Way | None = None
    """Path along the surface relative to its start; None for a step without a path."""
    follows: bool = False
    """Whether the force is controlled along the estimated normal."""
    shows_ground: bool = False
    """Whether the controller receives depths from the plane that the estimated normal predicts."""
    phase: Phase = Phase.TRACK
    """Phase in which the step begins."""
    works_aside: bool = False
    """Whether the tool may meet obstacles next to its path, in this step or in an earlier step of the same touch."""
    turns: bool = True
    """Whether the step may turn the tool."""

    def reference(self, travel: float) -> float:
        """Return the desired force at the given path length (m), N."""
        profile = self.profile
        if len(profile) == 1 or travel <= profile[0][0]:
            return profile[0][1]
        for (begin, low), (end, high) in pairwise(profile):
            if travel < end:
                return low + (high - low) * (travel - begin) / (end - begin)
        return profile[-1][1]
