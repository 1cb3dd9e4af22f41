"""What is settled of a step before the run: its stroke, limits, force and path."""

from dataclasses import dataclass
from itertools import pairwise

from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.stroke import Stroke
from hil_bridge.control.geometry.ways import Way


@dataclass(frozen=True, slots=True)
class StepPlan:
    """A step's own stroke, limits, force and path, in one pass."""

    number: str
    """Number for the operator: "3", or "3.1" within a repeat."""
    stroke: Stroke
    """The stroke with the step's own parameters."""
    limits: Limits
    """Limits of the run, tightened by the step."""
    profile: tuple[tuple[float, float], ...]
    """Length of the path in m and desired force in N."""
    way: Way | None = None
    """Path along the surface, relative to where it begins; None for a step without one."""
    follows: bool = False
    """The force is controlled along the estimated normal."""
    shows_ground: bool = False
    """The controller is given depths from the plane that the estimated normal predicts."""
    phase: Phase = Phase.TRACK
    """Phase in which the step begins."""
    works_aside: bool = False
    """The tool may meet obstacles beside its path, in this step or in an earlier one of the same touch."""
    turns: bool = True
    """The tool may be turned in it."""

    def reference(self, travel: float) -> float:
        """Return the desired force at this length of the path, m; N."""
        profile = self.profile
        if len(profile) == 1 or travel <= profile[0][0]:
            return profile[0][1]
        for (begin, low), (end, high) in pairwise(profile):
            if travel < end:
                return low + (high - low) * (travel - begin) / (end - begin)
        return profile[-1][1]
