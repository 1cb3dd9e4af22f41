"""The sample of one cycle: all that the decision is made from. Plain values."""

from typing import Annotated

from msgspec import Meta, Struct

from hil_bridge.errors.causes import Reason
from protocol.geometry import Quaternion, Vector


class Sample(Struct, frozen=True):
    """Measurements of one cycle."""

    now: float
    """When it is looked at, s on the run's clock."""
    position: Vector
    """Reported tool position, base frame, m."""
    force: float
    """Contact force along the approach direction, N, positive while pressing."""
    resultant: float
    """Length of the force vector, N."""
    sensor_at: float
    """When the sensor frame arrived, s on the run's clock, less the lateness that its stream has shown."""
    sensor_sequence: int
    """Counter of the frame, unwrapped."""
    repeated_frames: int = 0
    """Number of newest frames in a row with identical counts: for the record alone."""
    saturated: bool = False
    """An axis is at the end of its range."""
    dead_axis: str = ""
    """Which axis of the controlled force does not live, in words; empty while all do."""
    fault: Reason | None = None
    """Fault of a device; None if there is none."""
    force_travel: float = 0.0
    """Contact force along the travel direction, N, positive where the surface pushes against the travel."""
    wrench: Annotated[tuple[float, ...], Meta(max_length=6)] = ()
    """The whole contact wrench, tool frame, N and N·m."""
    position_at: float | None = None
    """When `position` was true, s on the run's clock; None where that is not known."""
    paired_force: float | None = None
    """Contact force along the approach direction at that moment, N; None where none is known."""
    peak_force: float = 0.0
    """Force along the approach direction farthest from 0 of all frames since the decision before, N. It counts from the
    zero, or from the reading before the zero, whichever is more.
    """
    peak_resultant: float = 0.0
    """Largest length of the force vector of these frames, likewise, N."""
    peak_moment: float = 0.0
    """Largest length of the moment vector of these frames, N·m."""
    tilt: float | None = None
    """Turn of the reported orientation from that of the start, rad; None where the pose is not judged."""
    gap: float = 0.0
    """Longest time for which the computer stood still since the decision before, or this one lasted, s."""
    unchanged: float = 0.0
    """Time for which the newest frames have carried identical counts, s."""
    quaternion: Annotated[tuple[float, ...], Meta(max_length=4)] = ()
    """Reported orientation, tool in base, w x y z; empty in recordings of earlier versions."""
    held: bool = False
    """An operator holds the tool in its place on the surface: the force is controlled, the way does not continue."""
    witness: float | None = None
    """Contact force along the approach direction as the robot itself feels it, from its own zero, N; None where it
    tells none.
    """
    doubt: Annotated[int, Meta(ge=0, le=2)] = 0
    """Why a touch that shows now must be proven: a number of `Doubt`."""
    overdue: float = 0.0
    """Time by which the next frame comes later than the facts of the sensor say, s; 0 while it does not."""
    force_across: float | None = None
    """Contact force along the third direction of the work frame, N, positive where the tool presses that way. None
    where it is not told, as in recordings of earlier versions: the wrench has it.
    """
    hidden: float | None = None
    """Force across the approach that the moments show and the force axes do not, N: 0 where none, or where the tool's
    end is not known. None where those axes are verified.
    """

    @property
    def orientation(self) -> Quaternion | None:
        """Reported orientation, tool in base; None where it is not known."""
        return self.quaternion if len(self.quaternion) == 4 else None
