"""The parts of an emulated cell as they know each other: all that an author of an emulated device needs.

A cell joins a robot, a tool, a surface and a sensor. The robot tells the path of its arm, the surface answers with a
force, and the sensor reads the wrench that both exert on the tool. Each device sits behind the wire of the real one.
An author of a robot implements `EmulatedRobot` and `ArmPath`; `emulators.arm` has both kinds of arm ready. An author
of a sensor implements `EmulatedSensor` and is handed a `WrenchSource`; `emulators.sensing` reads it with noise. An
author of a contact model implements `Surface`.

Times are seconds on one clock that every call is told; they do not run backwards for one caller. Positions are m,
velocities m/s, forces N, moments N·m. The base frame is the robot's, z up. The tool frame's z axis points out of the
flange; the sensor frame has the tool frame's orientation and lies in the flange. Arrays are `float64`.

Nothing here reads a clock, opens a port or starts a thread. A device that is asked twice answers the same: results
depend on the orders and their times, not on reads in between.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from emulators.faults.ledger import Handler
from protocol.endpoint import Endpoint
from protocol.geometry import Pose, Quaternion, Vector

Floats: TypeAlias = NDArray[np.float64]

Joints: TypeAlias = tuple[float, ...]
"""Angles of a robot's axes, rad, axis 1 first."""

Handlers: TypeAlias = Mapping[str, Mapping[str, Handler]]
"""Faults of a device: by target, then by name of the fault. Empty if there are none."""


class StartPose(NamedTuple):
    """How a robot stands when the cell is made."""

    position: Vector
    """Tool centre point in the base frame, m."""
    quaternion: Quaternion
    """Tool frame in the base frame, w x y z; need not be normalised."""
    tool_length: float = 0.0
    """Distance from the flange along tool z to the tool centre point, m."""


class ArmPath(Protocol):
    """Where an arm was, is, and will be. `emulators.arm.history.History` implements it.

    The path is *committed* up to a time when no order that comes from now on can change it before that time. It may be
    read further, up to `predicted_until`, as if nothing more were ordered; `on_change` tells when an order comes.
    """

    on_change: Callable[[float], object]
    """Set by the one reader. Call it with the time, s, from which on the path is another than it could be read."""

    def advance(self, now: float) -> None:
        """Let everything up to `now` happen; harmless when nothing does."""

    def committed_until(self, now: float) -> float:
        """Up to when the path is settled whatever is ordered from `now` on, s, that moment excluded; at least `now`."""

    def predicted_until(self, now: float) -> float:
        """Up to when the path may be read, s; as `committed_until` for a path that is never read ahead."""

    def trajectory(self, times: Floats) -> tuple[Floats, Floats]:
        """Return true positions (n, 3), m, of the tool centre point and its velocities (n, 3), m/s, base frame.

        `times` (n,) ascend, s. They may lie up to ten seconds in the past, and as far ahead as is predicted.
        """

    def orientations(self, times: Floats) -> list[tuple[slice, Quaternion]]:
        """Tool frame in the base frame, unit quaternion w x y z, at ascending `times` (n,). The answer is stretches, in
        order, that cover all of `times`, each with the one orientation that holds there.
        """


class EmulatedRobot(Protocol):
    """A robot with its controller, as a cell and a run's ground truth know it."""

    @property
    def endpoint(self) -> Endpoint[Any, Any, Any]:
        """The controller's end of its wire: of bytes, or of datagrams. It tells no events."""

    @property
    def path(self) -> ArmPath:
        """The path of its arm."""

    @property
    def handlers(self) -> Handlers:
        """Handlers of its faults."""

    @property
    def accepted(self) -> int:
        """Number of targets that it has taken so far; the first has the number 1."""

    def begun_at(self, target: int) -> float | None:
        """When the motion towards the target of this number began, s; None while that is not known, NaN for a target
        that was given up.
        """

    def joints_holding(self, pose: Pose, at: float) -> Joints | None:
        """Return the joints that hold the true `pose` of the time `at`, s; None where the robot has no kinematics."""


ContactSource: TypeAlias = Callable[[float], Vector]
"""True force of the surroundings on the tool at a time that has passed, s, base frame, N, without the weight."""


@runtime_checkable
class FeelingRobot(Protocol):
    """A robot that feels the contact of its tool by itself. The cell gives it that force when both are there."""

    def feel(self, contact: ContactSource) -> None:
        """Set the source of the force."""


