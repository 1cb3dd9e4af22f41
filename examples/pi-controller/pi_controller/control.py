"""PI controller in position form. Its integral follows what was actually commanded, so it does not wind up."""

import math
from dataclasses import dataclass, fields
from typing import Any, ClassVar, NamedTuple

from hil_bridge import Command, Measurement
from hil_bridge.control.types import Tuning
from protocol.marks import SettingError


class State(NamedTuple):
    """Memory between samples; immutable."""

    anchor: float | None = None
    """Commanded position at the first sample in contact, m; None before contact."""
    integral: float = 0.0
    """Integral part of the command, m."""
    wanted: float = 0.0
    """Position requested by the law at the previous sample, m, before its own limit and the guard's limits."""


@dataclass(frozen=True, slots=True)
class PiTracking:
    """PI with a tracking integral: x = x_0 + K_p·e + ∫ (K_i·e + (x_commanded − x) / T_t) dt, e = f_d − f.

    If the limit of a step or the guard holds the command back, x_commanded differs from x. The second term of the
    integral then removes the part that could not be used. Source: Åström and Hägglund, PID Controllers, 1995, section
    3.5.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}
    name: ClassVar[str] = "pi-tracking"
    sample_ms: ClassVar[float] = 180.0
    tunings: ClassVar[tuple[Tuning, ...]] = tuple(
        Tuning(cycle_ms, {"proportional_mm_n": 0.0, "integral_mm_ns": 2.0, "tracking_time_s": 0.05})
        for cycle_ms in (4.0, 12.0)
    )

    proportional_mm_n: float = 0.04
    """K_p, mm/N: a fifth of the distance that a missing force requires on a surface of 5000 N/m."""
    integral_mm_ns: float = 0.4
    """K_i, mm/(N·s)."""
    tracking_time_s: float = 0.36
    """T_t, s: time in which the integral forgets what was not commanded. Two samples."""
    step_limit_mm: float = 1.0
    """Maximum motion of the command per sample, in either direction, mm."""

    def __post_init__(self) -> None:
        for parameter in fields(self):
            value = getattr(self, parameter.name)
            least = 0.0 if parameter.name == "proportional_mm_n" else 1e-9
            if not (isinstance(value, (int, float)) and math.isfinite(value) and value >= least):
                raise SettingError(parameter.name, f"must be a number of at least {least:g}, got {value}")

    def initial(self) -> State:
        """Return the state before the first sample in contact."""
        return State()

    def step(self, state: State, measurement: Measurement, reference: float) -> tuple[State, Command]:
        """Return command and state for one sample; a non-finite sample moves nothing and keeps the state.

        Raises ValueError for a reference that is not above 0 N.
        """
        if not (math.isfinite(reference) and reference > 0.0):
            raise ValueError(f"the desired force must be above 0 N, got {reference}")
        commanded = measurement.commanded
        if not measurement.is_finite:
            return state, Command(commanded, 0.0)
        if state.anchor is None:
            state = State(commanded, 0.0, commanded)
        anchor, error = state.anchor or 0.0, reference - measurement.force
        forgotten = min(measurement.dt / self.tracking_time_s, 1.0) * (commanded - state.wanted)
        integral = state.integral + self.integral_mm_ns * 1e-3 * error * measurement.dt + forgotten
        wanted = anchor + self.proportional_mm_n * 1e-3 * error + integral
        limit = self.step_limit_mm * 1e-3
        correction = min(max(wanted - commanded, -limit), limit)
        notes = {"integral_m": integral, "forgotten_m": forgotten}
        return State(anchor, integral, wanted), Command(commanded + correction, correction, explanation=notes)
