"""Explanation of the supervisor's decision for an observation, by the control loop of a run.

Nothing is decided here. Which setting ruled is found by asking again with each setting loosened, and how far a limit
is by asking with larger and larger values.
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
from hil_bridge.site.guard.asking import Asked, Situation, middle
from hil_bridge.site.guard.margins import Margin, margins, number


@dataclass(frozen=True, slots=True)
class Explanation:
    """Decision of the loop, and its causes."""

    verdict: str
    """allow, clamp or stop."""
    cause: Cause | None
    reasons: tuple[str, ...]
    """Why less is ordered, why it stops, or why the task ends."""
    settings: tuple[str, ...]
    """The settings that decided, as `section.name = value`."""
    rows: tuple[CauseRow, ...]
    """Rows of the table of conditions."""
    then: str
    """Reaction of the tool."""
    deepest_mm: float | None
    """Deepest order that would be sent in this cycle; None if no such order is sent."""
    deepest_because: str
    """Why no deeper one."""
    margins: tuple[Margin, ...]
    """Margins, nearest first."""

    def lines(self) -> Iterator[str]:
        """Lines for a terminal."""
        yield _line("verdict", self.verdict if self.cause is None else f"{self.verdict}: {self.cause}")
        for reason in self.reasons:
            yield _line("because", reason)
        for setting in self.settings:
            yield _line("ruled by", setting)
        if self.verdict == "stop" and not self.settings:
            yield _line("ruled by", "no setting")
        yield _line("then", self.then)
        for leads in dict.fromkeys(_leads_to(row) for row in self.rows):
            yield _line("leads to", leads)
        if self.cause is not None:
            looks = (row.look.format(robot="", sensor="", recording="FILE") for row in self.rows)
            yield from (_line("look at", look) for look in dict.fromkeys(looks))
        if self.deepest_mm is not None:
            yield _line("deepest order", f"{number(self.deepest_mm)} mm: {self.deepest_because}")
        for margin in self.margins:
            yield _line(margin.name, margin.text)


def _line(name: str, text: str) -> str:
    return f"{name:<15}{text}"


def _leads_to(row: CauseRow) -> str:
    return row.reaction.value if row.exit_code is None else f"{row.reaction}, exit code {row.exit_code}"


def explain(config: Config, situation: Situation) -> Explanation:
    """Decision of a run with this configuration. Raises ConfigError for a situation that no run can be in."""
    ask = Asked(config)
    # values that follow from the configuration must stay when a setting is loosened
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
        if _without_numbers(Asked(_loosen(config, key))(situation)) != _without_numbers(decision)
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
"""Settings, with values at which they do not limit anything."""


def _loosen(config: Config, key: str) -> Config:
    """Return the configuration with one setting that limits nothing any more, without the validation of a file."""
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
        return "that of the robot's facts"
    if isinstance(value, tuple):
        return str(list(value))
    return str(value).lower() if isinstance(value, bool) else f"{value:g}"


def _without_numbers(decision: Decision) -> tuple[object, ...]:
    """Parts of a decision that a setting may change, without its numbers."""
    return decision.verdict.kind, *_causes(decision)


def _causes(decision: Decision) -> Iterator[Cause]:
    """Causes for which a decision stops, orders less, or ends an approach that is held."""
    verdict, reason = decision.verdict, decision.intent.reason
    if isinstance(verdict, Stop):
        yield verdict.reason.cause
    elif isinstance(verdict, Clamp):
        yield from dict.fromkeys(hold.cause for hold in verdict.holds)
        if reason is not None and reason.cause is Cause.HELD_APPROACH:
            yield reason.cause


def _then(decision: Decision, situation: Situation, commanded_mm: float) -> str:
    """Next reaction of the tool, in words."""
    way = round(decision.target.depth * 1e3 - commanded_mm, 6)
    depth = f"{number(decision.target.depth * 1e3)} mm"
    if decision.ended and situation.phase is not Phase.RETRACT:
        return f"the tool stands still at {depth}; the run ends"
    if decision.ended:
        still = "stands still" if isinstance(decision.verdict, Stop) else "has come as far back as it can"
        return f"the tool {still} at {depth}; the run ends"
    if decision.intent.phase is Phase.RETRACT:
        goes = f"to {depth}" if way else f"from {depth}"
        return f"the tool retracts, now {goes}; the run ends when it is back"
    if way > 0:
        return f"the tool goes deeper, to {depth}"
    return f"the tool goes back, to {depth}" if way < 0 else f"the tool stays at {depth}"


def _deepest(ask: Asked, situation: Situation, decision: Decision) -> tuple[float | None, str]:
    """Return the deepest order that would be sent, and why none is deeper."""
    if isinstance(decision.verdict, Stop) or situation.phase is Phase.RETRACT:
        return None, ""
    answer = ask(
        dataclasses.replace(situation, wanted_mm=ask.commanded_mm(situation) + 1e6, across_mm=0.0)
    ).verdict
    if not isinstance(answer, Clamp):
        return None, ""
    return answer.depth * 1e3, ", ".join(answer.reasons)