@runtime_checkable
class LoadedRobot(Protocol):
    """A robot that takes the weight of its tool into account. The cell tells it the tool."""

    def carry(self, mass: float, centre: Vector) -> None:
        """Set the mass at the flange, kg, and its centre in the flange, m."""


@runtime_checkable
class ArticulatedRobot(Protocol):
    """A robot whose arm is compliant in its joints."""

    @property
    def joint_stiffness(self) -> Joints:
        """Torsional stiffness of its joints, N·m/rad, axis 1 first."""

    def tool_pose_at(self, joints: Joints) -> Pose:
        """Return the true pose of the tool centre point at these joint angles, rad: forward kinematics."""


class WrenchSource(Protocol):
    """The true wrench that a sensor feels. The cell implements it.

    It may be asked for a time again: after `on_change`, or when a reader begins again.
    """

    on_change: Callable[[float], object]
    """Set by the one sensor. Called with the time, s, from which on the wrench is another than it could be read."""

    def wrench(self, times: Floats) -> Floats:
        """Wrench (n, 6) on the tool about the sensor's origin in the sensor frame: fx fy fz in N, mx my mz in N·m.

        Surface and gravity exert it: pressing down on a surface gives a negative fz where the tool points
        down. `times` (n,) ascend, s.
        """

    def committed_until(self, now: float) -> float:
        """Up to when the wrench may be read at `now` and stays, unless a fault changes it, s; at least `now`."""

    def predicted_until(self, now: float) -> float:
        """Up to when it may be read by a sensor that minds `on_change`, s; at least `committed_until`."""


@runtime_checkable
class MovingSource(Protocol):
    """A fact that a source of a wrench may tell beside it."""

    def speeds(self, times: Floats) -> Floats:
        """Speed (n,) of the tool, m/s, at ascending `times` (n,), s."""


class EmulatedSensor(Protocol):
    """A force/torque sensor with the device that reads it out."""

    @property
    def endpoint(self) -> Any:
        """The end of its wire that its room serves: an `Endpoint` of bytes, datagrams or CAN frames that tells no
        events. For a device of registers it is `protocol.devices.jr3.board.Registers`.
        """

    @property
    def handlers(self) -> Handlers:
        """Handlers of its faults."""

    def sampled_at(self, counter: int) -> float | None:
        """When it measured the newest sample that it told with this counter, s; None if there is none."""


class Surface(Protocol):
    """A contact model: it pushes back when the tool's tip comes to it. `emulators.surface.contact.Contact` is one.

    A model without memory answers None to `remembered_until`, itself to `aside`, and does nothing in `rewind`. A model
    that also implements `ShapedSurface` tells its normals for the ground truth.
    """

    @property
    def handlers(self) -> Mapping[str, Handler]:
        """Its faults, by name; their target is `surface`. Empty if there are none."""

    @property
    def remembered_until(self) -> float | None:
        """Time of the newest sample that it was shown, s, where its force depends on the past; None where it does not.

        A model with memory is shown ascending times, at least 8000 a second, and may continue from the call before.
        """

    def force(self, positions: Floats, velocities: Floats, times: Floats) -> Floats:
        """Force (n, 3) on the tip, N, for its positions (n, 3), m, and velocities (n, 3), m/s, all in the base frame.

        `times` (n,) ascend, s.
        """

    def aside(self) -> "Surface":
        """Return a copy for questions: they must change neither the memory nor the counts of this one."""

    def rewind(self, time: float) -> None:
        """Go back to before this time, s, as far as is known: the samples from then on are shown again."""


@runtime_checkable
class ShapedSurface(Protocol):
    """Facts that a contact model may tell beside its forces."""

    def normals(self, positions: Floats, times: Floats) -> Floats:
        """Outward unit normals (n, 3) of the surface below positions (n, 3), m, base frame; NaN if there is none.

        `times` (n,) ascend, s.
        """


RobotFactory: TypeAlias = Callable[[StartPose, float, int], EmulatedRobot]
"""Makes a robot that is powered up at a time, s, with a seed. Raises ValueError for a start that it cannot hold."""
SensorFactory: TypeAlias = Callable[[WrenchSource, float, int], EmulatedSensor]
"""Makes a sensor that is powered up at a time, s, with a seed."""
SurfaceFactory: TypeAlias = Callable[[Callable[[float], object]], Surface]
"""Makes a surface that tells the function since when it is another, s: its faults change it."""
