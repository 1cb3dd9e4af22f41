"""Settings of the task, with units."""

from dataclasses import dataclass
from typing import ClassVar

from hil_bridge.control.checks import require_above_zero, require_not_negative
from hil_bridge.control.types import POSITION_STEP_MM, SAMPLE_MS
from protocol.marks import SettingError

SLOWEST_APPROACH_MM_S = 0.02
"""Smallest approach speed, mm/s. Chosen: at this speed, an approach over the default depth takes a quarter of an
hour. A smaller value was probably given in m/s.
"""


@dataclass(frozen=True, slots=True)
class TaskParameters:
    """Settings of the task. All values are chosen for the paper's experiments and the robot's resolution."""

    __pydantic_config__: ClassVar = {"extra": "forbid"}

    force_n: float = 10.0
    """Desired contact force. Source: the paper's experiments."""
    approach_speed_mm_s: float = 2.75
    """Largest speed of the approach. Chosen: 0.5 mm in a cycle of 180 ms."""
    expected_stiffness_n_m: float = 5000.0
    """Stiffness of the hardest surface expected. It limits the approach speed, so that a first touch presses with no
    more than the desired force, and no more than half the supervisor's limit. Source: the paper's sponge.
    """
    approach_depth_limit_mm: float = 15.0
    """Largest depth of an approach before it is given up; a sensor that does not respond can make the tool press this
    far. Chosen: the start is assumed to be about 10 mm above the surface.
    """
    unverified_depth_mm: float = 3.0
    """The same if nothing has verified the axis that measures the force. A dead axis lets the tool press this far, less
    its distance from the surface. Chosen: 15 N on 5 kN/m, and 150 N on 50 kN/m.
    """
    search_depth_limit_mm: float = 5.0
    """Largest depth added after a contact loss before the surface counts as ended, so that the tool does not dive over
    an edge.
    """
    least_stiffness_n_m: float | None = None
    """Smallest stiffness that a touch must show if the tool's weight could not verify the axis that measures the force:
    the tool moves deeper in small steps, and the force must rise. Default: a quarter of `expected_stiffness_n_m`; it
    refuses an axis that reports less than a quarter of the force. Reported depths show surface and arm in series, so
    an arm softer than a third of `expected_stiffness_n_m` needs a smaller value.
    """
    contact_threshold_n: float = 1.0
    """Force above which the tool is in contact."""
    loss_threshold_n: float = 0.5
    """Force below which contact counts as lost; lower than `contact_threshold_n`, so that noise does not toggle it."""
    loss_ms: float = 800.0
    """Time without contact after which the surface is approached again; until then, the controller may regain it by
    itself, without further travel. Chosen: five samples of 172 … 187 ms reach it and four do not.
    """
    loss_limit: int = 20
    """Number of contact losses that ends the run."""
    speed_mm_s: float = 5.5
    """Speed along the surface. Source: the paper's experiments, 1 mm in a cycle of 180 ms."""
    travel_from_share: float = 0.0
    """Share of the desired force that must be reached after first contact before the tool travels; 0 travels at once.
    Waiting keeps an unknown slope out of the first estimate of the stiffness. The tool also travels if the controller
    is in its dead band, because the force then comes no nearer.
    """
    travel_rise_s: float | None = None
    """Time in which the travel reaches its speed, from the touch and from each stop, so that an unknown slope shows
    before the tool moves fast. 0 reaches it at once. Default: 1.2 s if the tool follows the normal of a surface, the
    robot streams, and `controller.sample_ms` is not set; otherwise 0.
    """
    travel_limit_mm: float = 500.0
    """Travel after which tracking ends."""
    retract_speed_mm_s: float = 5.5
    """Speed at which depth is reduced while retracting. Chosen: 1 mm in a cycle of 180 ms."""
    retract_mm: float = 20.0
    """Total distance of the retraction, from where tracking ended; at least back to the depth of the start."""
    zero_lift_mm: float = 0.5
    """Distance that the tool moves away from the surface before the zero is taken; the force must not change meanwhile.
    0 takes the zero at the tool's position.
    """
    zero_step_mm: float = POSITION_STEP_MM
    """One step of that motion, small enough to do no harm in the wrong direction. Chosen: the resolution of the robot's
    position.
    """
    zero_change_n: float = 0.5
    """Change of the force during that motion, or while the tool is stationary, above which no zero is taken. Source:
    the paper's uncertainty of its sensor.
    """
    safe_height_mm: float = 0.0
    """Height above the start point, away from the surface, at which a program moves to another point."""

    @property
    def least_stiffness(self) -> float:
        """Return the smallest stiffness that a doubtful touch must show, N/m."""
        return self.least_stiffness_n_m or self.expected_stiffness_n_m / 4

    @property
    def single_step_mm(self) -> float:
        """Return the step of a motion that pauses after each step, mm: the distance of an approach in `SAMPLE_MS`.
        A sufficiently long step is rounded to a multiple of `zero_step_mm`.
        """
        step = self.approach_speed_mm_s * SAMPLE_MS * 1e-3
        return round(step / self.zero_step_mm) * self.zero_step_mm or step

    def __post_init__(self) -> None:
        require_above_zero(
            self,
            "force_n",
            "approach_speed_mm_s",
            "expected_stiffness_n_m",
            "approach_depth_limit_mm",
            "unverified_depth_mm",
            "search_depth_limit_mm",
            "contact_threshold_n",
            "loss_ms",
            "loss_limit",
            "travel_limit_mm",
            "retract_speed_mm_s",
            "zero_step_mm",
            "zero_change_n",
        )
        require_not_negative(
            self,
            "loss_threshold_n",
            "speed_mm_s",
            "travel_from_share",
            "retract_mm",
            "zero_lift_mm",
            "safe_height_mm",
        )
        check_approach_speed("approach_speed_mm_s", self.approach_speed_mm_s)
        if self.least_stiffness_n_m is not None:
            require_above_zero(self, "least_stiffness_n_m")
        if self.travel_rise_s is not None:
            require_not_negative(self, "travel_rise_s")
        if self.loss_threshold_n > self.contact_threshold_n:
            raise SettingError("loss_threshold_n", "must not be above contact_threshold_n")
        if self.travel_from_share > 1:
            raise SettingError("travel_from_share", "must not be above 1")
        if self.contact_threshold_n >= self.force_n:
            raise SettingError("contact_threshold_n", "must be below force_n")


def check_approach_speed(setting: str, speed_mm_s: float) -> None:
    """Raise SettingError if an approach would take hours."""
    if speed_mm_s < SLOWEST_APPROACH_MM_S:
        raise SettingError(
            setting,
            f"must be at least {SLOWEST_APPROACH_MM_S:g}, got {speed_mm_s:g}; it is in mm/s: did you mean "
            f"{speed_mm_s * 1e3:g}?",
        )
