"""Table of causes: one row for each reason why a run is refused, clamped, stopped or ended. The rows of the
supervisor are in `guard_rows`.

`hil-bridge list conditions`, the safety page, `config explain`, `why`, the report and the exit codes use this
table. It only explains: the supervisor, the task and the shell make the decisions.
"""

from collections.abc import Mapping
from typing import Any

from hil_bridge.errors.cause_row import (
    COMPLETED,
    CONFIGURATION,
    FREELY,
    INTERRUPTED,
    PART_DESCRIPTIONS,
    SENSOR_OR_TOUCH,
    WORKSPACE,
    CauseRow,
    Reaction,
    When,
    stop,
)
from hil_bridge.errors.causes import Cause, Part
from hil_bridge.errors.guard_rows import CLAMPS, STOPS

_C, _P, _W, _R = Cause, Part, When, Reaction
_PRESS = "whether the sensor's reading follows a push by hand; then whether the robot follows its orders"
_ROBOT, _SENSOR = PART_DESCRIPTIONS[_P.ROBOT], PART_DESCRIPTIONS[_P.SENSOR]


def _refused(cause: Cause, condition: str, part: Part, *settings: str, **more: Any) -> CauseRow:
    return CauseRow(cause, condition, settings, part, _W.BEFORE_MOTION, _R.REFUSED, **more)


def _lift(cause: Cause, condition: str, part: Part, *settings: str, **more: Any) -> CauseRow:
    return CauseRow(cause, condition, settings, part, _W.LIFT, _R.STANDS, **more)


BEFORE: tuple[CauseRow, ...] = (
    _refused(
        _C.CONFIGURATION,
        "a value, a file, a URL or an output path is invalid, or a target force is not below its limit",
        _P.CONFIGURATION,
        "task.force_n",
        "limits.force_limit_n",
        exit_code=CONFIGURATION,
    ),
    _refused(
        _C.UNKNOWN_TOOL,
        "tool load unknown with a real sensor, and not waived by `sensor.unchecked`",
        _P.CONFIGURATION,
        "tool.mass_kg",
        "sensor.unchecked",
        exit_code=CONFIGURATION,
    ),
    _refused(
        _C.START,
        "the robot is more than 1 mm outside the workspace, or the path of a program leaves it",
        _P.PATH,
        *WORKSPACE,
        exit_code=CONFIGURATION,
    ),
    _refused(
        _C.START_TURNED,
        "the tool of a resumed run is rotated relative to the start of the recorded run",
        _P.POSE,
        "limits.tilt_deg",
        exit_code=CONFIGURATION,
    ),
    _refused(
        _C.ROBOT_NOT_READY,
        "the robot does not answer; or its status shows a stop, a mode in which it accepts no "
        "orders, or an invalid orientation",
        _P.ROBOT,
    ),
    _refused(
        _C.STREAM,
        "the sensor does not start, reports an impossible full scale, or sends no complete frame for 5 s",
        _P.SENSOR,
    ),
    _refused(
        _C.UNSTEADY, "an axis of the sensor drifts, for 10 s", _P.SENSOR, "task.zero_change_n", where=FREELY
    ),
    _refused(
        _C.WEIGHT,
        "an axis of the sensor does not read the weight of the known tool",
        _P.SENSOR,
        "limits.weight_tolerance_n",
        "limits.weight_tolerance_nm",
        "tool.mass_kg",
        "tool.centre_of_gravity_mm",
    ),
    _refused(
        _C.UNVERIFIED_AXIS,
        "axes that carry more than a tenth of a force along the approach, or along a path where "
        "no moment shows it, are neither verified nor waived",
        _P.CONFIGURATION,
        "tool.mass_kg",
        "limits.weight_tolerance_n",
        "sensor.verified",
        "sensor.unverified",
        "sensor.unchecked",
        exit_code=CONFIGURATION,
    ),
    _refused(
        _C.MOVED_BEFORE,
        "the reported pose has changed by 0.5 mm or 0.5° since the movement was planned",
        _P.POSE,
    ),
    _lift(
        _C.TOUCHING,
        "the force changed while the tool moved away: it was already in contact, or "
        "`frame.approach` points the wrong way",
        _P.SENSOR,
        "task.zero_lift_mm",
        "task.zero_change_n",
        words=SENSOR_OR_TOUCH,
        where=FREELY,
    ),
    _lift(
        _C.LIFT_FOLLOW,
        "the reported position does not follow each small step",
        _P.POSE,
        "task.zero_step_mm",
    ),
    _lift(_C.LIFT_STATE, "the robot's status shows a stop", _P.ROBOT),
    _lift(
        _C.ZERO,
        "the force to be zeroed exceeds the limit",
        _P.SENSOR,
        "limits.zero_max_n",
        words=SENSOR_OR_TOUCH,
        where=FREELY,
    ),
    _lift(
        _C.ZERO_CHANGED,
        "the force changed during zeroing",
        _P.SENSOR,
        "task.zero_change_n",
        words=SENSOR_OR_TOUCH,
        where=FREELY,
    ),
    _lift(
        _C.ZERO_SILENT,
        "the sensor sends too few frames for a zero within 5 s, or does not resume streaming "
        "within 20 s after it",
        _P.SENSOR,
    ),
)
"""Conditions that are checked before the first cycle."""


