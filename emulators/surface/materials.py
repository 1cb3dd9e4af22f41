"""Materials of a surface: a spring, a spring with hysteresis, or a spring that relaxes.

Depths and speeds are along the normal, positive into the material. Forces are positive outward and never negative,
because there is no adhesion.
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
"""Depth below which a dent counts as recovered, m, because complete recovery would take forever."""


class MaterialKind(StrEnum):
    """Kind of material law."""

    LINEAR = "linear"
    """Linear spring and damper."""
    HUNT_CROSSLEY = "hunt_crossley"
    """Spring that hardens with depth, damped in proportion to its force, so that contact starts and ends without a
    jump. It can relax.
    """
    STANDARD_LINEAR_SOLID = "standard_linear_solid"
    """Spring parallel to a Maxwell element. It relaxes at a constant depth and recovers slowly."""


@dataclass(frozen=True, slots=True)
class MaterialProfile:
    """Material of the surface, without its stiffness."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    kind: MaterialKind = setting(
        MaterialKind.LINEAR, Mark.CHOSEN, "material law: linear, hunt_crossley or standard_linear_solid"
    )
    exponent: float = setting(1.5, Mark.ASSUMED, "exponent of the depth (hunt_crossley)", between(1.0, 10.0))
    reference_depth_mm: float = setting(
        2.0,
        Mark.CHOSEN,
        "depth at which the force equals the force of a linear spring of the same stiffness (hunt_crossley)",
        above(0.0),
        unit="mm",
    )
    dissipation_s_m: float = setting(
        2.0,
        Mark.ASSUMED,
        "fraction of the spring's force that each m/s of approach adds (hunt_crossley)",
        at_least(0.0),
        unit="s/m",
    )
    maxwell_share: float = setting(
        0.5,
        Mark.ASSUMED,
        "ratio of the Maxwell spring's stiffness to the stiffness of the other spring (standard_linear_solid)",
        between(0.0, 1000.0),
    )
    relaxation_share: float = setting(
        0.0,
        Mark.CHOSEN,
        "share of the force that is lost at a constant depth (hunt_crossley)",
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
        """Return the material law for a stiffness in N/m and, for a linear material, a damping in N·s/m."""
        match self.kind:
            case MaterialKind.LINEAR:
                return Linear(stiffness, damping)
            case MaterialKind.HUNT_CROSSLEY:
                spring = HuntCrossley(
                    stiffness, self.exponent, self.reference_depth_mm / 1000.0, self.dissipation_s_m
                )
                if self.relaxation_share == 0.0:
                    return spring
                return RelaxingSpring(spring, self.relaxation_share, self.relaxation_time_ms / 1000.0)
            case MaterialKind.STANDARD_LINEAR_SOLID:
                return StandardLinearSolid(stiffness, self.maxwell_share, self.relaxation_time_ms / 1000.0)


@dataclass(frozen=True, slots=True)
class Memory:
    """State of a material that results from its past. The default is the state of a material that was never touched."""

    time: float = -math.inf
    """Time of the newest sample, s."""
    dent: float = 0.0
    """Depth of the dent, m, which the tip holds or which is recovering."""
    strain: float = 0.0
    """Strain of the Maxwell element's spring, m."""
    relaxed: float = 0.0
    """Force that a spring has lost by relaxation, N, at a stiffness factor of 1."""


class Material(Protocol):
    """Material law, which gives the force as a function of the depth."""

    @property
    def has_memory(self) -> bool:
        """Whether the force depends on the past. The law then needs every sample with its time."""

    def press(
        self, depth: Floats, approach: Floats, factor: Floats | float, times: Floats | None, memory: Memory
    ) -> tuple[Floats, Memory]:
        """Return forces (n,), N, for depth, m, and its rate of change, m/s. `factor` scales the stiffness.

        `times` (n,) are in ascending order, s. Raises ValueError if they are missing and the material has a memory.
        """


@dataclass(frozen=True, slots=True)
class Linear:
    """Linear spring and damper: f = k·d + c·ḋ while in contact."""

    stiffness: float
    """Stiffness k, N/m."""
    damping: float
    """Damping c, N·s/m."""
    has_memory: ClassVar[bool] = False

    def press(
        self, depth: Floats, approach: Floats, factor: Floats | float, times: Floats | None, memory: Memory
    ) -> tuple[Floats, Memory]:
        pressing: Floats = self.stiffness * factor * depth + self.damping * approach
        pressing[~(depth > 0.0)] = 0.0
        return np.maximum(pressing, 0.0, out=pressing), memory


@dataclass(frozen=True, slots=True)
class HuntCrossley:
    """Hunt-Crossley law: f = k'·dⁿ + λ·dⁿ·ḋ with λ = k'·a and k' = k·d₀^(1−n).

    The force at the reference depth is therefore k·d₀.
    Source: Hunt and Crossley, Coefficient of restitution interpreted as damping in vibroimpact, 1975.
    """

    stiffness: float
    """Stiffness k, N/m."""
    exponent: float
    """Exponent n, dimensionless."""
    reference_depth: float
    """Reference depth d₀, m."""
    dissipation: float
    """Dissipation a, s/m."""
    has_memory: ClassVar[bool] = False

    def press(
        self, depth: Floats, approach: Floats, factor: Floats | float, times: Floats | None, memory: Memory
    ) -> tuple[Floats, Memory]:
        return self.with_damping(self.spring(depth), approach, factor), memory

    def spring(self, depth: Floats) -> Floats:
        """Return the force (n,) of the spring without damping, N."""
        relative = np.maximum(depth, 0.0) / self.reference_depth
        force: Floats = self.stiffness * self.reference_depth * relative**self.exponent
        return force

    def depth(self, force: float) -> float:
        """Return the depth at which the spring without damping has this force, m."""
        share = force / (self.stiffness * self.reference_depth)
        return self.reference_depth * float(share ** (1.0 / self.exponent))

    def with_damping(self, spring: Floats, approach: Floats, factor: Floats | float) -> Floats:
        """Return the force (n,) that results from a spring force (n,) and damping, N."""
        pressing = spring * factor * (1.0 + self.dissipation * approach)
        return np.maximum(pressing, 0.0, out=pressing)


def _require_times(times: Floats | None) -> Floats:
    """Return the times of the samples. Raises ValueError if they are missing."""
    if times is None:
        raise ValueError("a material with memory needs the times of the samples")
    return times


def _decay_over_steps(times: Floats, memory: Memory, time_constant: float) -> tuple[Floats, Floats]:
    """Return the share of the earlier strain that remains in the step to each sample.

    The first result is the share at the end of the step, and the second is the average share.
    """
    steps = np.maximum(np.diff(times, prepend=memory.time), 0.0) / time_constant
    means = np.ones_like(steps)
    np.divide(-np.expm1(-steps), steps, out=means, where=steps > 0.0)
    return np.exp(-steps), means


@dataclass(frozen=True, slots=True)
class RelaxingSpring:
    """Spring that relaxes: f = e − s with the spring force e and ṡ = (g·e − s)/τ.

    At a constant depth, s tends to g·e. This is the quasi-linear law of soft tissue with one time constant; with a
    linear spring, it is the standard linear solid. A tip that retracts faster than the material follows leaves a
    dent where e = s. The dent recovers with the time constant τ/(1 − g). The result is exact if e is linear between
    samples. As in the standard linear solid, the memory moves with the tip. Source: Fung, Biomechanics, Mechanical
    Properties of Living Tissues, section 7.6.
    """

    spring: HuntCrossley
    share: float
    """Share g of the spring force that relaxes, dimensionless."""
    relaxation_time: float
    """Relaxation time τ, s."""
    has_memory: ClassVar[bool] = True

    def press(
        self, depth: Floats, approach: Floats, factor: Floats | float, times: Floats | None, memory: Memory
    ) -> tuple[Floats, Memory]:
        times = _require_times(times)
        time = max(memory.time, float(times[-1]))
        if memory.dent == 0.0 and not (depth > 0.0).any():
            return np.zeros_like(depth), Memory(time)
        keeps, means = _decay_over_steps(times, memory, self.relaxation_time)
        share, relaxed, forces = self.share, memory.relaxed, []
        before = float(self.spring.spring(np.array([memory.dent]))[0])
        gone = float(self.spring.spring(np.array([_LEVEL_M]))[0])
        pressed = self.spring.spring(depth).tolist()
        for elastic, keep, mean in zip(pressed, keeps.tolist(), means.tolist(), strict=True):
            # The relaxed force at the end of a step is a part independent of the new e, plus a share of it.
            part, own = keep * relaxed + share * before * (mean - keep), share * (1.0 - mean)
            free = part / (1.0 - own)
            force = (1.0 - own) * (elastic - free) if elastic > free else 0.0
            before = max(elastic, free)
            relaxed = before - force
            forces.append(force)
            if before < gone:
                before = relaxed = 0.0
        dent = self.spring.depth(before) if before else 0.0
        return self.spring.with_damping(np.array(forces), approach, factor), Memory(
            time, dent, relaxed=relaxed
        )


@dataclass(frozen=True, slots=True)
class StandardLinearSolid:
    """Standard linear solid: f = k·s + k₁·e with dent s, k₁ = share·k and strain e of the Maxwell spring.

    The strain follows ė = ṡ − e/τ.

    While the tip is in contact, s is its depth. A tip that retracts faster than the material follows leaves a dent,
    which recovers at f = 0 with the time constant τ·(1 + share). No force acts on the tip until it is below the
    dent.

    Force and strain are exact if the depth is linear between samples, however the samples are divided into blocks.
    Assumed: the memory moves with the tip, as if the dent were dragged along and no fresh material came under it.
    """

    stiffness: float
    """Stiffness k, N/m."""
    share: float
    """Stiffness ratio k₁/k, dimensionless."""
    relaxation_time: float
    """Relaxation time τ, s."""
    has_memory: ClassVar[bool] = True

    def press(
        self, depth: Floats, approach: Floats, factor: Floats | float, times: Floats | None, memory: Memory
    ) -> tuple[Floats, Memory]:
        times = _require_times(times)
        time = max(memory.time, float(times[-1]))
        if memory.dent == 0.0 and not (depth > 0.0).any():
            return np.zeros_like(depth), Memory(time)
        # Over a step h, the share exp(-h/τ) of the strain remains, and g times the growth of the dent is added.
        keeps, gains = _decay_over_steps(times, memory, self.relaxation_time)
        share, dent, strain, forces = self.share, memory.dent, memory.strain, []
        for sunk, keep, gain in zip(depth.tolist(), keeps.tolist(), gains.tolist(), strict=True):
            rigid = 1.0 + share * gain
            # The force is k·(1 + share·g)·(depth − free), where `free` is the dent at zero force.
            free = share * (gain * dent - keep * strain) / rigid
            forces.append(rigid * (sunk - free) if sunk > free else 0.0)
            before, dent = dent, max(sunk, free)
            strain = keep * strain + gain * (dent - before)
            if dent < _LEVEL_M:
                dent = strain = 0.0
        return self.stiffness * factor * np.array(forces), Memory(time, dent, strain)
