"""Rows of the table of causes for the supervisor: conditions for which it stops a run or clamps a command."""

from hil_bridge.errors import cause_row as rows
from hil_bridge.errors.cause_row import CauseRow, Reaction, When
from hil_bridge.errors.causes import Cause, Part

_C, _P, _W, _R = Cause, Part, When, Reaction
_ROBOT, _SENSOR = rows.PART_DESCRIPTIONS[_P.ROBOT], rows.PART_DESCRIPTIONS[_P.SENSOR]


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
        _C.COMMAND_NOT_A_NUMBER, "a command of the controller or the task is not a number", _P.CONTROLLER
    ),
    rows.stop(
        _C.ROBOT_STATE,
        "the robot's status shows a stop, or a mode in which it accepts no orders",
        _P.ROBOT,
        when=_W.ALWAYS,
        reaction=_R.RETRACTS_OR_LEFT,
    ),
    rows.stop(_C.ORIENTATION, "the robot reports an invalid orientation", _P.POSE),
    rows.stop(
        _C.SENSOR_FAILED, "the sensor failed or restarted, or its connection ended", _P.SENSOR, when=_W.ALWAYS
    ),
    rows.stop(
        _C.FORCE,
        "force along the approach, either sign, of any frame since the previous decision, with "
        "and without the zero",
        _P.CONTACT,
        "limits.force_limit_n",
    ),
    rows.stop(
        _C.RESULTANT_FORCE,
        "magnitude of the force vector, of any frame since the previous decision, with and without the zero",
        _P.CONTACT,
        "limits.resultant_limit_n",
    ),
    rows.stop(
        _C.MOMENT,
        "magnitude of the moment vector about the tool frame's origin, of any frame since the "
        "previous decision",
        _P.CONTACT,
        "limits.moment_limit_nm",
    ),
    rows.stop(
        _C.WALL,
        "force against the motion along the surface, in excess of the friction of the contact "
        "force; for axes that the weight has not verified, the force in any direction across the "
        "approach",
        _P.OBSTACLE,
        "limits.against_travel_n",
        "limits.friction_share",
    ),
    rows.stop(_C.SATURATED, "an axis of the sensor was at the end of its range", _P.SENSOR),
    rows.stop(
        _C.PULL,
        "force along the approach away from the surface, relative to the zero",
        _P.SENSOR,
        "limits.pull_limit_n",
        words=f"{_SENSOR} or its zero, or a tool that hangs on to something",
        where="whether the sensor reads 0 when the tool touches nothing, and whether the tool sticks",
    ),
    rows.stop(
        _C.FORCE_TOO_OLD,
        "age of the newest frame, plus the delay of the stream relative to its fastest frames; "
        "frames that repeat an earlier part of the stream are as old as the start of that part",
        _P.SENSOR,
        "limits.stale_after_ms",
    ),
    rows.stop(
        _C.SAME_COUNTS,
        "time for which frames have identical counts on all axes",
        _P.SENSOR,
        "limits.frozen_after_ms",
    ),
    rows.stop(
        _C.NO_NEW_FRAME, "duration of the cycles without a new frame", _P.SENSOR, "limits.still_after_ms"
    ),
    rows.stop(
        _C.DEAD_AXIS,
        "the main axis of the controlled force has not changed after the zero while another "
        "changed by a tenth of its range; or the moments show 10 N across the approach that "
        "unverified force axes do not",
        _P.SENSOR,
    ),
    rows.stop(
        _C.JUMP,
        "the reported position moved more than 1 mm at more than 1.5 times the path velocity",
        _P.POSE,
        "robot.velocity_mm_s",
    ),
    rows.stop(
        _C.FOLLOWING,
        "distance between the reported and the commanded position",
        _P.POSE,
        "limits.following_error_mm",
    ),
    rows.stop(
        _C.TILT,
        "angle between the reported and the ordered orientation, less what the robot may still lag behind",
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
        "distance that a pressing tool went deeper without a change of the force by one count or "
        "2 mN; or beyond what force, stiffness and a slope of 45° explain, if an error of that "
        "size could exceed the limit",
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
        "pause of the computer, or duration of a decision",
        _P.COMPUTER,
        "limits.cycle_deadline_ms",
    ),
    rows.stop(
        _C.INCONSISTENT, "depth and position of a command contradict each other; this is a bug", _P.PROGRAM
    ),
    rows.stop(
        _C.WITNESS,
        "sustained difference between the force sensor and the robot's own force, if the robot reports one",
        _P.SENSOR,
        "limits.witness_n",
        "limits.witness_ms",
        words=f"{_SENSOR}, or something that touches {_ROBOT} beside the sensor",
        where="the sensor's reading when the tool is pressed by hand; hoses and cables of the tool; "
        "then the axes and the zero of the robot's own force",
    ),
    rows.stop(
        _C.LOST_WEIGHT,
        "a sustained pull while the tool moves through free space: the sensor has lost the tool's weight",
        _P.SENSOR,
        "limits.weight_tolerance_n",
        where=rows.FREELY,
    ),
    rows.stop(
        _C.UNCHANGED,
        "distance that the tool moved through free space while frames have identical counts on all axes",
        _P.SENSOR,
        "limits.unchanged_mm",
        "limits.stale_after_ms",
    ),
    rows.stop(
        _C.OFF_PATH,
        "distance along the approach between the reported position and all positions ordered "
        "within 1.5 times the robot's response time",
        _P.POSE,
        "limits.path_error_mm",
    ),
    rows.stop(
        _C.CONTROLLER,
        "the controller raised an exception, or returned a value that is not a number, or a "
        "position beyond the workspace plus the total correction",
        _P.CONTROLLER,
    ),
    rows.stop(
        _C.STEP_CODE,
        "a program's step raised an exception, or returned a position that is not a number",
        _P.PLUGIN_CODE,
    ),
    rows.stop(
        _C.STEP_TROUBLE,
        "a plug-in's step reports that it cannot continue",
        _P.PATH,
        "task.step",
        words="the object of the step, as the step itself reports",
        where="its settings in task.step, and the position at which the step began",
    ),
    rows.stop(
        _C.OSCILLATION,
        "the force continues to oscillate at the minimum gain",
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
        "a force from behind met the tool, in addition to any that was present when the retraction began",
        "limits.pull_limit_n",
    ),
    _stands(
        _C.RETRACT_OVER,
        "the force from the side exceeded its limit during a retraction that began within it",
        "limits.force_limit_n",
    ),
    _stands(
        _C.RETRACT_RISE,
        "a force from the side rose while the tool retracted, after a grace period if it was in "
        "contact; or one from the front rose during the second, slow attempt",
        "limits.retract_rise_n",
        "limits.retract_grace_ms",
    ),
    _stands(
        _C.RETRACT_STAYS,
        "the force stayed above its limit although the reported position had retracted by this "
        "distance; for one from the front, during the second attempt and beyond the start",
        "limits.force_limit_n",
        "limits.resultant_limit_n",
        "limits.unanswered_mm",
    ),
)
"""Conditions for which the supervisor stops a run."""

