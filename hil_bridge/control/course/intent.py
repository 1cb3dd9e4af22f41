"""Intent of a program in one cycle, before the supervisor checks it: phase, position and force."""

from enum import StrEnum

from msgspec import Struct

from hil_bridge.control.types import Command
from hil_bridge.errors.causes import Reason
from protocol.geometry import Quaternion


class Phase(StrEnum):
    """Phase of a run. The values are the names in the recording."""

    APPROACH = "approach"
    """Move into the surface until the force indicates contact."""
    TRACK = "track"
    """Hold the force with the controller while the tool moves along the surface."""
    RETRACT = "retract"
    """Move out of the surface."""
    MOVE = "move"
    """Move to another point through free space."""
    SEEK = "seek"
    """Move along the surface until an obstacle resists."""
    ZERO = "zero"
    """Pause in free space, and use the reading as the zero."""
    END = "end"
    """Send no further commands."""


FREE_SPACE = Phase.APPROACH, Phase.MOVE, Phase.SEEK
"""Phases in which the tool moves without contact until it touches."""
CONNECT, TARE = "connect", "tare"
BEFORE_TOUCH = CONNECT, TARE
"""Phases before the first decision, in which devices become ready and the zero is taken."""


class Target(Struct, frozen=True, gc=False):
    """Target position of the tool, relative to the start point."""

    depth: float
    """Distance along the approach direction, m."""
    travel: float
    """Distance along the travel direction, m."""
    across: float = 0.0
    """Distance along the third direction of the work frame, m."""


class Intent(Struct, frozen=True, gc=False):
    """Response of a program to one sample."""

    phase: Phase
    """Phase to which this sample belongs."""
    target: Target
    in_contact: bool
    command: Command | None = None
    """Response of the controller; None outside TRACK."""
    losses: int = 0
    """Number of contact losses so far."""
    reason: Reason | None = None
    """Reason why the run retracts or has ended; None while it continues."""
    failed: bool = False
    """Whether the reason is a failure."""
    reference: float | None = None
    """Desired force for this sample, N; None if the force of the task applies."""
    turned: Quaternion | None = None
    """Desired orientation, base frame; None for the orientation at the start."""
    leg: int = 0
    """Index of the program's step in its list, from 0."""
    notes: dict[str, float] = {}
    """Additional numbers from the program for the recording, by name."""
