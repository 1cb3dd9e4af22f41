"""The one table of causes: a row for each way in which a run is refused, held back, stopped or ended. Rows of the
guard stand in `guard_rows`.

`hil-bridge list conditions`, the page of safety, `config explain`, `why`, the report and the exit codes read it.
Supervisor, task and shell alone decide; the table tells what their decisions mean.
"""

from collections.abc import Mapping
from typing import Any

from hil_bridge.errors.cause_row import (
    COMPLETED,
    CONFIGURATION,
    FREELY,
    INTERRUPTED,
    PART_WORDS,
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
_PRESS = (
    "whether the sensor's reading follows a press by hand; then whether the robot goes where it is ordered to"
)
_ROBOT, _SENSOR = PART_WORDS[_P.ROBOT], PART_WORDS[_P.SENSOR]


def _refused(cause: Cause, condition: str, part: Part, *settings: str, **more: Any) -> CauseRow:
    return CauseRow(cause, condition, settings, part, _W.BEFORE_MOTION, _R.REFUSED, **more)


def _lift(cause: Cause, condition: str, part: Part, *settings: str, **more: Any) -> CauseRow:
    return CauseRow(cause, condition, settings, part, _W.LIFT, _R.STANDS, **more)


BEFORE: tuple[CauseRow, ...] = (
    _refused(
        _C.CONFIGURATION,
        "a value, a file, a URL or a place for the outputs is wrong, or a wanted force is not below its limit",
        _P.CONFIGURATION,
        "task.force_n",
        "limits.force_limit_n",
        exit_code=CONFIGURATION,
    ),
    _refused(
        _C.UNKNOWN_TOOL,
        "a real sensor whose tool is not known, unless an operator takes that on",
        _P.CONFIGURATION,
        "tool.mass_kg",
        "sensor.unchecked",
        exit_code=CONFIGURATION,
    ),
    _refused(
        _C.START,
        "the robot stands more than 1 mm outside the workspace, or the path of a program leaves it",
        _P.PATH,
        *WORKSPACE,
        exit_code=CONFIGURATION,
    ),
    _refused(
        _C.START_TURNED,
        "a resumed run's tool is turned from the start of the recorded run",
        _P.POSE,
        "limits.tilt_deg",
        exit_code=CONFIGURATION,
    ),
    _refused(
        _C.ROBOT_NOT_READY,
        "the robot does not answer; or its status shows a stop, a mode in which it takes no orders, or an invalid "
        "orientation",
        _P.ROBOT,
    ),
    _refused(
        _C.STREAM,
        "the sensor does not come up, names an impossible full scale, or sends no whole frame for 5 s",
        _P.SENSOR,
    ),
    _refused(
        _C.UNSTEADY, "an axis of the sensor drifts, for 10 s", _P.SENSOR, "task.zero_change_n", where=FREELY
    ),
    _refused(
        _C.WEIGHT,
        "an axis of the sensor reads something else than the weight of the known tool",
        _P.SENSOR,
        "limits.weight_tolerance_n",
        "limits.weight_tolerance_nm",
        "tool.mass_kg",
        "tool.centre_of_gravity_mm",
    ),
    _refused(
        _C.UNVERIFIED_AXIS,
        "nothing verifies axes that carry more than a tenth of a force along the approach, or along a path where no "
        "moment shows it, and they are not waived",
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
        "the robot reports another pose than before: 0.5 mm or 0.5° from where the movement was planned",
        _P.POSE,
    ),
    _lift(
        _C.TOUCHING,
        "the force changed while the tool moved away: it was touching, or away is not away",
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
        "more force would be taken for zero",
        _P.SENSOR,
        "limits.zero_max_n",
        words=SENSOR_OR_TOUCH,
        where=FREELY,
    ),
    _lift(
        _C.ZERO_CHANGED,
        "the force changed while the zero was taken",
        _P.SENSOR,
        "task.zero_change_n",
        words=SENSOR_OR_TOUCH,
        where=FREELY,
    ),
    _lift(
        _C.ZERO_SILENT,
        "the sensor sends too few frames for a zero within 5 s, or does not stream again within 20 s of it",
        _P.SENSOR,
    ),
)
"""Looked at before the first cycle."""


ENDS: tuple[CauseRow, ...] = (
    stop(
        _C.HELD_APPROACH,
        "a clamp holds the approach, or a touch that is tested, in place",
        _P.PATH,
        words="the path, or a limit that holds it",
        where="the setting that held it, which the first symptom names, and the start of the run",
    ),
    stop(
        _C.NO_CONTACT,
        "no contact found on the way",
        _P.SURFACE,
        "task.approach_depth_limit_mm",
        "task.unverified_depth_mm",
    ),
    stop(
        _C.UNANSWERED_TOUCH,
        "a touch that the tool's weight could not vouch for: the force does not rise as the tool goes deeper",
        _P.SENSOR,
        "task.least_stiffness_n_m",
        "task.zero_change_n",
        words=SENSOR_OR_TOUCH,
        where=_PRESS,
    ),
    stop(
        _C.UNTESTED_TOUCH,
        "a touch cannot be tested, since the robot does not come to the depth ordered",
        _P.POSE,
        words=f"the position that {_ROBOT} reports, or {_SENSOR}",
        where=_PRESS,
    ),
    stop(
        _C.SURFACE_ENDED,
        "no contact found again after it was lost",
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
        "no force to retract by beyond the place to which a tool goes back without one",
        ("limits.stale_after_ms", "limits.blind_retract_mm"),
        _P.SENSOR,
        _W.RETRACTION,
        _R.STANDS,
    ),
    stop(
        _C.TOUCH, "a program's tool touches something on its way through free space", _P.OBSTACLE, "task.step"
    ),
    stop(_C.LEAVES_WORKSPACE, "a move or a search of a program leaves the workspace", _P.PATH, *WORKSPACE),
    stop(
        _C.STEP_WALL,
        "a lateral force beyond the limit of a program's step",
        _P.OBSTACLE,
        "task.step",
    ),
    stop(
        _C.NO_PROGRESS,
        "a lateral force holds the feed of a program's step",
        _P.OBSTACLE,
        "task.step",
    ),
    stop(_C.NOT_FOUND, "a program's step finds nothing to touch", _P.SURFACE, "task.step"),
    stop(
        _C.NO_EDGE,
        "a program's step finds no edge",
        _P.SURFACE,
        "task.step",
        words=f"the surface, which continues, or {_SENSOR} that does not feel its end",
        where="how far the surface reaches from where the search began, and at_most_mm of the step",
    ),
    stop(_C.NOT_THERE, "a program's tool does not come to its place", _P.POSE),
    stop(
        _C.DRIFT,
        "more force would be taken for zero between a program's strokes",
        _P.SENSOR,
        "task.step",
        words=SENSOR_OR_TOUCH,
        where=FREELY,
    ),
    stop(_C.NO_READING, "a program's zero has no force to take", _P.SENSOR, "task.step"),
    CauseRow(
        _C.TRAVELLED,
        "the way along the surface is done",
        ("task.travel_limit_mm",),
        _P.TASK,
        exit_code=COMPLETED,
    ),
    CauseRow(
        _C.TIME_IS_UP, "the time of tracking is over", ("run.duration_s",), _P.TASK, exit_code=COMPLETED
    ),
)
"""Other conditions that end a run that can still decide."""


def _always(cause: Cause, condition: str, part: Part, *settings: str, **more: Any) -> CauseRow:
    return CauseRow(cause, condition, settings, part, _W.ALWAYS, **more)


def _asked(cause: Cause, condition: str) -> CauseRow:
    return CauseRow(cause, condition, (), _P.PERSON, _W.ALWAYS, _R.RETRACTS, INTERRUPTED)


def _at_end(cause: Cause, condition: str, part: Part, *settings: str, **more: Any) -> CauseRow:
    words = SENSOR_OR_TOUCH if part is _P.SENSOR else ""
    return CauseRow(cause, condition, settings, part, _W.END, _R.LEFT, words=words, **more)


AROUND: tuple[CauseRow, ...] = (
    _always(
        _C.REFUSED_ORDER,
        "the robot refuses a point: it is ordered back, and asked again",
        _P.ROBOT,
        "limits.retract_patience_s",
        reaction=_R.RETRACTS_OR_LEFT,
    ),
    _always(
        _C.DEAD_LINK,
        "the robot does not answer an order: it is ordered back, and asked again",
        _P.ROBOT_LINK,
        "limits.retract_patience_s",
        reaction=_R.RETRACTS_OR_LEFT,
    ),
    _always(
        _C.CUT_WIRE,
        "the port, or the connection, to the robot is gone",
        _P.ROBOT_LINK,
        reaction=_R.LEFT,
    ),
    _always(
        _C.ROBOT_FAILED,
        "the code that speaks for the robot failed, or it answers what cannot be read",
        _P.ROBOT_LINK,
        reaction=_R.RETRACTS_OR_LEFT,
    ),
    _always(
        _C.SLOW_CYCLES,
        "three cycles in a row took longer, and longer than two periods: the line to the robot is slow",
        _P.ROBOT_LINK,
        "limits.cycle_max_ms",
        "run.period_ms",
        words=f"the link to {_ROBOT}, by which a cycle takes too long",
        where="the robot's cable and whatever delays its line, then limits.cycle_max_ms; `hil-bridge latency FILE` "
        "shows where the time goes",
    ),
    _always(
        _C.BUG,
        "an exception that nothing expected",
        _P.PROGRAM,
        words="the program itself or the controller",
        where="the traceback in the recording's events",
    ),
    _always(_C.OTHERS_CODE, "an exception of a plug-in's code that nothing expected", _P.OTHERS_CODE),
    _always(_C.CELL_FAILED, "the emulated cell, or the truth of it, failed", _P.CELL),
    _always(
        _C.GATE,
        "the last gate stops an order: deeper, faster, farther or turned more than may be ordered, or no pose; this is "
        "a bug",
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
        "a file of the run cannot be written, or the connection beside it ended",
        _P.COMPUTER,
        words="the outputs of the run, not a device",
        where="the disk and the place of the recording",
    ),
    _always(
        _C.CANCELLED,
        "the program that runs it cancelled the run",
        _P.PROGRAM,
        words="the program that cancelled the run",
        where="that program",
    ),
    _asked(
        _C.SIGNAL,
        "a signal that ends or stops a process, as SIGINT, SIGTERM or SIGTSTP; before the first order the run ends at "
        "once",
    ),
    _asked(_C.KEY, "an operator asks for the end with a key of the terminal"),
    _asked(_C.PAGE, "an operator asks for the end on the page in the browser"),
    _asked(_C.INTERRUPTED, "a program of a user asks for the end"),
    CauseRow(
        _C.CUT,
        "the recording ends before the run does: the process was killed, or the file is cut",
        (),
        _P.COMPUTER,
        _W.READING,
        _R.LEFT,
        INTERRUPTED,
    ),
    _at_end(_C.NOT_AWAY, "a run that went well leaves the tool deeper than the start", _P.POSE),
    _at_end(
        _C.PLACE_UNKNOWN,
        "the robot does not tell where the tool was left",
        _P.ROBOT_LINK,
    ),
    _at_end(
        _C.LEFT_PRESSING,
        "a run that went well leaves the tool with a force on it",
        _P.SENSOR,
        "limits.weight_tolerance_n",
        where=FREELY,
    ),
    _at_end(_C.LEFT_UNKNOWN, "the sensor tells no force after the retraction", _P.SENSOR, where=FREELY),
    _at_end(
        _C.LEFT_DISAGREEING,
        "the robot itself feels another force than the sensor tells after the retraction",
        _P.SENSOR,
        "limits.witness_n",
        where=FREELY,
    ),
)
"""Conditions around the cycles."""

TABLE: tuple[CauseRow, ...] = (*BEFORE, *STOPS, *CLAMPS, *ENDS, *AROUND)
"""All of them, in the order in which a run meets them."""

ROWS: Mapping[Cause, CauseRow] = {row.cause: row for row in TABLE}
"""The row of each cause."""
