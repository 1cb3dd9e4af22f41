"""The values of one cycle's decision: state, proposal and decision. Plain values."""

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
    """Everything that one decision leaves to the next."""

    start: Vector
    """Reported position at the start point, base frame, m."""
    program: ProgramState
    supervisor: SupervisorState
    oscillation: OscillationState = OscillationState()
    seen_at: float | None = None
    """`now` of the sample before, s; None before the first."""
    trail: Trail = ()
    """Depths that were ordered lately."""


class Proposal(Struct, frozen=True, gc=False):
    """Command that program and controller ask for; the supervisor judges it."""

    contact: ContactSample
    """The sample in the work frame."""
    intent: Intent
    failure: Reason | None
    """Fault of the controller, with its package and place; None if there is none."""
    advice: Advice | None
    """The oscillation detector's word; None where it has none."""
    program: ProgramState
    oscillation: OscillationState
    trace: str = ""
    """Traceback of the controller's fault; empty where it raised nothing."""


class Decision(Struct, frozen=True, gc=False):
    """Command of the cycle, with its reasons."""

    depth: float
    """Reported position along the approach direction from the start point, m."""
    force: float
    """The force that was controlled, N: along the approach direction, or along the estimated normal."""
    target: Target
    """Commanded depth and travel from the start point, m, after the supervisor's clamps."""
    position: Vector
    """The same as a point in the base frame, m, not yet rounded to device words."""
    intent: Intent
    verdict: Verdict
    ended: bool
    """The run is over; nothing more is to be commanded after this."""
    stands: bool = False
    """The tool is to stand still at once, wherever it was ordered to."""
    quaternion: Quaternion | None = None
    """Commanded orientation, tool in base; None for that of the start."""

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the supervisor clamped or stopped; empty when it allowed."""
        match self.verdict:
            case Clamp(reasons=reasons):
                return reasons
            case Stop(reason=reason):
                return (str(reason),)
            case _:
                return ()
