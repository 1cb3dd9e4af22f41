"""Measurement and command: a controller's input and its answer. SI units; the coordinate is the approach direction.

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
"""Sample time that a controller is taken to be tuned for when it declares none. Source: the paper's chain, whose cycle
takes 172 … 187 ms on the computer link at 9600 baud.
"""
POSITION_STEP_MM = 0.125
"""Step of a robot's position where no other is given. Source: the position words of the paper's robot, observed."""


STREAM_SAMPLES_MS = (2.0, 4.0, 12.0)
"""Cycles of robots that stream, for which our controllers have tunings. Source: RTDE, EGM and RSI."""
FINE_STEP_MM = 0.01
"""Step that a controller counts with on a robot that reports its position in fine steps. Chosen: with less, the noise
of the force passes for a move.
"""


class Tuning(NamedTuple):
    """Parameters of a controller that fit one sample time."""

    sample_ms: float
    parameters: Mapping[str, float]
    """Those that differ from the defaults, by name."""


class Range(NamedTuple):
    """Values of a parameter among which `hil-bridge tune` searches, both ends included; in the parameter's unit."""

    low: float
    high: float
    by_factor: bool = False
    """A factor is a step, as for gains: both ends are above 0."""


class Measurement(Struct, frozen=True, gc=False):
    """One sample of the force-controlled direction."""

    time: float
    """When the force was sampled, s on the run's clock."""
    force: float
    """Contact force along the approach direction, N, positive while pressing."""
    position: float
    """Position that the robot controller reports, along the approach direction, m."""
    commanded: float
    """Position commanded in the cycle before, after the supervisor's clamps, m."""
    in_contact: bool = True
    """False before the first contact and after a contact loss."""
    paired_force: float | None = None
    """Force that acted when the robot controller composed `position`, N: the other half of a force–position
    pair. None where nothing older than `force` is known.
    """
    travel: float = 0.0
    """Reported position along the surface, of the same moment as `position`, m from the start point."""
    travel_next: float = 0.0
    """Position along the surface that will be commanded together with the answer, m."""
    free_position: float | None = None
    """Reported position of the newest sample before the present contact, m; None where there was none."""
    advance: float = 1.0
    """Share of a step along the travel direction that moves the tool by a whole step along the surface."""
    saturated: bool = False
    """An axis of the sensor is at the end of its range: the force may be anything above."""
    dt: float = SAMPLE_MS * 1e-3
    """Time since the sample before, s, at most twice the controller's sample time; that time for the first sample."""
    against: float = 0.0
    """Contact force against the way along the path, N; 0 on a way through free space without one."""
    sample: Sample | None = None
    """The whole sample: wrench, pose, ages, states; None where a controller is tried without a run."""

    @property
    def is_finite(self) -> bool:
        """Whether forces and positions are numbers at all."""
        # A sum is a number only if all its parts are, and no part is infinite.
        return math.isfinite(self.force + (self.paired_force or 0.0) + self.position + self.commanded)

    @property
    def force_at_position(self) -> float:
        """Force that belongs to `position`, N: the paired one, else the newest."""
        return self.force if self.paired_force is None else self.paired_force


class Command(Struct, frozen=True, gc=False):
    """A controller's answer for one sample."""

    position: float
    """Position to command along the approach direction, m, not yet rounded to the robot's resolution."""
    correction: float
    """The part that the feedback law added, m, positive into the surface."""
    stiffness: float | None = None
    """Estimate of the contact stiffness, N/m, where the controller has one."""
    gain: float = 1.0
    """Factor that an adaptation applied to the feedback law's output."""
    held: bool = False
    """True when the controller rests in its dead band: no position that the robot can take is nearer."""
    explanation: dict[str, float] = {}
    """Further numbers that explain the answer (quantised levels, …), by name, for the record."""
    across: float = 0.0
    """Way along the third direction of the work frame that this sample adds, m; no more than the travel's speed
    (`task.speed_mm_s`) allows. A program, which leads the way itself, leaves it out.
    """
    turn: float = 0.0
    """Turn of the tool that this sample adds, rad, about the third direction of the work frame: a positive one tips its
    axis towards the travel. Looked at where the step's orientation is `led`, and never faster or farther than the
    guard's limits allow.
    """


class ControllerFailed(Exception):
    """A controller raised the error that is this one's cause, or answered with no command."""


def begin(controller: "Controller[Any]") -> Any:
    """State of a controller before the first sample in contact. Raises ControllerFailed for all that it raises."""
    try:
        return controller.initial()
    except RAISED as error:
        raise_if_interrupt(error)
        raise ControllerFailed from error


def ask(
    controller: "Controller[Any]", memory: Any, measurement: Measurement, reference: float
) -> tuple[Any, Command]:
    """State and command of a controller's step, the command as of `as_command`. Raises ControllerFailed for all that
    it raises, and for an answer that is none.
    """
    try:
        answer: Any = controller.step(memory, measurement, reference)
        if not (isinstance(answer, tuple) and len(answer) == 2):
            raise TypeError(f"step answers {type(answer).__name__}, not a state and a command")
        return answer[0], as_command(answer[1])
    except RAISED as error:
        raise_if_interrupt(error)
        raise ControllerFailed from error


def as_command(answer: Any) -> Command:
    """Return the answer of a controller as a command whose fields have the declared types.

    A controller of a plug-in may answer with types that only behave alike. Raises every error of the
    conversion. The values of the explanation are not converted.
    """
    exact = type(answer) is Command  # a name of its own, so that the fields' types count as open
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
    """Return an explanation for the record, by name. A value that is not a number becomes NaN.

    The explanation moves nothing, and a controller of a plug-in may have put any object into it.
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
    """A pure control law: same state, measurement and reference, same answer. No clock, no I/O.

    Gains may count per sample. A controller says for which sample time it is tuned by an attribute `sample_ms`, in ms.
    One without it is taken for `SAMPLE_MS`; `controller.sample_ms` of a configuration goes before both. A run whose
    control period differs from it by more than a factor of two is refused. `Measurement.dt` is the measured time, for a
    controller that counts in seconds. One that turns the tool in a run without steps says so by `turns`, True.
    """

    @property
    def name(self) -> str:
        """The name under which a configuration chooses it."""

    def initial(self) -> State:
        """State before the first sample in contact."""

    def step(self, state: State, measurement: Measurement, reference: float) -> tuple[State, Command]:
        """One sample. `reference` is the desired force in N, positive while pressing."""
