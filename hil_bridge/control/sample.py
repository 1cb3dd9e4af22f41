"""Sample of one cycle: the complete input of a decision, as plain values."""

from typing import Annotated

from msgspec import Meta, Struct

from hil_bridge.errors.causes import Reason
from protocol.geometry import Quaternion, Vector


class Sample(Struct, frozen=True):
    """Measurements of one cycle."""

    now: float
    """Time at which the sample is evaluated, s on the run's clock."""
    position: Vector
    """Reported tool position, base frame, m."""
    force: float
    """Contact force along the approach direction, N, positive while pressing."""
    resultant: float
    """Magnitude of the force vector, N."""
    sensor_at: float
    """Arrival time of the sensor frame less the observed lateness of its stream, s on the run's clock."""
    sensor_sequence: int
    """Counter of the frame, without wrap-around."""
    repeated_frames: int = 0
    """Number of consecutive frames, up to the newest, with identical counts; only for the recording."""
    saturated: bool = False
    """Whether an axis is at the end of its range."""
    dead_axis: str = ""
    """Description of a dead axis of the controlled force; empty if there is none."""
    fault: Reason | None = None
    """Fault of a device; None if there is none."""
    force_travel: float = 0.0
    """Contact force along the travel direction, N, positive if the surface pushes against the travel."""
    wrench: Annotated[tuple[float, ...], Meta(max_length=6)] = ()
    """Complete contact wrench in the tool frame, N and N·m."""
    position_at: float | None = None
    """Time at which `position` is valid, s on the run's clock; None if unknown."""
    paired_force: float | None = None
    """Contact force along the approach direction at `position_at`, N; None if unknown."""
    peak_force: float = 0.0
    """Force along the approach direction with the largest magnitude in all frames since the previous decision, N.
    It is relative to the zero, or to the reading before the zero, whichever gives the larger force.
    """
    peak_resultant: float = 0.0
    """Largest magnitude of the force vector in all frames since the previous decision, N, relative to the same
    reference as `peak_force`.
    """
    peak_moment: float = 0.0
    """Largest magnitude of the moment vector in all frames since the previous decision, N·m."""
    tilt: float | None = None
    """Angle between the reported orientation and the orientation at the start, rad; None if the pose is not checked."""
    gap: float = 0.0
    """Longest time for which the computer was unresponsive since the previous decision, or the duration of the
    decision itself, whichever is longer, s.
    """
    unchanged: float = 0.0
    """Time for which the newest frames have had identical counts, s."""
    quaternion: Annotated[tuple[float, ...], Meta(max_length=4)] = ()
    """Reported orientation of the tool in the base frame, w x y z; empty in recordings of earlier versions."""
    held: bool = False
    """Whether an operator holds the tool at its position on the surface. The force is controlled, and the tool does
    not advance.
    """
    witness: float | None = None
    """Contact force along the approach direction as estimated by the robot, relative to its own zero, N; None if
    the robot does not report a force.
    """
    doubt: Annotated[int, Meta(ge=0, le=2)] = 0
    """Reason why a touch in this sample must be confirmed, as a value of `Doubt`."""
    overdue: float = 0.0
    """Time by which the next frame is later than the sensor's specification allows, s; 0 if it is in time."""
    force_across: float | None = None
    """Contact force along the third direction of the work frame, N, positive if the tool presses in that direction.
    None in recordings of earlier versions, whose wrench contains it.
    """
    hidden: float | None = None
    """Force across the approach that the moments show and the force axes do not, N; 0 if there is none, or if the
    position of the tool's end is unknown. None if these axes are verified.
    """

    @property
    def orientation(self) -> Quaternion | None:
        """Reported orientation of the tool in the base frame; None if unknown."""
        return self.quaternion if len(self.quaternion) == 4 else None
