"""The last word before the wire: what may be sent, what is clamped, what ends the run. Pure.

Which side is safe: away from the surface. Depth may grow by no more than a little a cycle and no farther
than a total; a move that pulls back is never shortened by these, only by the workspace. A request that
leaves the workspace is cut where the straight way from the last allowed position meets its border, so the
cut position is never deeper than both ends. A stop is latched: only a new state, made by a person's
decision, ends it.
"""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar, TypeAlias

from msgspec import Struct
from msgspec.structs import replace

from hil_bridge.control.checks import require_above_zero
from hil_bridge.errors import ConfigError

Vector: TypeAlias = tuple[float, float, float]


class Cause(StrEnum):
    """Why a run was stopped."""

    NOT_A_NUMBER = "not-a-number"
    FORCE = "force"
    RESULTANT_FORCE = "resultant-force"
    SATURATED = "saturated"
    STALE = "stale"
    FROZEN = "frozen"
    SEQUENCE = "sequence"
    DEVICE = "device"
    INCONSISTENT = "inconsistent"
    CONTROLLER = "controller"
    OSCILLATION = "oscillation"


@dataclass(frozen=True, slots=True)
class Limits:
    """What is allowed. Every default is chosen, not a fact about a device: set them for the cell at hand."""

    __pydantic_config__: ClassVar = {"extra": "forbid"}

    force_limit_n: float = 50.0
    """Contact force along the approach direction, either sign, above which the run stops."""
    resultant_limit_n: float = 100.0
    """Length of the force vector above which the run stops: a collision from the side."""
    correction_per_cycle_mm: float = 2.0
    """Farthest that the command may go deeper in a cycle."""
    correction_total_mm: float = 100.0
    """Farthest that the command may be deeper than the start point."""
    travel_per_cycle_mm: float = 5.0
    """Farthest that the command may move across the approach direction in a cycle."""
    workspace_min_m: Vector = (-3.0, -3.0, -3.0)
    """Lowest corner of the box that the tool may be in, base frame."""
    workspace_max_m: Vector = (3.0, 3.0, 3.0)
    """Highest corner of that box, base frame."""
    stale_after_ms: float = 200.0
    """Age of the newest sensor frame above which the run stops."""
    frozen_after_frames: int = 400
    """Frames in a row with identical counts on all axes after which the run stops. A filtered quiet signal
    repeats itself for some frames, a dead converter for ever.
    """
    unanswered_mm: float = 2.0
    """How far a pressing tool may go deeper without the force changing by one count: more, and the axis that
    measures it is dead, while the controller presses ever harder.
    """
    oscillation_guard: bool = True
    """Lower the gain of a loop whose force swings for long, and end the run when that does not help."""
    still_after_cycles: int = 3
    """Cycles in a row without a new sensor frame after which the run stops."""

    def __post_init__(self) -> None:
        require_above_zero(
            self,
            "force_limit_n",
            "resultant_limit_n",
            "correction_per_cycle_mm",
            "correction_total_mm",
            "travel_per_cycle_mm",
            "stale_after_ms",
            "frozen_after_frames",
            "unanswered_mm",
            "still_after_cycles",
        )
        for low, high in zip(self.workspace_min_m, self.workspace_max_m, strict=True):
            if not (math.isfinite(low) and math.isfinite(high) and low < high):
                raise ValueError("workspace_min_m must be below workspace_max_m on every axis")


class Observation(Struct, frozen=True):
    """What is known of the cell in this cycle."""

    now: float
    """s on the run's clock."""
    force: float
    """Contact force along the approach direction, N, positive while pressing."""
    resultant: float
    """Length of the force vector, N."""
    sensor_at: float
    """When the newest sensor frame arrived, s on the run's clock."""
    sensor_sequence: int
    """Its frame counter, unwrapped."""
    repeated_frames: int = 0
    """How many of the newest frames in a row carried identical counts on all axes."""
    saturated: bool = False
    """True when an axis is at the end of its range, so that the force may be anything above."""
    dead_axis: str = ""
    """Which axis of the controlled force does not live, in words; empty while all do."""
    pressing: bool = False
    """Whether the tool is taken to be in contact."""
    depth: float = 0.0
    """Reported position along the approach direction from the start point, m."""
    fault: str = ""
    """What is wrong with a device, in words; empty while nothing is."""


class Request(Struct, frozen=True):
    """Where the task wants the tool."""

    depth: float
    """Along the approach direction from the start point, m."""
    position: Vector
    """The same target as a point in the base frame, m."""
    direction: Vector
    """Approach direction: unit vector into the surface, base frame."""


