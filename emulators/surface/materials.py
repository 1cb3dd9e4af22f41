"""Materials of a surface: a spring, a spring with hysteresis, or one that relaxes.

Depths and speeds are along the outward normal, positive into the material; forces are positive outward and
never negative, for nothing sticks.
"""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from protocol.marks import Mark, above, at_least, between, check_settings, setting

Floats = NDArray[np.float64]

_LEVEL_M = 1e-12
"""A dent shallower than this has gone: the material would take for ever to come back entirely."""


class MaterialKind(StrEnum):
    """Laws of materials."""

    LINEAR = "linear"
    """Spring and damper."""
    HUNT_CROSSLEY = "hunt_crossley"
    """Spring that hardens with depth, damped in proportion to its force: begins and ends without a jump. Can relax."""
    STANDARD_LINEAR_SOLID = "standard_linear_solid"
    """Spring parallel to a Maxwell element: relaxes under a constant depth and comes back slowly."""


@dataclass(frozen=True, slots=True)
class MaterialProfile:
    """Material of the surface, beside its stiffness."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    kind: MaterialKind = setting(
        MaterialKind.LINEAR, Mark.CHOSEN, "its law: linear, hunt_crossley or standard_linear_solid"
    )
    exponent: float = setting(1.5, Mark.ASSUMED, "power of the depth (hunt_crossley)", between(1.0, 10.0))
    reference_depth_mm: float = setting(
        2.0,
        Mark.CHOSEN,
        "depth at which the force is that of a linear spring of the same stiffness (hunt_crossley)",
        above(0.0),
        unit="mm",
    )
    dissipation_s_m: float = setting(
        2.0,
        Mark.ASSUMED,
        "share of the spring's force that each m/s of approach adds (hunt_crossley)",
        at_least(0.0),
        unit="s/m",
    )
    maxwell_share: float = setting(
        0.5,
        Mark.ASSUMED,
        "stiffness of the Maxwell element's spring over that of the other one (standard_linear_solid)",
        between(0.0, 1000.0),
    )
    relaxation_share: float = setting(
        0.0,
        Mark.CHOSEN,
        "share of its force that it loses at a constant depth (hunt_crossley)",
        between(0.0, 0.99),
    )
    relaxation_time_ms: float = setting(
        500.0,
        Mark.ASSUMED,
        "time constant of the relaxation at a constant depth (standard_linear_solid, hunt_crossley)",
        above(0.0),
        unit="ms",
    )

    def __post_init__(self) -> None:
        check_settings(self)

    def law(self, stiffness: float, damping: float) -> "Material":
        """Return the material with a stiffness in N/m and a damping in N·s/m; only a linear one has the latter."""
        match self.kind:
            case MaterialKind.LINEAR:
                return Linear(stiffness, damping)
            case MaterialKind.HUNT_CROSSLEY:
                spring = HuntCrossley(
                    stiffness, self.exponent, self.reference_depth_mm / 1000.0, self.dissipation_s_m
                )
                if self.relaxation_share == 0.0:
                    return spring
                return Relaxing(spring, self.relaxation_share, self.relaxation_time_ms / 1000.0)
            case MaterialKind.STANDARD_LINEAR_SOLID:
                return StandardLinearSolid(stiffness, self.maxwell_share, self.relaxation_time_ms / 1000.0)


@dataclass(frozen=True, slots=True)
class Memory:
    """State of a material by its past. The default is a material without a past, or one that was never touched."""

    time: float = -math.inf
    """Time of the newest sample, s."""
    dent: float = 0.0
    """Depth of the surface, m, held there by the tip or on its way back."""
    strain: float = 0.0
    """Strain of the Maxwell element's spring, m."""
    relaxed: float = 0.0
    """Force that a spring has lost by relaxing, N, where the stiffness has the factor 1."""


class Material(Protocol):
    """A law from depth to force."""

    @property
    def has_memory(self) -> bool:
        """Whether the force depends on the past: then every sample must be shown, with its time."""

    def press(
        self, depth: Floats, approach: Floats, factor: Floats | float, times: Floats | None, memory: Memory
    ) -> tuple[Floats, Memory]:
        """Return forces (n,), N, for depth, m, and its rate of change, m/s; `factor` scales the stiffness.

        `times` (n,) ascend, s. Raises ValueError when they are missing and the material has a memory.
        """


@dataclass(frozen=True, slots=True)
class Linear:
    """f = k·d + c·ḋ while in contact."""

    stiffness: float
    """k, N/m."""
    damping: float
    """c, N·s/m."""
    has_memory: ClassVar[bool] = False

    def press(
        self, depth: Floats, approach: Floats, factor: Floats | float, times: Floats | None, memory: Memory
    ) -> tuple[Floats, Memory]:
        pressing: Floats = self.stiffness * factor * depth + self.damping * approach
        pressing[~(depth > 0.0)] = 0.0
        return np.maximum(pressing, 0.0, out=pressing), memory


