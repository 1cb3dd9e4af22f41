"""Stored programs with effect: lines to move along and times to wait, in sequence.

Assumed throughout: the language of real S3 programs is not public. A program whose contents begin with the line
`# emulated program` is text for this emulator. Any other one, with contents of a real controller or none, is one
instruction with a duration given by the profile.

    # emulated program
    move 900 -100 650 100   # to x y z in mm at mm/s, straight, orientation unchanged
    wait 1.5                # s
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from emulators.arm.waypoints import WaypointArm
from protocol.geometry import Vector

FIRST_LINE = "# emulated program"
STEP_LIMIT = 65535
"""Maximum number of steps in a program: each instruction number must fit its word in the status."""


@dataclass(frozen=True, slots=True)
class MoveStep:
    """Straight line to a point."""

    position: Vector
    """Tool centre point in the base frame, m."""
    speed: float
    """Speed, m/s, above 0."""


@dataclass(frozen=True, slots=True)
class WaitStep:
    """Wait for a time."""

    seconds: float
    """Duration, s."""


Step: TypeAlias = MoveStep | WaitStep


def read_steps(content: bytes) -> tuple[Step, ...] | None:
    """Return the steps of a program; None if the program was not written for the emulator.

    Raises ValueError that names the line.
    """
    head, _, rest = content.partition(b"\n")
    if head.rstrip() != FIRST_LINE.encode():
        return None
    steps: list[Step] = []
    for number, line in enumerate(rest.decode("utf-8", "replace").splitlines(), 2):
        parts = line.partition("#")[0].split()
        if not parts:
            continue
        try:
            values = [float(word) for word in parts[1:]]
        except ValueError:
            values = [math.nan]
        match parts[0], values:
            case "wait", [seconds] if 0.0 <= seconds < math.inf:
                steps.append(WaitStep(seconds))
            case "move", [x, y, z, speed] if 0.0 < speed < math.inf and all(map(math.isfinite, (x, y, z))):
                steps.append(MoveStep((x / 1000.0, y / 1000.0, z / 1000.0), speed / 1000.0))
            case _:
                raise ValueError(
                    f"line {number}: expected `move X Y Z SPEED` in mm and mm/s or `wait S`, got {line.strip()!r}"
                )
    if not 0 < len(steps) <= STEP_LIMIT:
        raise ValueError(f"a program must have 1 to {STEP_LIMIT} steps, got {len(steps)}")
    return tuple(steps)


class ProgramRun:
    """Execution of a program in steps. After a stop it continues with the interrupted step."""

    def __init__(self, number: int, steps: tuple[Step, ...]) -> None:
        self.number = number
        self.due: float | None = None
        """Time of the current step's next check, s; None while the program does not run."""
        self._steps = steps
        self._index = 0
        self._begun = False

    @property
    def instruction(self) -> int:
        """Number of the current step, from 1; after the end of the program, the number of the last step."""
        return min(self._index + 1, len(self._steps))

    @property
    def ended(self) -> bool:
        """Whether every step is complete."""
        return self._index >= len(self._steps)

    def start(self, now: float) -> None:
        """Run from the start of the current step."""
        self.due, self._begun = now, False

    def stop(self) -> None:
        """Stop the program. Assumed: an interrupted step is repeated from its start."""
        self.due = None

    def advance(self, now: float, motion: WaypointArm, move: Callable[[MoveStep, float], None]) -> None:
        """Execute the steps that are due by `now`. `move` starts a motion; if it raises an exception, the step is
        not started.
        """
        while self.due is not None and self.due <= now:
            if self.ended:
                self.due = None
                return
            step = self._steps[self._index]
            if not self._begun:
                if isinstance(step, MoveStep):
                    move(step, now)
                    self.due = motion.next_tick()
                else:
                    self.due += step.seconds
                self._begun = True
            elif isinstance(step, MoveStep) and motion.waiting(now):
                self.due = motion.next_tick()
            else:
                self._index += 1
                self._begun = False
