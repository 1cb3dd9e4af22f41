"""Conditions that refuse, clamp or end a run, one row each. Here are the rows of all that decides in a cycle.

The rows are for people: `hil-bridge supervisor table` and the page of safety print them, `hil-bridge supervisor
explain` names them. What is decided is decided by supervisor and task alone.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from hil_bridge.control.course.verdict import Cause


class When(StrEnum):
    """When a condition is looked at."""

    BEFORE_MOTION = "before anything moves"
    LIFT = "on the way to the zero"
    CYCLE = "every cycle until the retraction"
    RETRACTION = "every cycle of the retraction"
    ALWAYS = "as long as the tool moves"
    END = "at the end"


class Reaction(StrEnum):
    """Consequence of a condition."""

    REFUSED = "refused, nothing has moved"
    CLAMPED = "less is ordered, the run goes on"
    RETRACTS = "retracts and ends"
    STANDS = "stands still and ends"
    LEFT = "left where it is"
    RETRACTS_OR_LEFT = "retracts once the robot takes orders; else left where it is"


STOPPED, COMPLETED, INTERRUPTED, CONFIGURATION = 3, 0, 130, 2
"""Exit codes that the rows name."""


@dataclass(frozen=True, slots=True)
class ConditionRow:
    """One condition and its consequence."""

    name: str
    """The supervisor's own cause where it is one, else a name of the same kind."""
    condition: str
    """Condition in words."""
    settings: tuple[str, ...]
    """Keys of the configuration that rule it, without those that describe a device."""
    when: When = When.CYCLE
    reaction: Reaction = Reaction.RETRACTS
    exit_code: int | None = STOPPED
    """None where the run goes on."""
    cause: Cause | None = None
    """The supervisor's; None for what another part decides."""


def _stop(cause: Cause, condition: str, *settings: str) -> ConditionRow:
    return ConditionRow(cause.value, condition, settings, cause=cause)


def _clamp(name: str, condition: str, *settings: str) -> ConditionRow:
    return ConditionRow(name, condition, settings, reaction=Reaction.CLAMPED, exit_code=None)


def _stands(condition: str, *settings: str) -> ConditionRow:
    cause = Cause.RETRACTION
    return ConditionRow(cause.value, condition, settings, When.RETRACTION, Reaction.STANDS, cause=cause)


