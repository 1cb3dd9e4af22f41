"""The steps of a program in a summary, and in the lines that an operator reads at the end of a run."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

from hil_bridge.record.records import StepRecord

WHOLE_REPEAT = 6
"""Chosen: a repeat with no more steps than this, passes counted, is told whole."""
FAILED_SHOWN = 10
"""Chosen: most failed steps of one repeat that get a line each."""
CUT = "CUT"
"""Verdict on a step that did not end as it was meant to."""


@dataclass(frozen=True, slots=True)
class StepOutcome:
    """One step of a program, in figures. None stands for what it does not have."""

    number: int
    """Its number, passes counted, from 1."""
    label: str
    """Its number as it stands in the program, and its word."""
    seconds: float
    way_mm: float
    """Way along its path."""
    force_mean_n: float | None
    within: float | None
    """Share of the way for which the force was as near as its criterion wants."""
    wanted: float | None
    """Share that its criterion wants; None where it has no criterion."""
    passed: bool
    """It ended as it was meant to, and met its criterion if it has one."""
    name: str
    """Name of the place that it found; empty for none."""
    found_mm: tuple[float, ...] | None
    """That place, base frame."""
    text: str
    """How it ended, in words."""
    repeat: int = 0
    """Number of the repeat that it belongs to; 0 for none."""
    turn: int = 0
    """Its pass in that repeat, from 1; 0 for none."""

    @property
    def criterion_failed(self) -> bool:
        """Whether it has a criterion that was not met; a step that was cut may have met its own until then."""
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
    """Which criteria were not met, in one line; empty where all were."""
    failed = [step for step in steps if step.criterion_failed]
    if not failed:
        return ""
    if len(failed) == 1:
        return f"criterion failed in step {failed[0].label}: {failed[0].text}"
    named = ", ".join(step.label for step in failed[:FAILED_SHOWN])
    more = len(failed) - FAILED_SHOWN
    return f"criterion failed in {len(failed)} steps: {named}{f' and {more} more' if more > 0 else ''}"


def step_lines(steps: Sequence[StepOutcome]) -> list[str]:
    """Return a line for each step; of a repeat with many, for its first pass, its last and what failed."""
    width = max((len(step.label) for step in steps), default=0)
    shown = _choose_rows(steps)
    lines = []
    for told, places in groupby(range(len(steps)), key=shown.__contains__):
        some = [steps[place] for place in places]
        if told or len(some) == 1:
            lines += [f"  step {step.label:<{width}}  {step_text(step)}" for step in some]
        else:
            failed = sum(not step.passed for step in some)
            lines.append(
                f"  … {len(some)} steps more, {f'{failed} of them FAILED' if failed else 'all done'}"
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
    if step.text and verdict != CUT:  # why it was cut is told as the cause of the stop
        verdict = f"{verdict}: {step.text}" if verdict else step.text
    return ", ".join([*parts, verdict] if verdict else parts)


def verdict_of(step: StepOutcome) -> str:
    """Return the result of a step; empty for one that ended as intended and has no criterion."""
    if step.passed:
        return "criterion passed" if step.wanted is not None else ""
    return "criterion FAILED" if step.criterion_failed else CUT


def _choose_rows(steps: Sequence[StepOutcome]) -> set[int]:
    """Places of the steps that get a line."""
    shown: set[int] = set()
    repeats: dict[int, list[tuple[int, int]]] = {}
    for place, step in enumerate(steps):
        if step.repeat:
            repeats.setdefault(step.repeat, []).append((place, step.turn))
        else:
            shown.add(place)
    for places in repeats.values():
        ends = places[0][1], places[-1][1]
        failed = [place for place, _ in places if not steps[place].passed]
        shown.update(place for place, turn in places if len(places) <= WHOLE_REPEAT or turn in ends)
        shown.update(failed[:FAILED_SHOWN])
    return shown