class Allow(Struct, frozen=True):
    """Send the request as it is."""

    kind: ClassVar[str] = "allow"
    depth: float
    position: Vector


class Clamp(Struct, frozen=True):
    """Send this instead of the request."""

    kind: ClassVar[str] = "clamp"
    depth: float
    position: Vector
    reasons: tuple[str, ...]


class Stop(Struct, frozen=True):
    """Send nothing more: end the motion."""

    kind: ClassVar[str] = "stop"
    cause: Cause
    text: str


Verdict: TypeAlias = Allow | Clamp | Stop


class SupervisorState(Struct, frozen=True):
    """Where the last allowed command was, what the sensor counted, and the stop if there was one."""

    depth: float
    """Depth allowed last, m; at the beginning that of the reported position, so 0 at the start point."""
    position: Vector
    """Position allowed last, base frame, m; at the beginning the reported one."""
    sensor_sequence: int | None = None
    still_cycles: int = 0
    """Cycles in a row without a new sensor frame."""
    pressed: tuple[float, float] | None = None
    """Contact force that has not changed since, N, and the reported depth when it was new, m; None without contact."""
    stopped: Stop | None = None


@dataclass(frozen=True, slots=True)
class Supervisor:
    """Checks every cycle's observation and request against the limits."""

    limits: Limits

    def initial(self, position: Vector, depth: float = 0.0) -> SupervisorState:
        """State for a robot that stands at this position in the base frame and at this depth, m.

        Raises ConfigError when that is outside the workspace.
        """
        box = zip(self.limits.workspace_min_m, position, self.limits.workspace_max_m, strict=True)
        if not all(low <= value <= high for low, value, high in box):
            raise ConfigError(f"the robot stands at {position} m, outside the box of limits.workspace_…_m")
        return SupervisorState(depth, position)

    def step(
        self, state: SupervisorState, observation: Observation, request: Request
    ) -> tuple[SupervisorState, Verdict]:
        """One cycle. After the first stop every answer is that stop."""
        if state.stopped is not None:
            return state, state.stopped
        still = state.still_cycles + 1 if observation.sensor_sequence == state.sensor_sequence else 0
        pressed = _pressed(state.pressed, observation)
        stop = _first_fault(self.limits, state, observation, request, still, pressed)
        if stop is not None:
            return replace(state, still_cycles=still, pressed=pressed, stopped=stop), stop
        verdict = _clamp(self.limits, state, request)
        return (
            SupervisorState(verdict.depth, verdict.position, observation.sensor_sequence, still, pressed),
            verdict,
        )

    def stop(self, state: SupervisorState, cause: Cause, text: str) -> tuple[SupervisorState, Stop]:
        """End the motion for a reason that was found elsewhere. The first stop stays."""
        stop = state.stopped or Stop(cause, text)
        return replace(state, stopped=stop), stop

    def limit(self, state: SupervisorState, request: Request) -> tuple[SupervisorState, Allow | Clamp]:
        """One cycle of pulling back, which a stop does not end: only the limits of motion hold.

        The request must be finite. A stop stays latched.
        """
        verdict = _clamp(self.limits, state, request)
        return replace(state, depth=verdict.depth, position=verdict.position), verdict


def _pressed(before: tuple[float, float] | None, observation: Observation) -> tuple[float, float] | None:
    if not observation.pressing:
        return None
    if before is None or before[0] != observation.force:
        return observation.force, observation.depth
    # Where a tool that was pulled back in between comes from does not count.
    return before[0], min(before[1], observation.depth)