CLAMPS: tuple[CauseRow, ...] = (
    _clamp(
        _C.BARRIER,
        "depth beyond which the force is predicted to exceed its limit less the margin, by the "
        "larger of estimated and expected stiffness",
        "limits.force_limit_n",
        "limits.force_margin_share",
        "task.expected_stiffness_n_m",
        part=_P.CONTACT,
    ),
    _clamp(
        _C.OVERDUE,
        "motion into the surface while the sensor's next frame is later than its period plus "
        "10.5 ms of transmission; continues with that frame",
        part=_P.SENSOR,
    ),
    _clamp(_C.DEEPER, "motion into the surface faster than allowed", "limits.correction_mm_s"),
    _clamp(_C.TOTAL, "total depth beyond the start", "limits.correction_total_mm"),
    _clamp(_C.ACROSS, "motion across the approach faster than allowed", "limits.travel_mm_s"),
    _clamp(_C.WORKSPACE, "a position outside the workspace", *rows.WORKSPACE),
    _clamp(_C.TURN, "a program rotates the tool faster than allowed", "limits.turn_deg_s"),
    _clamp(_C.TIP, "a program tilts the tool's axis farther than allowed", "limits.turn_total_deg"),
    _clamp(
        _C.GAIN,
        "the force oscillates for too long: the controller's corrections are reduced",
        "limits.oscillation_guard",
        "oscillation.peaks",
        "oscillation.window_ms",
        "oscillation.notch",
        part=_P.CONTACT,
    ),
    _clamp(
        _C.RETRACT_WAITS,
        "a force from the front rose, or stayed above its limit, while the tool retracted: it "
        "waits, and continues if the force rises meanwhile, otherwise it tries once more at 1 "
        "mm/s",
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
        "without a valid force, the tool retracts at 2.75 mm/s to the depth of the start, or "
        "slightly beyond the contact, and no farther",
        "limits.stale_after_ms",
        "limits.blind_retract_mm",
        part=_P.SENSOR,
        when=_W.RETRACTION,
    ),
)
"""Conditions for which the supervisor clamps a command. Only the workspace clamps a retraction."""