ENDS: tuple[CauseRow, ...] = (
    stop(
        _C.HELD_APPROACH,
        "a clamp keeps the approach, or the test of a touch, from advancing",
        _P.PATH,
        words="the path, or a limit that holds it",
        where="the limiting setting, which the first symptom names, and the start of the run",
    ),
    stop(
        _C.NO_CONTACT,
        "no contact during the approach",
        _P.SURFACE,
        "task.approach_depth_limit_mm",
        "task.unverified_depth_mm",
    ),
    stop(
        _C.UNANSWERED_TOUCH,
        "a touch along unverified axes: the force does not rise as the tool goes deeper",
        _P.SENSOR,
        "task.least_stiffness_n_m",
        "task.zero_change_n",
        words=SENSOR_OR_TOUCH,
        where=_PRESS,
    ),
    stop(
        _C.UNTESTED_TOUCH,
        "a touch cannot be tested because the robot does not reach the ordered depth",
        _P.POSE,
        words=f"the position that {_ROBOT} reports, or {_SENSOR}",
        where=_PRESS,
    ),
    stop(
        _C.SURFACE_ENDED,
        "contact was not regained after it was lost",
        _P.SURFACE,
        "task.search_depth_limit_mm",
    ),
    stop(_C.CONTACT_LOST, "contact was lost too often", _P.SURFACE, "task.loss_limit", "task.loss_ms"),
    CauseRow(
        _C.RETRACT_BORDER,
        "the workspace ends before the tool is retracted",
        WORKSPACE,
        _P.PATH,
        _W.RETRACTION,
        _R.STANDS,
    ),
    CauseRow(
        _C.RETRACT_BLIND,
        "without a force reading, the tool retracts no farther than this",
        ("limits.stale_after_ms", "limits.blind_retract_mm"),
        _P.SENSOR,
        _W.RETRACTION,
        _R.STANDS,
    ),
    stop(
        _C.TOUCH,
        "the tool touches something during a program's move through free space",
        _P.OBSTACLE,
        "task.step",
    ),
    stop(_C.LEAVES_WORKSPACE, "a move or a search of a program leaves the workspace", _P.PATH, *WORKSPACE),
    stop(
        _C.STEP_WALL,
        "a lateral force above the limit of a program's step",
        _P.OBSTACLE,
        "task.step",
    ),
    stop(
        _C.NO_PROGRESS,
        "a lateral force blocks the feed of a program's step",
        _P.OBSTACLE,
        "task.step",
    ),
    stop(_C.NOT_FOUND, "a program's step finds no contact", _P.SURFACE, "task.step"),
    stop(
        _C.NO_EDGE,
        "a program's step finds no edge",
        _P.SURFACE,
        "task.step",
        words=f"the surface, which continues, or {_SENSOR} that does not feel its end",
        where="the extent of the surface from the start of the search, and at_most_mm of the step",
    ),
    stop(_C.NOT_THERE, "the tool does not reach the target of a program's move", _P.POSE),
    stop(
        _C.DRIFT,
        "the force to be zeroed between a program's strokes exceeds the limit",
        _P.SENSOR,
        "task.step",
        words=SENSOR_OR_TOUCH,
        where=FREELY,
    ),
    stop(_C.NO_READING, "no force reading for the zero of a program", _P.SENSOR, "task.step"),
    CauseRow(
        _C.TRAVELLED,
        "the path along the surface is complete",
        ("task.travel_limit_mm",),
        _P.TASK,
        exit_code=COMPLETED,
    ),
    CauseRow(
        _C.TIME_IS_UP, "the tracking time has elapsed", ("run.duration_s",), _P.TASK, exit_code=COMPLETED
    ),
)
"""Other conditions that end a run while its control loop still works."""


def _always(cause: Cause, condition: str, part: Part, *settings: str, **more: Any) -> CauseRow:
    return CauseRow(cause, condition, settings, part, _W.ALWAYS, **more)


def _requested(cause: Cause, condition: str) -> CauseRow:
    return CauseRow(cause, condition, (), _P.PERSON, _W.ALWAYS, _R.RETRACTS, INTERRUPTED)