def _first_fault(
    limits: Limits,
    state: SupervisorState,
    seen: Observation,
    request: Request,
    still_cycles: int,
    pressed: tuple[float, float] | None,
) -> Stop | None:
    """The first reason to end the run, None while there is none. One straight line: this runs in every cycle."""
    (x, y, z), (a, b, c), (u, v, w) = state.position, request.direction, request.position
    # A sum is a number only if all its parts are, and no part is infinite.
    of_scalars = seen.now + seen.force + seen.resultant + seen.sensor_at + seen.depth
    if not math.isfinite(
        of_scalars + request.depth + state.depth + x + y + z + a + b + c + u + v + w,
    ):
        return Stop(Cause.NOT_A_NUMBER, "a measurement or command is no number")
    if seen.fault:
        return Stop(Cause.DEVICE, seen.fault)
    force, resultant = seen.force, seen.resultant
    if abs(force) > limits.force_limit_n:
        return Stop(Cause.FORCE, f"contact force {force:.1f} N is beyond {limits.force_limit_n:g} N")
    if resultant > limits.resultant_limit_n:
        text = f"resultant force {resultant:.1f} N is beyond {limits.resultant_limit_n:g} N"
        return Stop(Cause.RESULTANT_FORCE, text)
    if seen.saturated:
        return Stop(Cause.SATURATED, "the force sensor is at the end of its range")
    age_ms = (seen.now - seen.sensor_at) * 1e3
    if not 0.0 <= age_ms <= limits.stale_after_ms:
        text = f"the newest force is {age_ms:.0f} ms old, allowed are {limits.stale_after_ms:g} ms"
        return Stop(Cause.STALE, text)
    if seen.repeated_frames >= limits.frozen_after_frames:
        text = f"the force sensor repeated the same counts {seen.repeated_frames} times"
        return Stop(Cause.FROZEN, text)
    if still_cycles >= limits.still_after_cycles:
        return Stop(Cause.FROZEN, f"no new force for {still_cycles} cycles")
    if seen.dead_axis:
        return Stop(Cause.FROZEN, seen.dead_axis)
    if pressed is not None and (deeper_mm := (seen.depth - pressed[1]) * 1e3) > limits.unanswered_mm:
        text = f"the force stayed at {force:.2f} N while the tool went {deeper_mm:.1f} mm deeper"
        return Stop(Cause.FROZEN, text)
    before = state.sensor_sequence
    if before is not None and seen.sensor_sequence < before:
        text = f"the sensor's frame counter went back from {before} to {seen.sensor_sequence}"
        return Stop(Cause.SEQUENCE, text)
    slip = abs(a * (u - x) + b * (v - y) + c * (w - z) - (request.depth - state.depth))
    if slip > _CONSISTENT or abs(math.hypot(a, b, c) - 1.0) > 1e-6:
        text = (
            f"requested depth and position differ by {slip * 1e3:.3f} mm, or the direction is no unit vector"
        )
        return Stop(Cause.INCONSISTENT, text)
    return None


def _clamp(limits: Limits, state: SupervisorState, request: Request) -> Allow | Clamp:
    """The request within the limits of motion. Written in single numbers: this runs in every cycle, and arrays of
    three would cost ten times as much.
    """
    reasons: list[str] = []
    depth, (tx, ty, tz) = request.depth, request.position
    (bx, by, bz), (nx, ny, nz) = state.position, request.direction

    deepest_now = state.depth + limits.correction_per_cycle_mm * 1e-3
    deepest = max(limits.correction_total_mm * 1e-3, state.depth)
    if depth > min(deepest_now, deepest):
        if deepest_now < deepest:
            reasons.append(f"deeper by more than {limits.correction_per_cycle_mm:g} mm in a cycle")
        else:
            reasons.append(f"deeper than {limits.correction_total_mm:g} mm in total")
        excess = depth - min(deepest_now, deepest)
        tx, ty, tz = tx - nx * excess, ty - ny * excess, tz - nz * excess
        depth = min(deepest_now, deepest)

    mx, my, mz = tx - bx, ty - by, tz - bz
    along = mx * nx + my * ny + mz * nz
    ax, ay, az = mx - nx * along, my - ny * along, mz - nz * along
    length, longest = math.hypot(ax, ay, az), limits.travel_per_cycle_mm * 1e-3
    if length > longest + _ROUNDING:
        cut = 1 - longest / length
        tx, ty, tz = tx - ax * cut, ty - ay * cut, tz - az * cut
        reasons.append(f"across by more than {limits.travel_per_cycle_mm:g} mm in a cycle")

    target: Vector = (tx, ty, tz)
    low, high = limits.workspace_min_m, limits.workspace_max_m
    if not (low[0] <= tx <= high[0] and low[1] <= ty <= high[1] and low[2] <= tz <= high[2]):
        share = min(map(_share_inside, state.position, target, low, high))
        # The last allowed position is inside; the border only takes off what the arithmetic left over.
        x, y, z = (
            min(max(before + share * (to - before), lowest), highest)
            for before, to, lowest, highest in zip(state.position, target, low, high, strict=True)
        )
        target = x, y, z
        depth = state.depth + share * (depth - state.depth)
        reasons.append("leaves the workspace")

    if not reasons:
        return Allow(depth, request.position)
    return Clamp(depth, target, tuple(reasons))


def _share_inside(before: float, target: float, low: float, high: float) -> float:
    """How much of the way from an allowed place to the target stays between the borders, on one axis."""
    if low <= target <= high:
        return 1.0
    return ((high if target > before else low) - before) / (target - before)


_ROUNDING = 1e-9
"""Slack for arithmetic, m: a clamped request that comes again must be allowed."""

_CONSISTENT = 1e-5
"""Largest difference between a request's depth and its position, m. Chosen: below any robot's resolution."""
