"""Faults of a controller: wrong responses for a limited time. Pure, so that a replay gives the same responses."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from emulators.faults import FOREVER, Fault, Parameter
from hil_bridge.control.types import Command, Controller, Measurement

CONTROLLER = "controller"
"""Target of controller faults. No emulated device has them: a campaign wraps the run's controller in a faulty
controller.
"""

CONTROLLER_FAULTS: Mapping[str, Fault] = {
    "huge": Fault(
        "it answers with one finite huge position",
        {"m": Parameter(5e14, "that position", -1e300, 1e300, "m")},
        FOREVER,
    ),
    "tiny": Fault(
        "it answers with a position close to 0",
        {"m": Parameter(1e-300, "that position", -1e-3, 1e-3, "m")},
        FOREVER,
    ),
    "deeper": Fault(
        "it answers with a deeper position than it should",
        {"mm": Parameter(2.0, "by how much", -1000.0, 1000.0, "mm")},
        FOREVER,
    ),
    "alternating": Fault(
        "its answers are alternately too deep and too high",
        {"mm": Parameter(2.0, "by how much", 0.0, 1000.0, "mm")},
        FOREVER,
    ),
    "late": Fault(
        "it answers with its position of some samples ago",
        {"samples": Parameter(5, "how many", 1, 50)},
        FOREVER,
    ),
}
"""Kinds of controller faults, by name."""


class LyingState(Struct, frozen=True):
    """State of the correct controller and of the fault."""

    inner: Any
    began_at: float | None = None
    """Time of the first sample, s."""
    count: int = 0
    answers: tuple[float, ...] = ()
    """Newest correct positions, oldest first, m."""


@dataclass(frozen=True, slots=True)
class LyingController:
    """Wrapper that replaces the correct controller's response for `for_s`, beginning `after_s` after its first
    sample.
    """

    inner: Controller[Any]
    lie: str
    values: Mapping[str, float]
    """Parameters of the fault, as defined in `CONTROLLER_FAULTS`."""
    after_s: float
    for_s: float
    sample_ms: float

    @property
    def name(self) -> str:
        """Name that consists of the correct controller and the fault."""
        return f"{self.inner.name}, {self.lie}"

    def initial(self) -> LyingState:
        """Return the state before the first sample in contact."""
        return LyingState(self.inner.initial())

    def step(
        self, state: LyingState, measurement: Measurement, reference: float
    ) -> tuple[LyingState, Command]:
        """Return the state and the response for one sample."""
        inner, command = self.inner.step(state.inner, measurement, reference)
        began = measurement.time if state.began_at is None else state.began_at
        kept = int(self.values.get("samples", 0)) + 1
        answers = (*state.answers, command.position)[-kept:]
        after = LyingState(inner, began, state.count + 1, answers)
        if self.after_s <= measurement.time - began < self.after_s + self.for_s:
            command = replace(command, position=self._instead(after))
        return after, command

    def _instead(self, state: LyingState) -> float:
        """Return the faulty position, m."""
        honest = state.answers[-1]
        match self.lie:
            case "huge" | "tiny":
                return self.values["m"]
            case "deeper":
                return honest + self.values["mm"] * 1e-3
            case "alternating":
                return honest + self.values["mm"] * (1e-3 if state.count % 2 else -1e-3)
            case _:
                return state.answers[0]
