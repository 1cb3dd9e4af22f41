"""Limits of the supervisor, as settings with their units."""

import math
from dataclasses import dataclass
from typing import ClassVar

from hil_bridge.control.checks import require_above_zero, require_not_negative
from protocol.geometry import Vector
from protocol.marks import SettingError

_BEYOND_ARMS_M = 100.0
"""Smallest coordinate for which a corner of the box is probably in mm, m. Chosen. A coordinate one thousand times
larger deliberately disables the limit.
"""


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of a run. Every default is chosen, not a property of a device: set them for your cell."""

    __pydantic_config__: ClassVar = {"extra": "forbid"}

    force_limit_n: float = 50.0
    """Contact force along the approach direction, either sign, above which the run stops."""
    pull_limit_n: float = 10.0
    """Force away from the surface, along the approach direction and measured from the zero, above which the run stops.
    A surface presses and does not pull, so such a force is false: the tool would be pressed on in search of a contact
    that it already has. Chosen: above the noise, the drift and the weight error of a common tool.
    """
    resultant_limit_n: float = 100.0
    """Length of the force vector above which the run stops: a collision from the side."""
    against_travel_n: float = 20.0
    """Force against the motion, beyond friction, above which the run stops: an obstacle in the path. A track with a
    `lateral_limit_n` uses that instead, and a seek its `contact_n`. Chosen: such a force stops the run before its
    moment on a common tool does.
    """
    friction_share: float = 0.6
    """Share of the contact force that friction, or a slope, may cause against the travel. Chosen: a slope of 17° with a
    friction of 0.3.
    """
    correction_mm_s: float = 11.0
    """Largest speed of the command into the surface. Chosen: 2 mm in a cycle of 180 ms."""
    correction_total_mm: float = 100.0
    """Largest depth of the command below the start point."""
    travel_mm_s: float = 27.5
    """Largest speed of the command across the approach direction. Chosen: 5 mm in a cycle of 180 ms."""
    workspace_min_m: Vector = (-3.0, -3.0, -3.0)
    """Lowest corner of the box in which the tool must stay, base frame."""
    workspace_max_m: Vector = (3.0, 3.0, 3.0)
    """Highest corner of that box, base frame."""
    stale_after_ms: float = 200.0
    """Age of the newest sensor frame above which the run stops."""
    frozen_after_ms: float = 4000.0
    """Time for which frames have identical counts on all axes, after which the run stops. A filtered quiet signal
    repeats for some frames, a dead converter for ever. Chosen: 400 frames of the default stream.
    """
    unchanged_mm: float = 1.0
    """Largest distance that the tool may move through free space while the counts of all axes stay identical, for
    longer than `stale_after_ms`. Chosen: six emulated sensors in their quietest setting repeat their counts for at most
    0.12 s, which is 0.3 mm of a common approach.
    """
    unanswered_mm: float = 2.0
    """Depth by which a pressing tool may move deeper without the force changing, by one count or by 2 mN. Beyond it,
    the axis that measures the force is dead, while the controller presses ever harder. It is also the depth that the
    change of the force, the stiffness and a slope need not explain. On a soft surface that depth is larger, by
    `pull_limit_n`, and on a hard one smaller, by half of what is left to `force_limit_n`.
    """
    oscillation_guard: bool = True
    """Whether to lower the gain of a loop whose force oscillates for long, and end the run if that does not help."""
    still_after_ms: float = 450.0
    """Time of the cycles without a new sensor frame after which the run stops. Chosen: three cycles of 172 … 187 ms
    reach it and two do not.
    """
    moment_limit_nm: float = 10.0
    """Length of the moment vector about the tool frame's origin above which the run stops."""
    force_margin_share: float = 0.1
    """Share of `force_limit_n` that is kept as a margin: no command moves deeper than where the current stiffness
    predicts the rest.
    """
    witness_n: float | None = None
    """Difference between the force sensor and the robot's own force, along the approach and each from its zero, above
    which the run stops. Default: the normal difference for the robot according to its facts; 0: no check.
    """
    witness_ms: float = 100.0
    """Longest duration of that difference, in addition to twice the delay of the robot's own force; half as long for
    twice the difference. Chosen: sensor and robot measure a quick touch some tens of milliseconds apart.
    """
    following_error_mm: float = 10.0
    """Distance between the reported and the commanded position above which the run stops."""
    path_error_mm: float = 0.3
    """Distance along the approach between the reported depth and all depths that were ordered in the robot's usual time
    for an order, above which the run stops. Chosen: several times the largest distance observed on healthy robots.
    """
    tilt_deg: float = 2.0
    """Angle between the reported and the ordered orientation above which the run stops; a rotation in progress is added
    to it.
    """
    turn_deg_s: float = 10.0
    """Largest angular speed at which a program may turn the tool."""
    turn_total_deg: float = 30.0
    """Largest angle between the tool's axis and that of the start in a program."""
    cycle_deadline_ms: float = 500.0
    """Longest duration of a decision, or of a pause of the computer; a longer one stops the run."""
    cycle_max_ms: float = 500.0
    """Duration of a cycle above which the run stops, after three consecutive cycles that were longer, and longer than
    two periods. Chosen: a line of 4800 baud takes 375 ms, and the controllers are tuned for half of that.
    """
    zero_max_n: float = 50.0
    """Largest force that may be used as the zero, in addition to the known weight of the tool and bias of the sensor.
    """
    weight_tolerance_n: float = 1.0
    """Largest difference of each force from the known weight of the tool before a run moves."""
    weight_tolerance_nm: float = 0.2
    """The same for each moment."""
    escape_mm_s: float = 30.0
    """Largest speed of a tool that moves back from a surface pressing it beyond `force_limit_n`, up to the path
    velocity of the robot. Chosen: above the speed of a surface of 20 mm/s. An obstacle behind the tool is hit at this
    speed.
    """
    retract_rise_n: float = 5.0
    """Rise of the force while retracting above which the tool stops."""
    retract_grace_ms: float = 700.0
    """Time that a retraction from contact has to take effect; until then the force may still rise. It covers two cycles
    of the slowest line, the servo and the sensor's filter.
    """
    blind_retract_mm: float = 3.0
    """Distance that a tool that pressed is pulled back while the force is unknown, at least to the depth of the start.
    Chosen: 10 N on 5 kN/m need 2 mm. An obstacle of 50 kN/m within that distance is pressed with at most 150 N.
    """
    retract_patience_s: float = 5.0
    """Time for which a retraction is repeated when the robot refuses it or does not respond."""

    def __post_init__(self) -> None:
        require_above_zero(
            self,
            "force_limit_n",
            "pull_limit_n",
            "resultant_limit_n",
            "against_travel_n",
            "correction_mm_s",
            "correction_total_mm",
            "travel_mm_s",
            "stale_after_ms",
            "frozen_after_ms",
            "unchanged_mm",
            "unanswered_mm",
            "still_after_ms",
            "moment_limit_nm",
            "following_error_mm",
            "path_error_mm",
            "tilt_deg",
            "turn_deg_s",
            "turn_total_deg",
            "cycle_deadline_ms",
            "cycle_max_ms",
            "zero_max_n",
            "weight_tolerance_n",
            "weight_tolerance_nm",
            "retract_rise_n",
            "escape_mm_s",
        )
        require_not_negative(
            self,
            "friction_share",
            "force_margin_share",
            "retract_grace_ms",
            "retract_patience_s",
            "blind_retract_mm",
            "witness_ms",
        )
        if self.witness_n is not None:
            require_not_negative(self, "witness_n")
        if self.force_margin_share >= 1:
            raise SettingError("force_margin_share", f"must be below 1, got {self.force_margin_share}")
        for corner in ("workspace_min_m", "workspace_max_m"):
            parts = getattr(self, corner)
            if _BEYOND_ARMS_M < max(map(abs, parts)) <= _BEYOND_ARMS_M * 1e3:
                metres = [round(part * 1e-3, 6) for part in parts]
                raise SettingError(
                    corner, f"is in m, which is out of reach of any arm; did you mean {metres}?"
                )
        for low, high in zip(self.workspace_min_m, self.workspace_max_m, strict=True):
            if not (math.isfinite(low) and math.isfinite(high) and low < high):
                raise SettingError("workspace_min_m", "must be below workspace_max_m on every axis")
