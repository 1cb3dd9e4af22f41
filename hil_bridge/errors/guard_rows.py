"""Rows of the table of causes for the guard: why the supervisor stops, and why it orders less."""

from hil_bridge.errors import cause_row as rows
from hil_bridge.errors.cause_row import CauseRow, Reaction, When
from hil_bridge.errors.causes import Cause, Part

_C, _P, _W, _R = Cause, Part, When, Reaction
_ROBOT, _SENSOR = rows.PART_WORDS[_P.ROBOT], rows.PART_WORDS[_P.SENSOR]


def _stands(cause: Cause, condition: str, *settings: str) -> CauseRow:
    return CauseRow(cause, condition, settings, _P.OBSTACLE, _W.RETRACTION, _R.STANDS)


def _clamp(
    cause: Cause, condition: str, *settings: str, part: Part = _P.PATH, when: When = _W.CYCLE
) -> CauseRow:
    return CauseRow(cause, condition, settings, part, when, _R.CLAMPED, None)


STOPS: tuple[CauseRow, ...] = (
    rows.stop(_C.FORCE_NOT_A_NUMBER, "a force, or the time of one, is not a number", _P.SENSOR),
    rows.stop(_C.POSE_NOT_A_NUMBER, "the reported pose is not a number", _P.POSE),
    rows.stop(
        _C.COMMAND_NOT_A_NUMBER, "what the controller or the task commands is not a number", _P.CONTROLLER
    ),
    rows.stop(
        _C.ROBOT_STATE,
        "the robot's status shows a stop, or a mode in which it takes no orders",
        _P.ROBOT,
        when=_W.ALWAYS,
        reaction=_R.RETRACTS_OR_LEFT,
    ),
    rows.stop(_C.ORIENTATION, "the robot reports an invalid orientation", _P.POSE),
    rows.stop(_C.SENSOR_FAILED, "the sensor failed, restarted, or its wire ended", _P.SENSOR, when=_W.ALWAYS),
    rows.stop(
        _C.FORCE,
        "force along the approach, of any frame since the decision before, either sign, with and without the zero",
        _P.CONTACT,
        "limits.force_limit_n",
    ),
    rows.stop(
        _C.RESULTANT_FORCE,
        "length of the force vector, of any frame since the decision before, with and without the zero",
        _P.CONTACT,
        "limits.resultant_limit_n",
    ),
    rows.stop(
        _C.MOMENT,
        "length of the moment vector about the tool frame's origin, of any frame since the decision before",
        _P.CONTACT,
        "limits.moment_limit_nm",
    ),
    rows.stop(
        _C.WALL,
        "force against the way along the surface, beyond the friction of the contact force; where no weight verified "
        "the axes, the force in any direction across the approach",
        _P.OBSTACLE,
        "limits.against_travel_n",
        "limits.friction_share",
    ),
    rows.stop(_C.SATURATED, "an axis of the sensor was at the end of its range", _P.SENSOR),
    rows.stop(
        _C.PULL,
        "force along the approach away from the surface, from the zero",
        _P.SENSOR,
        "limits.pull_limit_n",
        words=f"{_SENSOR} or its zero, or a tool that hangs on to something",
        where="whether the sensor reads 0 when the tool touches nothing, and whether the tool sticks",
    ),
    rows.stop(
        _C.FORCE_TOO_OLD,
        "age of the newest frame, with the time by which a stream came to be later than its quickest frames were; "
        "frames that repeat an earlier part of the stream are as old as its begin",
        _P.SENSOR,
        "limits.stale_after_ms",
    ),
    rows.stop(
        _C.SAME_COUNTS,
        "how long frames carry identical counts on all axes",
        _P.SENSOR,
        "limits.frozen_after_ms",
    ),
    rows.stop(_C.NO_NEW_FRAME, "time of the cycles without a new frame", _P.SENSOR, "limits.still_after_ms"),
    rows.stop(
        _C.DEAD_AXIS,
        "an axis that the controlled force mainly lies on did not change since the zero while another moved by a "
        "tenth of its range; or the moments show 10 N across the approach that unverified force axes do not",
        _P.SENSOR,
    ),
    rows.stop(
        _C.JUMP,
        "the reported position moved faster than half again the path velocity, beyond 1 mm",
        _P.POSE,
        "robot.velocity_mm_s",
    ),
    rows.stop(
        _C.FOLLOWING,
        "distance of the reported from the commanded position",
        _P.POSE,
        "limits.following_error_mm",
    ),
    rows.stop(
        _C.TILT,
        "turn of the reported orientation from the ordered one, beside what a robot may not have followed yet",
        _P.POSE,
        "limits.tilt_deg",
    ),
    rows.stop(
        _C.OUTSIDE,
        "the reported position is outside the workspace by more than 1 mm",
        _P.POSE,
        *rows.WORKSPACE,
    ),
    rows.stop(
        _C.UNANSWERED,
        "how far a pressing tool went deeper without the force changing, by one count or by 2 mN; or than force, "
        "stiffness and a slope of 45° explain, where a false force of so much could pass the limit",
        _P.SENSOR,
        "limits.unanswered_mm",
        "limits.pull_limit_n",
        "limits.force_limit_n",
        words=rows.SENSOR_OR_TOUCH,
        where=rows.FREELY,
    ),
    rows.stop(_C.SEQUENCE, "the sensor's frame counter went back", _P.SENSOR),
    rows.stop(
        _C.DEADLINE,
        "how long the computer stood still, or a decision lasted",
        _P.COMPUTER,
        "limits.cycle_deadline_ms",
    ),
    rows.stop(
        _C.INCONSISTENT, "depth and position of a command contradict each other, which is a bug", _P.PROGRAM
    ),
    rows.stop(
        _C.WITNESS,
        "difference between the force sensor and the force that the robot itself feels, for a time, where it tells one",
        _P.SENSOR,
        "limits.witness_n",
        "limits.witness_ms",
        words=f"{_SENSOR}, or something that touches {_ROBOT} beside the sensor",
        where="what the sensor reads when the tool is pressed by hand; hoses and cables of the tool; then the robot's "
        "own force, with its axes and its zero",
    ),
    rows.stop(
        _C.LOST_WEIGHT,
        "a pull that lasts while the tool moves through free space: the sensor lost the tool's weight",
        _P.SENSOR,
        "limits.weight_tolerance_n",
        where=rows.FREELY,
    ),
    rows.stop(
        _C.UNCHANGED,
        "how far the tool moved through free space while frames carry identical counts on all axes",
        _P.SENSOR,
        "limits.unchanged_mm",
        "limits.stale_after_ms",
    ),
    rows.stop(
        _C.OFF_PATH,
        "distance along the approach of the reported position from all that was ordered in the time that the robot "
        "takes for an order, half of it added",
        _P.POSE,
        "limits.path_error_mm",
    ),
    rows.stop(
        _C.CONTROLLER,
        "the controller raised an exception, or answered with what is not a number, or with a place farther than the "
        "workspace and the whole correction together",
        _P.CONTROLLER,
    ),
    rows.stop(
        _C.STEP_CODE,
        "a program's step raised an exception, or leads to a place that is not a number",
        _P.OTHERS_CODE,
    ),
    rows.stop(
        _C.STEP_TROUBLE,
        "a program's step of a plug-in says that it cannot continue",
        _P.PATH,
        "task.step",
        words="that which the step works on, by the word of the step",
        where="its settings in task.step, and the place where the step began",
    ),
    rows.stop(
        _C.OSCILLATION,
        "the force continues swinging although the gain is at its least",
        _P.CONTACT,
        "limits.oscillation_guard",
        "oscillation.peaks",
        "oscillation.window_ms",
        "oscillation.band_min_n",
        "oscillation.decay",
        "oscillation.factor_min",
        words="the contact, which is harder than the controller is tuned for, or the controller",
        where="the stiffness in the report, the parameters of the controller, and [oscillation]",
    ),
    _stands(
        _C.BEHIND,
        "a force from behind met the tool, beside one that was there when the retraction began",
        "limits.pull_limit_n",
    ),
    _stands(
        _C.RETRACT_OVER,
        "a retraction that began within the force limit carried the force beyond it, from the side",
        "limits.force_limit_n",
    ),
    _stands(
        _C.RETRACT_RISE,
        "a force from the side rose while the tool retracted, from contact only after a time to take effect; or one "
        "from the front rose at the second, slow try",
        "limits.retract_rise_n",
        "limits.retract_grace_ms",
    ),
    _stands(
        _C.RETRACT_STAYS,
        "the force stayed beyond its limit although the tool reported to be so much farther back; one from the front, "
        "at the second try and beyond the start",
        "limits.force_limit_n",
        "limits.resultant_limit_n",
        "limits.unanswered_mm",
    ),
)
"""Conditions for which the supervisor stops."""

