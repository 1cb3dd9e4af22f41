"""Measurement and command: input and output of a controller, in SI units along the approach direction.

The approach direction is a unit vector pointing from the tool into the surface. Positions grow into the surface; forces
are positive while the tool presses.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol, TypeVar

from msgspec import Struct

from hil_bridge.control.sample import Sample
from hil_bridge.errors.failures import RAISED, raise_if_interrupt

SAMPLE_MS = 180.0
"""Sample time assumed for a controller that declares none, ms. Source: the paper's setup, whose cycle takes 172 …
187 ms on the computer link at 9600 baud.
"""
POSITION_STEP_MM = 0.125
"""Default step of a robot's position, mm. Source: the position words of the paper's robot, observed."""


STREAM_SAMPLES_MS = (2.0, 4.0, 12.0)
"""Cycle times of streaming robots for which the built-in controllers have tunings, ms. Source: RTDE, EGM and RSI."""
FINE_STEP_MM = 0.01
"""Position step that a controller assumes for a robot that reports its position in fine steps, mm. Chosen: with a
smaller step, the noise of the force would count as a move.
"""


class Tuning(NamedTuple):
    """Parameters of a controller for one sample time."""

    sample_ms: float
    parameters: Mapping[str, float]
    """Parameters that differ from the defaults, by name."""


class Range(NamedTuple):
    """Range of a parameter that `hil-bridge tune` searches, including both ends, in the unit of the parameter."""

    low: float
    high: float
    by_factor: bool = False
    """Whether the search multiplies by a factor, as is usual for gains. Both ends are then above 0."""


class Measurement(Struct, frozen=True, gc=False):
    """One sample of the force-controlled direction."""

    time: float
    """Time at which the force was sampled, s on the run's clock."""
    force: float
    """Contact force along the approach direction, N, positive while pressing."""
    position: float
    """Position that the robot controller reports, along the approach direction, m."""
    commanded: float
    """Position commanded in the previous cycle, after clamping by the supervisor, m."""
    in_contact: bool = True
    """False before the first contact and after a contact loss."""
    paired_force: float | None = None
    """Force that acted when the robot controller composed `position`, N: the other half of a force–position pair.
    None if no force older than `force` is known.
    """
    travel: float = 0.0
    """Reported position along the surface, at the same time as `position`, relative to the start point, m."""
    travel_next: float = 0.0
    """Position along the surface that will be commanded together with the controller's response, m."""
    free_position: float | None = None
    """Reported position in the newest sample before the current contact, m; None if there was no such sample."""
    advance: float = 1.0
    """Share of a step along the travel direction that moves the tool by one full step along the surface."""
    saturated: bool = False
    """Whether an axis of the sensor is at the end of its range. If so, the force may have any larger value."""
    dt: float = SAMPLE_MS * 1e-3
    """Time since the previous sample, s, at most twice the controller's sample time. For the first sample it is the
    sample time.
    """
    against: float = 0.0
    """Contact force against the motion along the path, N; 0 in free space if there is none."""
    sample: Sample | None = None
    """Complete sample with wrench, pose, ages and states; None if a controller is tried without a run."""

    @property
    def is_finite(self) -> bool:
        """Whether all forces and positions are finite."""
        # The sum is finite only if all its terms are.
        return math.isfinite(self.force + (self.paired_force or 0.0) + self.position + self.commanded)

    @property
    def force_at_position(self) -> float:
        """Force that corresponds to `position`, N: the paired force if known, otherwise the newest force."""
        return self.force if self.paired_force is None else self.paired_force


class Command(Struct, frozen=True, gc=False):
    """Response of a controller to one sample."""

    position: float
    """Position to command along the approach direction, m, before rounding to the robot's resolution."""
    correction: float
    """Correction that the feedback law added, m, positive into the surface."""
    stiffness: float | None = None
    """Estimate of the contact stiffness, N/m; None if the controller has none."""
    gain: float = 1.0
    """Factor that an adaptation applied to the feedback law's output."""
    held: bool = False
    """Whether the controller is in its dead band, so that no reachable position is nearer to the target."""
    explanation: dict[str, float] = {}
    """Additional numbers that explain the response, by name, for the recording (quantised levels, for example)."""
    across: float = 0.0
    """Displacement along the third direction of the work frame that this sample adds, m. It is limited to the speed
    of the travel, `task.speed_mm_s`. It is ignored in a program, which sets the path itself.
    """
    turn: float = 0.0
    """Rotation of the tool that this sample adds, rad, about the third direction of the work frame. A positive
    rotation tilts the tool's axis towards the travel. It is used if the orientation of the step is `led`, and never
    faster or farther than the supervisor's limits allow.
    """


