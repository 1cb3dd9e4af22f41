"""The word `repeat`: the same steps several times. It is no step itself: a program is a row of the steps in it."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar, Literal, NamedTuple

from hil_bridge.control.checks import FORBID_EXTRA
from hil_bridge.control.steps.kinds import SimpleStep
from hil_bridge.control.steps.seam import NO_LIMITS, Step, StepLimits, above_zero
from protocol.marks import SettingError


@dataclass(frozen=True, slots=True)
class Repeat(Step):
    """The same steps several times."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    times: int
    """Passes, at most."""
    step: tuple[SimpleStep, ...]
    do: Literal["repeat"] = "repeat"
    until_removed_mm: float | None = None
    """No further pass once the tracks lie deeper than in the first pass by this much, on average. Nothing: all passes.
    """
    limits: StepLimits = field(default=NO_LIMITS, repr=False)

    def __post_init__(self) -> None:
        if not 1 <= self.times <= 1000:
            raise SettingError("times", f"must be 1 … 1000, got {self.times}")
        if not self.step:
            raise SettingError("step", "must hold at least one step")
        if self.limits != NO_LIMITS:
            raise SettingError("limits", "must stand in the steps of the repeat")
        above_zero(self, "until_removed_mm")
        if self.until_removed_mm is not None and not any(step.do == "track" for step in self.step):
            raise SettingError("until_removed_mm", "needs a track among the steps")


class Pass(NamedTuple):
    """Place of a step in the passes of a repeat."""

    leave_to: int | None = None
    """Number of the leg behind the repeat, at the last leg of a pass; None elsewhere."""
    removed: float | None = None
    """Depth removed, m, at which the repeat is left there; None where all passes are made."""
    is_first: bool = False
    """The first leg of the first pass: the depths are counted from here."""
    number: int = 0
    """Number of the repeat that it belongs to, for the operator; 0 for none."""
    turn: int = 0
    """Its pass in that repeat, from 1; 0 for none."""


ALONE = Pass()
"""A step in no repeat."""


def unroll(steps: tuple[Step, ...]) -> Iterator[tuple[str, Step, Pass]]:
    """Each step of each pass, with its number as an operator counts."""
    count = 0
    for number, step in enumerate(steps, 1):
        if not isinstance(step, Repeat):
            yield f"{number}", step, ALONE
            count += 1
            continue
        inner = len(step.step)
        behind = count + step.times * inner
        removed = None if step.until_removed_mm is None else step.until_removed_mm * 1e-3
        for turn in range(step.times):
            for place, one in enumerate(step.step):
                last, first = place == inner - 1, not turn and not place
                leave_to = behind if last else None
                yield f"{number}.{place + 1}", one, Pass(leave_to, removed, first, number, turn + 1)
                count += 1