STOPS: tuple[ConditionRow, ...] = (
    _stop(Cause.NOT_A_NUMBER, "a measurement, or what the controller commands, is no number"),
    _stop(
        Cause.DEVICE,
        "the robot's status shows emergency stop, standby, a key not in AUTO, link control taken back, or an "
        "orientation that is none; or the sensor failed, began anew, or its wire ended",
        "robot.s3.link.check_flags",
    ),
    _stop(
        Cause.FORCE,
        "force along the approach, of any frame since the decision before, either sign, with and without the zero",
        "limits.force_limit_n",
    ),
    _stop(
        Cause.RESULTANT_FORCE,
        "length of the force vector, of any frame since the decision before, with and without the zero",
        "limits.resultant_limit_n",
    ),
    _stop(
        Cause.MOMENT,
        "length of the moment vector about the tool frame's origin, of any frame since the decision before",
        "limits.moment_limit_nm",
    ),
    _stop(
        Cause.WALL,
        "force against the travel of a plain run, beyond the friction of the contact force: something is in the way",
        "limits.against_travel_n",
        "limits.friction_share",
    ),
    _stop(Cause.SATURATED, "an axis of the sensor was at the end of its range"),
    _stop(
        Cause.PULL,
        "force along the approach away from the surface, from the zero",
        "limits.pull_limit_n",
    ),
    _stop(
        Cause.STALE,
        "age of the newest frame, with the time by which a stream came to be later than its quickest frames were",
        "limits.stale_after_ms",
    ),
    _stop(Cause.FROZEN, "how long frames carry identical counts on all axes", "limits.frozen_after_ms"),
    _stop(Cause.FROZEN, "time of the cycles without a new frame", "limits.still_after_ms"),
    _stop(
        Cause.FROZEN,
        "an axis that the controlled force mainly lies on did not change since the zero while another moved by a "
        "tenth of its range",
    ),
    _stop(
        Cause.FROZEN,
        "how far a pressing tool went deeper without the force changing, by one count or by 2 mN",
        "limits.unanswered_mm",
    ),
    _stop(
        Cause.POSE,
        "the reported position moved faster than half again the path velocity, beyond 1 mm",
        "robot.velocity_mm_s",
    ),
    _stop(Cause.POSE, "distance of the reported from the commanded position", "limits.following_error_mm"),
    _stop(
        Cause.POSE,
        "distance along the approach of the reported position from all that was ordered in the time that the robot "
        "takes for an order, half of it added",
        "limits.path_error_mm",
    ),
    _stop(
        Cause.POSE,
        "turn of the reported orientation from the ordered one, beside what a robot may not have followed yet",
        "limits.tilt_deg",
    ),
    _stop(
        Cause.POSE,
        "the reported position is outside the workspace by more than 1 mm",
        "limits.workspace_min_m",
        "limits.workspace_max_m",
    ),
    _stop(Cause.SEQUENCE, "the sensor's frame counter went back"),
    _stop(
        Cause.DEADLINE,
        "how long the computer stood still, or a decision lasted",
        "limits.cycle_deadline_ms",
    ),
    _stop(Cause.INCONSISTENT, "depth and position of a command contradict each other, which is a bug"),
    _stop(
        Cause.FROZEN,
        "a pull that lasts while the tool moves through free space: the sensor lost the tool's weight",
        "limits.weight_tolerance_n",
    ),
    _stop(
        Cause.FROZEN,
        "how far the tool moved through free space while frames carry identical counts on all axes",
        "limits.unchanged_mm",
        "limits.stale_after_ms",
    ),
    _stop(
        Cause.WITNESS,
        "difference between the force sensor and the force that the robot itself feels, for a time, where it tells one",
        "limits.witness_n",
        "limits.witness_ms",
    ),
    _stop(
        Cause.CONTROLLER,
        "the controller raised an exception, or answered with what is no number, or with a place farther than the "
        "workspace and the whole correction together",
    ),
    _stop(
        Cause.OSCILLATION,
        "the force goes on swinging although the gain is at its least",
        "limits.oscillation_guard",
        "oscillation.peaks",
        "oscillation.window_ms",
        "oscillation.band_min_n",
        "oscillation.decay",
        "oscillation.factor_min",
    ),
    _stands(
        "a force from behind met the tool, beside one that was there when the retraction began",
        "limits.pull_limit_n",
    ),
    _stands(
        "a force from the side rose while the tool retracted, from contact only after a time to take effect; or one "
        "from the front rose at the second, slow try",
        "limits.retract_rise_n",
        "limits.retract_grace_ms",
    ),
    _stands(
        "the force stayed beyond its limit although the tool reported to be so much farther back; one from the front, "
        "at the second try and beyond the start",
        "limits.force_limit_n",
        "limits.resultant_limit_n",
        "limits.unanswered_mm",
    ),
)
"""Conditions for which the supervisor stops, in the order in which it looks."""

