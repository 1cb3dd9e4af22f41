"""State, proposal and decision of one cycle, as plain values."""

from msgspec import Struct

from hil_bridge.control.course.contact_sample import ContactSample
from hil_bridge.control.course.following import Trail
from hil_bridge.control.course.intent import Intent, Target
from hil_bridge.control.course.oscillation import Advice, OscillationState
from hil_bridge.control.course.verdict import Clamp, Stop, SupervisorState, Verdict
from hil_bridge.control.program.state import ProgramState
from hil_bridge.errors.causes import Reason
from protocol.geometry import Quaternion, Vector


class LoopState(Struct, frozen=True, gc=False):
    """State that one decision passes on to the next."""

    start: Vector
    """Reported position at the start point, base frame, m."""
    program: ProgramState
    supervisor: SupervisorState
    oscillation: OscillationState = OscillationState()
    previous_at: float | None = None
    """`now` of the previous sample, s; None before the first sample."""
    trail: Trail = ()
    """Recently ordered depths."""


class Proposal(Struct, frozen=True, gc=False):
    """Command that the program and the controller request, before the supervisor checks it."""

    contact: ContactSample
    """Sample in the work frame."""
    intent: Intent
    failure: Reason | None
    """Failure of the controller, with its package and code location; None if there is no failure."""
    advice: Advice | None
    """Advice from the oscillation detector, or None."""
    program: ProgramState
    oscillation: OscillationState
    trace: str = ""
    """Traceback of the controller's failure; empty if it raised no exception."""


class Decision(Struct, frozen=True, gc=False):
    """Command of the cycle, with its reasons."""

    depth: float
    """Reported position along the approach direction from the start point, m."""
    force: float
    """Controlled force, N: along the approach direction, or along the estimated normal."""
    target: Target
    """Commanded depth and travel from the start point, m, after clamping by the supervisor."""
    position: Vector
    """Commanded position in the base frame, m, before rounding to the robot's resolution."""
    intent: Intent
    verdict: Verdict
    ended: bool
    """Whether the run is over. No command may follow."""
    stands: bool = False
    """Whether the tool must stop at once, regardless of its last order."""
    quaternion: Quaternion | None = None
    """Commanded orientation of the tool in the base frame; None for the orientation at the start."""

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons why the supervisor clamped the command or stopped; empty if it allowed the command."""
        match self.verdict:
            case Clamp(reasons=reasons):
                return reasons
            case Stop(reason=reason):
                return (str(reason),)
            case _:
                return ()