@dataclass(frozen=True, slots=True)
class HuntCrossley:
    """f = k'·dⁿ + λ·dⁿ·ḋ; k' = k·d₀^(1−n), so that the force at the reference depth is k·d₀, and λ = k'·a.

    Source: Hunt and Crossley, Coefficient of restitution interpreted as damping in vibroimpact, 1975.
    """

    stiffness: float
    """k, N/m."""
    exponent: float
    """n, without unit."""
    reference_depth: float
    """d₀, m."""
    dissipation: float
    """a, s/m."""
    has_memory: ClassVar[bool] = False

    def press(
        self, depth: Floats, approach: Floats, factor: Floats | float, times: Floats | None, memory: Memory
    ) -> tuple[Floats, Memory]:
        return self.damped(self.spring(depth), approach, factor), memory

    def spring(self, depth: Floats) -> Floats:
        """Force (n,) of the spring alone, N."""
        relative = np.maximum(depth, 0.0) / self.reference_depth
        force: Floats = self.stiffness * self.reference_depth * relative**self.exponent
        return force

    def depth(self, force: float) -> float:
        """Depth at which the spring alone has a force, m."""
        share = force / (self.stiffness * self.reference_depth)
        return self.reference_depth * float(share ** (1.0 / self.exponent))

    def damped(self, spring: Floats, approach: Floats, factor: Floats | float) -> Floats:
        """Force (n,) of a spring (n,) with the damping, N."""
        pressing = spring * factor * (1.0 + self.dissipation * approach)
        return np.maximum(pressing, 0.0, out=pressing)


def _require_times(times: Floats | None) -> Floats:
    """Return the times of the samples. Raises ValueError where there are none."""
    if times is None:
        raise ValueError("a material with memory must be told the times of the samples")
    return times


def _relaxing(times: Floats, memory: Memory, time_constant: float) -> tuple[Floats, Floats]:
    """Shares of the earlier strain that stay in each step to a sample: at its end, and as the mean over it."""
    steps = np.maximum(np.diff(times, prepend=memory.time), 0.0) / time_constant
    means = np.ones_like(steps)
    np.divide(-np.expm1(-steps), steps, out=means, where=steps > 0.0)
    return np.exp(-steps), means


@dataclass(frozen=True, slots=True)
class Relaxing:
    """f = e − s with the force e of a spring that hardens, and ṡ = (g·e − s)/τ: at a constant depth s comes to g·e.

    This is the quasi-linear law of soft tissue with one time constant; with a linear spring it is the standard linear
    solid. A tip that leaves faster than the material follows leaves a dent where e = s. It goes with the time constant
    τ/(1 − g). Exact where e is linear between samples. As of that solid, the memory travels with the tip.
    Source: Fung, Biomechanics, Mechanical Properties of Living Tissues, section 7.6.
    """

    spring: HuntCrossley
    share: float
    """g, without unit."""
    relaxation_time: float
    """τ, s."""
    has_memory: ClassVar[bool] = True

    def press(
        self, depth: Floats, approach: Floats, factor: Floats | float, times: Floats | None, memory: Memory
    ) -> tuple[Floats, Memory]:
        times = _require_times(times)
        time = max(memory.time, float(times[-1]))
        if memory.dent == 0.0 and not (depth > 0.0).any():
            return np.zeros_like(depth), Memory(time)
        keeps, means = _relaxing(times, memory, self.relaxation_time)
        share, relaxed, forces = self.share, memory.relaxed, []
        before = float(self.spring.spring(np.array([memory.dent]))[0])
        gone = float(self.spring.spring(np.array([_LEVEL_M]))[0])
        pressed = self.spring.spring(depth).tolist()
        for elastic, keep, mean in zip(pressed, keeps.tolist(), means.tolist(), strict=True):
            # The relaxed force at the end of a step is a part without e, and a share of the new e.
            part, own = keep * relaxed + share * before * (mean - keep), share * (1.0 - mean)
            free = part / (1.0 - own)
            force = (1.0 - own) * (elastic - free) if elastic > free else 0.0
            before = max(elastic, free)
            relaxed = before - force
            forces.append(force)
            if before < gone:
                before = relaxed = 0.0
        dent = self.spring.depth(before) if before else 0.0
        return self.spring.damped(np.array(forces), approach, factor), Memory(time, dent, relaxed=relaxed)


@dataclass(frozen=True, slots=True)
class StandardLinearSolid:
    """f = k·s + k₁·e with dent s, k₁ = share·k, and ė = ṡ − e/τ for the strain e of the Maxwell spring.

    While the tip is in contact s is its depth. A tip that leaves faster than the material follows leaves a dent that
    goes by f = 0, with the time constant τ·(1 + share). It meets no force before it is below the dent.

    Exact for a depth that is linear between samples; so is the strain, whatever the blocks. Assumed: the
    memory travels with the tip, as if the dent were dragged along and no fresh material came under it.
    """

    stiffness: float
    """k, N/m."""
    share: float
    """k₁/k, without unit."""
    relaxation_time: float
    """τ, s."""
    has_memory: ClassVar[bool] = True

    def press(
        self, depth: Floats, approach: Floats, factor: Floats | float, times: Floats | None, memory: Memory
    ) -> tuple[Floats, Memory]:
        times = _require_times(times)
        time = max(memory.time, float(times[-1]))
        if memory.dent == 0.0 and not (depth > 0.0).any():
            return np.zeros_like(depth), Memory(time)
        # Over a step h the strain keeps exp(-h/τ) of itself and gains g of the growth of the dent.
        keeps, gains = _relaxing(times, memory, self.relaxation_time)
        share, dent, strain, forces = self.share, memory.dent, memory.strain, []
        for sunk, keep, gain in zip(depth.tolist(), keeps.tolist(), gains.tolist(), strict=True):
            rigid = 1.0 + share * gain
            # The force is k·(1 + share·g)·(depth − free): free is the dent without force.
            free = share * (gain * dent - keep * strain) / rigid
            forces.append(rigid * (sunk - free) if sunk > free else 0.0)
            before, dent = dent, max(sunk, free)
            strain = keep * strain + gain * (dent - before)
            if dent < _LEVEL_M:
                dent = strain = 0.0
        return self.stiffness * factor * np.array(forces), Memory(time, dent, strain)
