"""Table of checks that stop a run, compared with the rows that describe their causes."""

from hil_bridge.control.course.stop_checks import CHECKS, check_forces, check_sensor
from hil_bridge.errors.cause_row import When
from hil_bridge.errors.causes import Cause
from hil_bridge.errors.guard_rows import STOPS

CHECKED_ELSEWHERE = {
    Cause.WITNESS,
    Cause.LOST_WEIGHT,
    Cause.UNCHANGED,
    Cause.CONTROLLER,
    Cause.STEP_CODE,
    Cause.STEP_TROUBLE,
    Cause.OSCILLATION,
    Cause.OFF_PATH,
}
"""Causes of a stop that need more than one cycle, or that other code checks."""


ROWS = [row.cause for row in STOPS if row.when is not When.RETRACTION and row.cause not in CHECKED_ELSEWHERE]


def test_checks_have_the_causes_of_their_rows_in_order() -> None:
    assert list(dict.fromkeys(_without_dead_axis())) == [each for each in ROWS if each is not Cause.DEAD_AXIS]


def test_dead_axis_is_detected_by_force_and_sensor_check() -> None:
    assert Cause.DEAD_AXIS in ROWS
    assert [check.find for check in CHECKS if Cause.DEAD_AXIS in check.causes] == [check_forces, check_sensor]


def _without_dead_axis() -> list[Cause]:
    return [cause for check in CHECKS for cause in check.causes if cause is not Cause.DEAD_AXIS]
