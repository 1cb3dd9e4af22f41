"""The intent of a program in one cycle, before the supervisor judges it: phase, place, force. Plain values."""

from enum import StrEnum

from msgspec import Struct

from hil_bridge.control.types import Command
from hil_bridge.errors.causes import Reason
from protocol.geometry import Quaternion


class Phase(StrEnum):
    """Phases of a run, by the names that the record uses."""

    APPROACH = "approach"
    """Step into the surface until the force says contact."""
    TRACK = "track"
    """The controller holds the force while the tool travels along the surface."""
    RETRACT = "retract"
    """Step back out of the surface."""
    MOVE = "move"
    """To another place through free space."""
    SEEK = "seek"
    """Along the surface until something pushes back."""
    ZERO = "zero"
    """Stand still in free space, and take the reading for zero."""
    END = "end"
    """Nothing more to command."""


FREE_SPACE = Phase.APPROACH, Phase.MOVE, Phase.SEEK
"""Phases in which the tool moves where nothing presses on it, until it touches."""
CONNECT, TARE = "connect", "tare"
BEFORE_TOUCH = CONNECT, TARE
"""Phases of a run before there is anything to decide: devices become ready, and the zero is taken."""


class Target(Struct, frozen=True, gc=False):
    """Where the tool is wanted, from the start point."""

    depth: float
    """Along the approach direction, m."""
    travel: float
    """Along the travel direction, m."""
    across: float = 0.0
    """Along the third direction of the work frame, m."""


class Intent(Struct, frozen=True, gc=False):
    """The answer of a program for one sample."""

    phase: Phase
    """Phase that this sample belonged to."""
    target: Target
    in_contact: bool
    command: Command | None = None
    """Answer of the controller; None outside TRACK."""
    losses: int = 0
    """Contact losses so far."""
    reason: Reason | None = None
    """Why the run retracts or has ended; None while it continues."""
    failed: bool = False
    """The reason is a failure, not the end of the work."""
    reference: float | None = None
    """Desired force of this sample, N; None for that of the task."""
    turned: Quaternion | None = None
    """Orientation wanted, base frame; None for that of the start."""
    leg: int = 0
    """Place of the program's step in its list, from 0."""
    notes: dict[str, float] = {}
    """Further numbers of the program for the record, by name."""
