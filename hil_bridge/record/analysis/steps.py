"""Steps of a program in a summary and in the output at the end of a run."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

from hil_bridge.record.records import StepRecord

REPEAT_LISTED_MAX = 6
"""Maximum number of steps of a repeat, counting every pass, that are all listed. Chosen."""
FAILURES_LISTED_MAX = 10
"""Maximum number of failed steps of one repeat that are listed on a line each. Chosen."""
CUT = "CUT"
"""Verdict on a step that did not end as planned."""


@dataclass(frozen=True, slots=True)
class StepOutcome:
    """Result of one step of a program. None means that the value is unknown."""

    number: int
    """Number of the step, counting every pass, from 1."""
    label: str
    """Number of the step in the program, and its keyword."""
    seconds: float
    way_mm: float
    """Distance travelled along the path of the step, mm."""
    force_mean_n: float | None
    within: float | None
    """Share of the distance over which the force met the step's criterion."""
    wanted: float | None
    """Share that the criterion requires; None without a criterion."""
    passed: bool
    """Whether the step ended as planned and met its criterion, if it has one."""
    name: str
    """Name of the position that the step detected; empty if it detected none."""
    found_mm: tuple[float, ...] | None
    """Position that the step detected, base frame, mm."""
    text: str
    """Description of how the step ended."""
    repeat: int = 0
    """Number of the repeat in the program that contains the step; 0 if the step is not in a repeat."""
    turn: int = 0
    """Number of the pass of that repeat, from 1; 0 if the step is not in a repeat."""

    @property
    def criterion_failed(self) -> bool:
        """Whether the step failed its criterion. A step that was cut short may have met it until then."""
        met = self.within is not None and self.wanted is not None and self.within >= self.wanted
        return not self.passed and self.wanted is not None and not met


def step_outcomes(records: Sequence[StepRecord]) -> tuple[StepOutcome, ...]:
    """Return the steps in the order in which they ended."""
    return tuple(
        StepOutcome(
            record.step,
            record.label,
            record.at - record.began_at,
            record.way * 1e3,
            record.force_mean,
            record.within,
            record.wanted,
            record.passed,
            record.name,
            tuple(part * 1e3 for part in record.found) or None,
            record.text,
            record.repeat,
            record.turn,
        )
        for record in records
    )


def failed_criteria(steps: Sequence[StepOutcome]) -> str:
    """Return the criteria that were not met, in one line; empty if all criteria were met."""
    failed = [step for step in steps if step.criterion_failed]
    if not failed:
        return ""
    if len(failed) == 1:
        return f"criterion failed in step {failed[0].label}: {failed[0].text}"
    named = ", ".join(step.label for step in failed[:FAILURES_LISTED_MAX])
    more = len(failed) - FAILURES_LISTED_MAX
    return f"criterion failed in {len(failed)} steps: {named}{f' and {more} more' if more > 0 else ''}"


def step_lines(steps: Sequence[StepOutcome]) -> list[str]:
    """Return one line per step. For a long repeat, return only its first pass, its last pass and its failures."""
    width = max((len(step.label) for step in steps), default=0)
    rows = _choose_rows(steps)
    lines = []
    for is_listed, places in groupby(range(len(steps)), key=rows.__contains__):
        some = [steps[place] for place in places]
        if is_listed or len(some) == 1:
            lines += [f"  step {step.label:<{width}}  {step_text(step)}" for step in some]
        else:
            failed = sum(not step.passed for step in some)
            lines.append(
                f"  … {len(some)} more steps, {f'{failed} of them FAILED' if failed else 'all done'}"
            )
    return lines


def step_text(step: StepOutcome) -> str:
    """Describe a step in one line, without its label."""
    parts = [f"{step.seconds:.1f} s"]
    if step.way_mm:
        parts.append(f"{step.way_mm:.1f} mm")
    if step.force_mean_n is not None:
        parts.append(f"{step.force_mean_n:.2f} N mean")
    if step.found_mm is not None:
        x, y, z = step.found_mm
        parts.append(f"{step.name} at {x:.2f} {y:.2f} {z:.2f} mm")
    verdict = verdict_of(step)
    if step.text and verdict != CUT:  # for a cut step, the cause of the stop states the reason
        verdict = f"{verdict}: {step.text}" if verdict else step.text
    return ", ".join([*parts, verdict] if verdict else parts)


def verdict_of(step: StepOutcome) -> str:
    """Return the result of a step; empty for a step that ended as planned and has no criterion."""
    if step.passed:
        return "criterion passed" if step.wanted is not None else ""
    return "criterion FAILED" if step.criterion_failed else CUT


def _choose_rows(steps: Sequence[StepOutcome]) -> set[int]:
    """Return the indices of the steps that are listed."""
    rows: set[int] = set()
    repeats: dict[int, list[tuple[int, int]]] = {}
    for place, step in enumerate(steps):
        if step.repeat:
            repeats.setdefault(step.repeat, []).append((place, step.turn))
        else:
            rows.add(place)
    for places in repeats.values():
        ends = places[0][1], places[-1][1]
        failed = [place for place, _ in places if not steps[place].passed]
        rows.update(place for place, turn in places if len(places) <= REPEAT_LISTED_MAX or turn in ends)
        rows.update(failed[:FAILURES_LISTED_MAX])
    return rows