BARRIER = _clamp(
    "barrier",
    "deeper than where the force limit less its margin is predicted, by the larger of estimated and expected stiffness",
    "limits.force_limit_n",
    "limits.force_margin_share",
    "task.expected_stiffness_n_m",
)
CLAMPS: tuple[ConditionRow, ...] = (
    BARRIER,
    _clamp(
        "overdue",
        "deeper while the sensor's next frame is later than its period and 10.5 ms of wire; it goes on with that frame",
    ),
    _clamp("deeper", "deeper faster than allowed", "limits.correction_mm_s"),
    _clamp("total", "deeper than the start by more in all", "limits.correction_total_mm"),
    _clamp("across", "across the approach faster than allowed", "limits.travel_mm_s"),
    _clamp("workspace", "out of the workspace", "limits.workspace_min_m", "limits.workspace_max_m"),
    _clamp("turn", "a program turns the tool faster than allowed", "limits.turn_deg_s"),
    _clamp("tip", "a program tips the tool's axis farther than allowed", "limits.turn_total_deg"),
    _clamp(
        "gain",
        "the force swings for long: the controller's corrections are lowered",
        "limits.oscillation_guard",
        "oscillation.peaks",
        "oscillation.window_ms",
        "oscillation.notch",
    ),
    ConditionRow(
        "waits",
        "a force from the front rose, or stayed beyond its limit, while the tool retracted: it waits, and goes on if "
        "the force rises meanwhile, else tries once more at 1 mm/s",
        (
            "limits.retract_rise_n",
            "limits.retract_grace_ms",
            "limits.force_limit_n",
            "limits.unanswered_mm",
            "limits.escape_mm_s",
        ),
        When.RETRACTION,
        Reaction.CLAMPED,
        None,
    ),
    ConditionRow(
        "no-force",
        "while the force cannot be known a retraction goes back at 2.75 mm/s to the depth of the start, or a little "
        "behind the contact, and no farther",
        ("limits.stale_after_ms", "limits.blind_retract_mm"),
        When.RETRACTION,
        Reaction.CLAMPED,
        None,
    ),
)
"""Conditions that shorten a command. A command that pulls back is never shortened, but by the workspace."""

ENDS: tuple[ConditionRow, ...] = (
    ConditionRow("held-approach", "a clamp holds the approach in place", ()),
    ConditionRow("no-contact", "no contact found on the way", ("task.approach_depth_limit_mm",)),
    ConditionRow(
        "unanswered-touch",
        "a touch that the tool's weight could not vouch for: the force does not rise as the tool goes deeper",
        ("task.least_stiffness_n_m", "task.zero_change_n"),
    ),
    ConditionRow(
        "surface-ended", "no contact found again after it was lost", ("task.search_depth_limit_mm",)
    ),
    ConditionRow("contact-lost", "contact was lost too often", ("task.loss_limit", "task.loss_ms")),
    ConditionRow("touch", "a program's tool touches something on its way through free space", ("task.step",)),
    ConditionRow("no-progress", "a lateral force holds the feed of a program's step", ("task.step",)),
    ConditionRow("not-found", "a program's step finds nothing to touch, or no edge", ("task.step",)),
    ConditionRow("drift", "more force would be taken for zero between a program's strokes", ("task.step",)),
    ConditionRow(
        "travelled", "the way along the surface is done", ("task.travel_limit_mm",), exit_code=COMPLETED
    ),
    ConditionRow("time-is-up", "the time of tracking is over", ("run.duration_s",), exit_code=COMPLETED),
)
"""Other conditions that end a run that can still decide."""

GATE = ConditionRow(
    Cause.GATE.value,
    "the last gate stops an order: deeper, faster, farther or turned more than may be ordered, or no pose; this is a "
    "bug",
    (
        "limits.correction_total_mm",
        "limits.correction_mm_s",
        "limits.travel_mm_s",
        "limits.workspace_min_m",
        "limits.workspace_max_m",
        "limits.turn_deg_s",
        "limits.turn_total_deg",
    ),
    When.ALWAYS,
    Reaction.RETRACTS_OR_LEFT,
    cause=Cause.GATE,
)
"""The condition of the last gate, which stands behind the supervisor."""

BY_CAUSE: Mapping[Cause, tuple[ConditionRow, ...]] = {
    cause: tuple(row for row in (*STOPS, GATE) if row.cause is cause) for cause in Cause
}
"""The rows of each cause."""