CLAMPS: tuple[CauseRow, ...] = (
    _clamp(
        _C.BARRIER,
        "deeper than where the force limit less its margin is predicted, by the larger of estimated and expected "
        "stiffness",
        "limits.force_limit_n",
        "limits.force_margin_share",
        "task.expected_stiffness_n_m",
        part=_P.CONTACT,
    ),
    _clamp(
        _C.OVERDUE,
        "deeper while the sensor's next frame is later than its period and 10.5 ms of wire; continues with that frame",
        part=_P.SENSOR,
    ),
    _clamp(_C.DEEPER, "deeper faster than allowed", "limits.correction_mm_s"),
    _clamp(_C.TOTAL, "deeper than the start by more in all", "limits.correction_total_mm"),
    _clamp(_C.ACROSS, "across the approach faster than allowed", "limits.travel_mm_s"),
    _clamp(_C.WORKSPACE, "out of the workspace", *rows.WORKSPACE),
    _clamp(_C.TURN, "a program turns the tool faster than allowed", "limits.turn_deg_s"),
    _clamp(_C.TIP, "a program tips the tool's axis farther than allowed", "limits.turn_total_deg"),
    _clamp(
        _C.GAIN,
        "the force swings for long: the controller's corrections are lowered",
        "limits.oscillation_guard",
        "oscillation.peaks",
        "oscillation.window_ms",
        "oscillation.notch",
        part=_P.CONTACT,
    ),
    _clamp(
        _C.RETRACT_WAITS,
        "a force from the front rose, or stayed beyond its limit, while the tool retracted: it waits, and continues if "
        "the force rises meanwhile, else tries once more at 1 mm/s",
        "limits.retract_rise_n",
        "limits.retract_grace_ms",
        "limits.force_limit_n",
        "limits.unanswered_mm",
        "limits.escape_mm_s",
        part=_P.OBSTACLE,
        when=_W.RETRACTION,
    ),
    _clamp(
        _C.NO_FORCE,
        "while the force cannot be known a retraction goes back at 2.75 mm/s to the depth of the start, or a little "
        "behind the contact, and no farther",
        "limits.stale_after_ms",
        "limits.blind_retract_mm",
        part=_P.SENSOR,
        when=_W.RETRACTION,
    ),
)
"""Conditions that shorten a command. A command that pulls back is never shortened, but by the workspace."""