class ControllerFailed(Exception):
    """Failure of a controller: either an exception, which is its cause, or a response that is not a command."""


def begin(controller: "Controller[Any]") -> Any:
    """Return the state of a controller before the first sample in contact. Raises ControllerFailed for any
    exception.
    """
    try:
        return controller.initial()
    except RAISED as error:
        raise_if_interrupt(error)
        raise ControllerFailed from error


def ask(
    controller: "Controller[Any]", memory: Any, measurement: Measurement, reference: float
) -> tuple[Any, Command]:
    """Return the state and command from a controller's step, converted by `as_command`. Raises ControllerFailed for
    any exception, and for an invalid response.
    """
    try:
        answer: Any = controller.step(memory, measurement, reference)
        if not (isinstance(answer, tuple) and len(answer) == 2):
            raise TypeError(f"step returned {type(answer).__name__}, not a state and a command")
        return answer[0], as_command(answer[1])
    except RAISED as error:
        raise_if_interrupt(error)
        raise ControllerFailed from error


def as_command(answer: Any) -> Command:
    """Return the response of a controller as a command whose fields have the declared types.

    A controller of a plug-in may return types that merely behave alike. Raises every exception of the conversion.
    The values of the explanation are not converted.
    """
    exact = type(answer) is Command  # a separate name, so that type checkers treat the fields as untyped
    if (
        exact
        and type(answer.position) is float
        and type(answer.correction) is float
        and type(answer.gain) is float
        and (answer.stiffness is None or type(answer.stiffness) is float)
        and type(answer.held) is bool
        and type(answer.explanation) is dict
        and type(answer.across) is float
        and type(answer.turn) is float
    ):
        command: Command = answer
        return command
    return Command(
        position=float(answer.position),
        correction=float(answer.correction),
        stiffness=None if answer.stiffness is None else float(answer.stiffness),
        gain=float(answer.gain),
        held=bool(answer.held),
        explanation=dict(answer.explanation),
        across=float(getattr(answer, "across", 0.0)),
        turn=float(getattr(answer, "turn", 0.0)),
    )


def numeric_explanation(explanation: Mapping[Any, Any]) -> dict[str, float]:
    """Return an explanation for the recording, by name. A value that is not a number becomes NaN.

    The explanation does not affect the motion, and a controller of a plug-in may put any object into it.
    """
    return {
        name if type(name) is str else _name(name): value if type(value) is float else _number(value)
        for name, value in explanation.items()
    }


def _name(value: Any) -> str:
    try:
        return str(value)
    except Exception:  # an object of a plug-in may raise anything
        return f"<{type(value).__name__}>"


def _number(value: Any) -> float:
    try:
        return float(value)
    except Exception:  # an object of a plug-in may raise anything
        return math.nan


State = TypeVar("State")


class Controller(Protocol[State]):
    """Pure control law: equal states, measurements and references give equal responses, without clock or I/O.

    Gains may be per sample. A controller declares the sample time that it is tuned for by an attribute `sample_ms`,
    in ms. The default is `SAMPLE_MS`; `controller.sample_ms` in a configuration overrides both. A run whose control
    period differs from this sample time by more than a factor of two is refused. `Measurement.dt` is the measured
    time, for a controller with gains per second. A controller that turns the tool in a run without steps declares
    this by the attribute `turns`, True.
    """

    @property
    def name(self) -> str:
        """Name by which a configuration selects the controller."""

    def initial(self) -> State:
        """Return the state before the first sample in contact."""

    def step(self, state: State, measurement: Measurement, reference: float) -> tuple[State, Command]:
        """Return the next state and the command for one sample. `reference` is the desired force in N, positive while
        pressing.
        """
