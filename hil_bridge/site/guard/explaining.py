"""Explanation of the supervisor's decision about an observation, from the control loop of a run.

This module does not decide anything itself. It finds the decisive setting by repeating the query with each setting
relaxed, and the distance to a limit by queries with increasing values.
"""

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel

from hil_bridge.control import Clamp, Decision, Phase, Stop
from hil_bridge.errors.cause_row import CauseRow
from hil_bridge.errors.cause_table import ROWS
from hil_bridge.errors.causes import Cause
from hil_bridge.settings.configuration import Config
from hil_bridge.settings.devices import robot_in
from hil_bridge.site.guard.asking import LoopQuery, Situation, middle
from hil_bridge.site.guard.margins import Margin, margins, number


@dataclass(frozen=True, slots=True)
class Explanation:
    """Decision of the loop, with its causes."""

    verdict: str
    """Verdict: allow, clamp or stop."""
    cause: Cause | None
    reasons: tuple[str, ...]
    """Reasons why the order is reduced, the run stops, or the task ends."""
    settings: tuple[str, ...]
    """Decisive settings in the form `section.name = value`."""
    rows: tuple[CauseRow, ...]
    """Rows of the table of conditions that apply."""
    then: str
    """Description of the tool's next reaction."""
    deepest_mm: float | None
    """Deepest order that would be sent in this cycle, mm; None if the depth is not limited, the run stops, or the
    tool retracts.
    """
    deepest_because: str
    """Reason why no deeper order is sent."""
    margins: tuple[Margin, ...]
    """Margins of all quantities, smallest relative margin first."""

    def lines(self) -> Iterator[str]:
        """Explanation as lines for a terminal."""
        yield _line("verdict", self.verdict if self.cause is None else f"{self.verdict}: {self.cause}")
        for reason in self.reasons:
            yield _line("because", reason)
        for setting in self.settings:
            yield _line("decided by", setting)
        if self.verdict == "stop" and not self.settings:
            yield _line("decided by", "no setting")
        yield _line("then", self.then)
        for leads in dict.fromkeys(_leads_to(row) for row in self.rows):
            yield _line("leads to", leads)
        if self.cause is not None:
            checks = (row.look.format(robot="", sensor="", recording="FILE") for row in self.rows)
            yield from (_line("check", check) for check in dict.fromkeys(checks))
        if self.deepest_mm is not None:
            yield _line("deepest order", f"{number(self.deepest_mm)} mm: {self.deepest_because}")
        for margin in self.margins:
            yield _line(margin.name, margin.text)


def _line(name: str, text: str) -> str:
    return f"{name:<15}{text}"


def _leads_to(row: CauseRow) -> str:
    return row.reaction.value if row.exit_code is None else f"{row.reaction}, exit code {row.exit_code}"


def explain(config: Config, situation: Situation) -> Explanation:
    """Return the explanation of the decision of a run with this configuration. Raises ConfigError if the situation
    cannot occur in a run.
    """
    ask = LoopQuery(config)
    # values that follow from the configuration must not change when a setting is relaxed
    situation = dataclasses.replace(
        situation,
        start_m=situation.start_m or middle(config),
        commanded_mm=ask.commanded_mm(situation),
        force_n=ask.force(situation),
    )
    decision = ask(situation)
    cause = decision.verdict.reason.cause if isinstance(decision.verdict, Stop) else None
    ruled = tuple(
        key
        for key in LOOSE
        if _without_numbers(LoopQuery(_loosen(config, key))(situation)) != _without_numbers(decision)
    )
    rows = tuple(ROWS[each] for each in _causes(decision))
    robot = robot_in(config).kind
    keys = ruled or tuple(
        key
        for row in rows
        for key in (
            *row.settings,
            *(f"robot.{robot.name}.{name}" for name in robot.ruling.get(row.cause, ())),
        )
    )
    reasons = decision.reasons
    if not reasons and decision.intent.reason is not None and situation.phase is not Phase.RETRACT:
        reasons = (str(decision.intent.reason),)
    deepest, because = _deepest(ask, situation, decision)
    return Explanation(
        decision.verdict.kind,
        cause,
        reasons,
        tuple(f"{key} = {_value(config, key)}" for key in keys),
        rows,
        _then(decision, situation, ask.commanded_mm(situation)),
        deepest,
        because,
        tuple(sorted(margins(ask, situation), key=lambda margin: -margin.share)),
    )


