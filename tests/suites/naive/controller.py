"""Integral controller in thirty lines."""

from dataclasses import dataclass, field
from typing import Any

from hil_bridge import Command, Measurement

MISTAKES = ("sign", "self", "nan", "lost", "windup")


@dataclass(frozen=True)
class NaiveController:
    """Controller that moves by the error times a gain, with a bounded integral."""

    gain_m_n: float = 2e-5
    mistake: str = ""
    seen: list[float] = field(default_factory=list, init=False, compare=False, repr=False)
    name = "naive"

    def __post_init__(self) -> None:
        if not 0.0 < self.gain_m_n < 1.0:
            raise ValueError(f"gain_m_n must be above 0, got {self.gain_m_n}")

    def initial(self) -> float:
        return 0.0

    def step(self, state: float, measurement: Measurement, reference: float) -> tuple[float, Command]:
        error = reference - measurement.force
        if not measurement.is_finite:
            move = self.gain_m_n * error if self.mistake == "nan" else 0.0
            return state, Command(measurement.commanded + move, move)
        before: Any = state
        if self.mistake == "self":
            before = sum(self.seen)
            self.seen.append(0.05 * error)
        memory = before + 0.05 * error
        if self.mistake != "windup":
            memory = max(-0.1 * abs(reference), min(0.1 * abs(reference), memory))
            if memory * error < 0.0:
                memory = 0.0
        move = self.gain_m_n * (error + memory)
        if self.mistake == "sign" and abs(error) > 2.0 * reference:
            move = -move
        if self.mistake == "lost" and not measurement.in_contact:
            move *= 20.0
        return memory, Command(measurement.commanded + move, move)