def _at_end(cause: Cause, condition: str, part: Part, *settings: str, **more: Any) -> CauseRow:
    words = SENSOR_OR_TOUCH if part is _P.SENSOR else ""
    return CauseRow(cause, condition, settings, part, _W.END, _R.LEFT, words=words, **more)


AROUND: tuple[CauseRow, ...] = (
    _always(
        _C.REFUSED_ORDER,
        "the robot refuses a point: a retraction is ordered, and repeated",
        _P.ROBOT,
        "limits.retract_patience_s",
        reaction=_R.RETRACTS_OR_LEFT,
    ),
    _always(
        _C.DEAD_LINK,
        "the robot does not answer an order: a retraction is ordered, and repeated",
        _P.ROBOT_LINK,
        "limits.retract_patience_s",
        reaction=_R.RETRACTS_OR_LEFT,
    ),
    _always(
        _C.CUT_WIRE,
        "the port or the connection to the robot is lost",
        _P.ROBOT_LINK,
        reaction=_R.LEFT,
    ),
    _always(
        _C.ROBOT_FAILED,
        "the code of the robot's link failed, or the robot's answer is invalid",
        _P.ROBOT_LINK,
        reaction=_R.RETRACTS_OR_LEFT,
    ),
    _always(
        _C.SLOW_CYCLES,
        "three consecutive cycles took longer than this and than two periods: the line to the robot is slow",
        _P.ROBOT_LINK,
        "limits.cycle_max_ms",
        "run.period_ms",
        words=f"the link to {_ROBOT}, by which a cycle takes too long",
        where="the robot's cable and whatever delays its line, then limits.cycle_max_ms; `hil-bridge latency FILE` "
        "shows where the time goes",
    ),
    _always(
        _C.BUG,
        "an unexpected exception",
        _P.PROGRAM,
        words="the program itself or the controller",
        where="the traceback in the recording's events",
    ),
    _always(_C.PLUGIN_CODE, "an unexpected exception in plug-in code", _P.PLUGIN_CODE),
    _always(_C.CELL_FAILED, "the emulated cell, or its ground truth, failed", _P.CELL),
    _always(
        _C.GATE,
        "the last gate stops an order that exceeds a limit of depth, speed, distance or "
        "rotation, or is not a pose; this is a bug",
        _P.PROGRAM,
        "limits.correction_total_mm",
        "limits.correction_mm_s",
        "limits.travel_mm_s",
        *WORKSPACE,
        "limits.turn_deg_s",
        "limits.turn_total_deg",
        reaction=_R.RETRACTS_OR_LEFT,
    ),
    _always(
        _C.OUTPUT,
        "a file of the run cannot be written, or the connection of an output ended",
        _P.COMPUTER,
        words="the outputs of the run, not a device",
        where="the disk and the path of the recording",
    ),
    _always(
        _C.CANCELLED,
        "the program that runs it cancelled the run",
        _P.PROGRAM,
        words="the program that cancelled the run",
        where="that program",
    ),
    _requested(
        _C.SIGNAL,
        "a signal that ends or stops a process, such as SIGINT, SIGTERM or SIGTSTP; before the "
        "first order the run ends at once",
    ),
    _requested(_C.KEY, "an operator requests the end with a key of the terminal"),
    _requested(_C.PAGE, "an operator requests the end on the page in the browser"),
    _requested(_C.INTERRUPTED, "a user's program requests the end"),
    CauseRow(
        _C.CUT,
        "the recording ends before the run does: the process was killed, or the file is truncated",
        (),
        _P.COMPUTER,
        _W.READING,
        _R.LEFT,
        INTERRUPTED,
    ),
    _at_end(_C.NOT_AWAY, "the tool is deeper than the start after a successful run", _P.POSE),
    _at_end(
        _C.PLACE_UNKNOWN,
        "the robot does not report the final position of the tool",
        _P.ROBOT_LINK,
    ),
    _at_end(
        _C.LEFT_PRESSING,
        "a force remains on the tool after a successful run",
        _P.SENSOR,
        "limits.weight_tolerance_n",
        where=FREELY,
    ),
    _at_end(_C.LEFT_UNKNOWN, "the sensor reports no force after the retraction", _P.SENSOR, where=FREELY),
    _at_end(
        _C.LEFT_DISAGREEING,
        "the robot's own force differs from the sensor's after the retraction",
        _P.SENSOR,
        "limits.witness_n",
        where=FREELY,
    ),
)
"""Conditions outside the control cycles."""

TABLE: tuple[CauseRow, ...] = (*BEFORE, *STOPS, *CLAMPS, *ENDS, *AROUND)
"""All rows, in the order in which a run checks their conditions."""

ROWS: Mapping[Cause, CauseRow] = {row.cause: row for row in TABLE}
"""Rows by cause."""