_FAR = 1e9
LOOSE: Mapping[str, Any] = {
    **dict.fromkeys(
        (
            "limits.force_limit_n",
            "limits.pull_limit_n",
            "limits.resultant_limit_n",
            "limits.moment_limit_nm",
            "limits.against_travel_n",
            "limits.stale_after_ms",
            "limits.unanswered_mm",
            "limits.unchanged_mm",
            "limits.weight_tolerance_n",
            "limits.witness_n",
            "limits.witness_ms",
            "limits.following_error_mm",
            "limits.path_error_mm",
            "limits.tilt_deg",
            "limits.cycle_deadline_ms",
            "limits.correction_mm_s",
            "limits.correction_total_mm",
            "limits.travel_mm_s",
            "limits.retract_rise_n",
            "limits.retract_grace_ms",
            "limits.frozen_after_ms",
            "limits.still_after_ms",
            "robot.velocity_mm_s",
        ),
        _FAR,
    ),
    "limits.workspace_min_m": (-_FAR,) * 3,
    "limits.workspace_max_m": (_FAR,) * 3,
    "limits.force_margin_share": 0.0,
    "task.expected_stiffness_n_m": 1e-3,
}
"""Settings, each with a value at which it does not limit anything."""


def _loosen(config: Config, key: str) -> Config:
    """Return the configuration with one setting relaxed so that it does not limit anything. The result is not
    validated as a file would be.
    """
    section, name = key.split(".")
    before: Any = getattr(config, section)
    change = {name: LOOSE[key]}
    of_pydantic = isinstance(before, BaseModel)
    after = before.model_copy(update=change) if of_pydantic else dataclasses.replace(before, **change)
    return config.model_copy(update={section: after})


def _value(config: Config, key: str) -> str:
    value: Any = config
    for name in key.split("."):
        value = getattr(value, name)
    if value is None:
        return "from the robot's facts"
    if isinstance(value, tuple):
        return str(list(value))
    return str(value).lower() if isinstance(value, bool) else f"{value:g}"


def _without_numbers(decision: Decision) -> tuple[object, ...]:
    """Return the parts of a decision that a setting may change, without numeric values."""
    return decision.verdict.kind, *_causes(decision)


def _causes(decision: Decision) -> Iterator[Cause]:
    """Yield the causes for which a decision stops, reduces an order, or ends a suspended approach."""
    verdict, reason = decision.verdict, decision.intent.reason
    if isinstance(verdict, Stop):
        yield verdict.reason.cause
    elif isinstance(verdict, Clamp):
        yield from dict.fromkeys(hold.cause for hold in verdict.holds)
        if reason is not None and reason.cause is Cause.HELD_APPROACH:
            yield reason.cause


def _then(decision: Decision, situation: Situation, commanded_mm: float) -> str:
    """Describe the next reaction of the tool."""
    step_mm = round(decision.target.depth * 1e3 - commanded_mm, 6)
    depth = f"{number(decision.target.depth * 1e3)} mm"
    if decision.ended and situation.phase is not Phase.RETRACT:
        return f"the tool stops at {depth}; the run ends"
    if decision.ended:
        reaction = "stops" if isinstance(decision.verdict, Stop) else "cannot retract further, and stops"
        return f"the tool {reaction} at {depth}; the run ends"
    if decision.intent.phase is Phase.RETRACT:
        destination = f"to {depth}" if step_mm else f"from {depth}"
        return f"the tool retracts, now {destination}; the run ends when it is back"
    if step_mm > 0:
        return f"the tool moves deeper, to {depth}"
    return f"the tool moves back, to {depth}" if step_mm < 0 else f"the tool stays at {depth}"


def _deepest(ask: LoopQuery, situation: Situation, decision: Decision) -> tuple[float | None, str]:
    """Return the deepest order that would be sent, mm, and the reason why no deeper order is sent."""
    if isinstance(decision.verdict, Stop) or situation.phase is Phase.RETRACT:
        return None, ""
    answer = ask(
        dataclasses.replace(situation, wanted_mm=ask.commanded_mm(situation) + 1e6, across_mm=0.0)
    ).verdict
    if not isinstance(answer, Clamp):
        return None, ""
    return answer.depth * 1e3, ", ".join(answer.reasons)
