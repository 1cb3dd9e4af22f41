"""Every condition that refuses, clamps or ends a run, in one table: before the cycles, in them, and around them."""

import textwrap
from collections.abc import Iterable, Sequence

from hil_bridge.control.course.conditions import (
    CLAMPS,
    CONFIGURATION,
    ENDS,
    GATE,
    INTERRUPTED,
    STOPS,
    ConditionRow,
    Reaction,
    When,
)


def _refused(name: str, condition: str, *settings: str, exit_code: int = 3) -> ConditionRow:
    return ConditionRow(name, condition, settings, When.BEFORE_MOTION, Reaction.REFUSED, exit_code)


def _lift(name: str, condition: str, *settings: str) -> ConditionRow:
    return ConditionRow(name, condition, settings, When.LIFT, Reaction.STANDS)


BEFORE: tuple[ConditionRow, ...] = (
    _refused(
        "configuration",
        "a value, a file, a URL or a place for the outputs is wrong, or a wanted force is not below its limit",
        "task.force_n",
        "limits.force_limit_n",
        exit_code=CONFIGURATION,
    ),
    _refused(
        "unknown-tool",
        "a real sensor whose tool is not known, unless a person takes that on",
        "tool.mass_kg",
        "sensor.unchecked",
        exit_code=CONFIGURATION,
    ),
    _refused(
        "start",
        "the robot stands outside the workspace",
        "limits.workspace_min_m",
        "limits.workspace_max_m",
        exit_code=CONFIGURATION,
    ),
    _refused(
        "robot-state",
        "the robot does not answer; or its status shows emergency stop, standby that an order does not end, a key not "
        "in AUTO, link control taken back, or an orientation that is none",
        "robot.s3.link.check_flags",
    ),
    _refused(
        "stream",
        "the sensor does not come up, names an impossible full scale, or sends no whole frame for 5 s",
    ),
    _refused("unsteady", "an axis of the sensor drifts, for 10 s", "task.zero_change_n"),
    _refused(
        "weight",
        "an axis of the sensor reads something else than the weight of the known tool",
        "limits.weight_tolerance_n",
        "limits.weight_tolerance_nm",
        "tool.mass_kg",
        "tool.centre_of_gravity_mm",
    ),
    _refused(
        "unverified-axis",
        "the tool's weight does not verify an axis that the approach mainly lies on, unless a person takes that on",
        "tool.mass_kg",
        "limits.weight_tolerance_n",
        "sensor.unverified",
        "sensor.unchecked",
        exit_code=CONFIGURATION,
    ),
    _refused(
        "moved-before",
        "the robot reports another pose than before: 0.5 mm or 0.5° from where the movement was planned",
    ),
    _refused("sequence-refused", "the robot refuses to begin a movement"),
    _lift(
        "touching",
        "the force changed while the tool moved away: it was touching, or away is not away",
        "task.zero_lift_mm",
        "task.zero_change_n",
    ),
    _lift("follow", "the reported position does not follow each small step", "task.zero_step_mm"),
    _lift("lift-broken", "the robot's status shows a stop, an order is refused, or the sensor fails"),
    _lift("zero", "more force would be taken for zero", "limits.zero_max_n"),
)
"""Looked at before the first cycle."""

SHELL: tuple[ConditionRow, ...] = (
    ConditionRow(
        "refused-order",
        "the robot refuses a point: it is ordered back, and asked again",
        ("limits.retract_patience_s",),
        When.ALWAYS,
        Reaction.RETRACTS_OR_LEFT,
    ),
    ConditionRow(
        "dead-link",
        "the robot does not answer an order: it is ordered back, and asked again",
        ("robot.s3.link.answer_timeout_s", "robot.s3.link.order_timeout_s", "limits.retract_patience_s"),
        When.ALWAYS,
        Reaction.RETRACTS_OR_LEFT,
    ),
    ConditionRow(
        "cut-wire",
        "the port, or the connection, to the robot is gone",
        (),
        When.ALWAYS,
        Reaction.LEFT,
    ),
    ConditionRow(
        "slow-cycles",
        "three cycles in a row took longer, and longer than two periods: the line to the robot is slow",
        ("limits.cycle_max_ms", "run.period_ms"),
        When.ALWAYS,
        Reaction.RETRACTS,
    ),
    ConditionRow("bug", "an exception that nothing expected", (), When.ALWAYS, Reaction.RETRACTS),
    GATE,
    ConditionRow(
        "signal",
        "a signal that ends or stops a process, as SIGINT, SIGTERM or SIGTSTP; before the first order the run ends at "
        "once",
        (),
        When.ALWAYS,
        Reaction.RETRACTS,
        INTERRUPTED,
    ),
    ConditionRow(
        "left-pressing",
        "a run that went well leaves the tool deeper than the start, or with a force on it, or with one that is not "
        "known",
        ("limits.weight_tolerance_n",),
        When.END,
        Reaction.LEFT,
    ),
)
"""Conditions around the cycles."""

CONDITIONS: tuple[ConditionRow, ...] = (*BEFORE, *STOPS, *CLAMPS, *ENDS, *SHELL)
"""All of them, in the order in which a run meets them."""

HEAD = ("name", "condition", "settings", "looked at", "reaction", "exit code")
"""Head of the table, as `cells` fills it."""


def cells(row: ConditionRow) -> tuple[str, str, Sequence[str], str, str, str]:
    """A row of the table in words; the settings one by one."""
    code = "" if row.exit_code is None else str(row.exit_code)
    return row.name, row.condition, row.settings, row.when.value, row.reaction.value, code


_NAME, _WIDTH = 18, 110
"""Characters of the first column and of a line on a terminal."""


def as_text(rows: Iterable[ConditionRow] = CONDITIONS) -> Iterable[str]:
    """The table as lines for a terminal: a head for each time at which it is looked, then a paragraph a row."""
    for when in When:
        seen = [row for row in rows if row.when is when]
        if not seen:
            continue
        yield f"{when.value}:"
        for row in seen:
            name, condition, settings, _, reaction, code = cells(row)
            ends = f", exit code {code}" if code else ""
            ruled = f"; {', '.join(settings)}" if settings else ""
            for text in (f"{name:<{_NAME}}{condition}", f"{'':<{_NAME}}→ {reaction}{ends}{ruled}"):
                yield from textwrap.wrap(
                    text, _WIDTH, initial_indent="  ", subsequent_indent=" " * (_NAME + 4)
                )
        yield ""
