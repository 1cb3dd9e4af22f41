"""The word `repeat`, which repeats a group of steps. It is not a step itself: a program is a sequence of steps,
with each pass unrolled.
"""

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
    """Largest number of passes."""
    step: tuple[SimpleStep, ...]
    do: Literal["repeat"] = "repeat"
    until_removed_mm: float | None = None
    """Removed depth that ends the repeat: no further pass once the tracks lie deeper than in the first pass by this
    much, on average. Default: all passes.
    """
    limits: StepLimits = field(default=NO_LIMITS, repr=False)

    def __post_init__(self) -> None:
        if not 1 <= self.times <= 1000:
            raise SettingError("times", f"must be 1 … 1000, got {self.times}")
        if not self.step:
            raise SettingError("step", "must hold at least one step")
        if self.limits != NO_LIMITS:
            raise SettingError("limits", "must be set in the steps of the repeat")
        above_zero(self, "until_removed_mm")
        if self.until_removed_mm is not None and not any(step.do == "track" for step in self.step):
            raise SettingError("until_removed_mm", "needs a track among the steps")


class Pass(NamedTuple):
    """Position of a step in the passes of a repeat."""

    leave_to: int | None = None
    """Index of the leg after the repeat, at the last leg of a pass; None at any other leg."""
    removed: float | None = None
    """Removed depth at which the repeat ends, m; None if all passes are made."""
    is_first: bool = False
    """Whether this is the first leg of the first pass, from which the depths are measured."""
    number: int = 0
    """Number of the repeat to which the step belongs, for the operator; 0 outside a repeat."""
    turn: int = 0
    """Number of the pass in the repeat, from 1; 0 outside a repeat."""


ALONE = Pass()
"""Default pass of a step outside any repeat."""


def unroll(steps: tuple[Step, ...]) -> Iterator[tuple[str, Step, Pass]]:
    """Return each step of each pass, with its number for the operator."""
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
