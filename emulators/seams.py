"""Interfaces between the parts of an emulated cell, for authors of emulated devices.

A cell joins a robot, a tool, a surface and a sensor. The robot provides the path of its arm, the surface returns a
force, and the sensor reads the wrench that surface and gravity exert on the tool. Each emulated device is behind
the same wire as the real device. An author of a robot implements `EmulatedRobot` and `ArmPath`; `emulators.arm`
provides both kinds of arm. An author of a sensor implements `EmulatedSensor` and receives a `WrenchSource`;
`emulators.sensing` reads the source and adds noise. An author of a contact model implements `Surface`.

Times are seconds on one clock and are passed to every call. They never decrease for one caller. Positions are in m,
velocities in m/s, forces in N, moments in N·m. The base frame is the base frame of the robot, z up. The tool
frame's z axis points out of the flange. The sensor frame has the orientation of the tool frame and its origin in
the flange. Arrays are `float64`.

These interfaces read no clock, open no port and start no thread. Repeated reads return equal results: the results
depend on the orders and their times, not on the reads in between.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from emulators.faults.ledger import Handler
from emulators.target_times import TargetTimes
from protocol.arm_size import PerAxis
from protocol.endpoint import Endpoint
from protocol.geometry import Pose, Quaternion, Vector

Floats: TypeAlias = NDArray[np.float64]

Joints: TypeAlias = tuple[float, ...]
"""Angles of a robot's axes, rad, axis 1 first."""

Handlers: TypeAlias = Mapping[str, Mapping[str, Handler]]
"""Fault handlers of a device, by target, then by name of the fault. Empty if the device has no faults."""


class StartPose(NamedTuple):
    """Pose of the robot at power-up."""

    position: Vector
    """Position of the tool centre point in the base frame, m."""
    quaternion: Quaternion
    """Orientation of the tool frame in the base frame, w x y z; need not be normalised."""
    tool_length: float = 0.0
    """Distance from the flange to the tool centre point along tool z, m."""


class ArmPath(Protocol):
    """Past, present and predicted path of an arm. `emulators.arm.history.History` implements it.

    The path is *committed* up to a time if no further order can change it before that time. It may be read further
    ahead, up to `predicted_until`, under the assumption that no further order arrives. `on_change` is called when
    an order changes it.
    """

    on_change: Callable[[float], object]
    """Callback that the only reader sets. Call it with the time from which the path differs from the path that
    could be read before, s.
    """

    def advance(self, now: float) -> None:
        """Compute the path up to `now`. Idempotent."""

    def committed_until(self, now: float) -> float:
        """Return the time before which no order from `now` on can change the path, s. The result is at least `now`."""

    def predicted_until(self, now: float) -> float:
        """Return the time up to which the path may be read, s.

        The result is `committed_until` if the path is never read ahead.
        """

    def trajectory(self, times: Floats) -> tuple[Floats, Floats]:
        """Return true positions (n, 3), m, and velocities (n, 3), m/s, of the tool centre point in the base frame.

        `times` (n,) are in ascending order, s. They may be up to ten seconds in the past, and up to
        `predicted_until` in the future.
        """

    def orientations(self, times: Floats) -> list[tuple[slice, Quaternion]]:
        """Return the tool frame in the base frame, unit quaternion w x y z, at `times` (n,) in ascending order, s.

        The result is a list of consecutive slices that cover all of `times`, each with a constant orientation.
        """


class EmulatedRobot(Protocol):
    """Emulated robot with its controller, in the form that a cell and the ground truth of a run use."""

    @property
    def endpoint(self) -> Endpoint[Any, Any, Any]:
        """End of the wire at the controller, an endpoint of bytes or of datagrams. It emits no events."""

    @property
    def path(self) -> ArmPath:
        """Path of the arm."""

    @property
    def handlers(self) -> Handlers:
        """Handlers of the faults of the robot."""

    @property
    def targets(self) -> TargetTimes:
        """Times at which targets arrived, and at which the motions to them began."""

    def joints_holding(self, pose: Pose, at: float) -> Joints | None:
        """Return the joint angles for the true `pose` at the time `at`, s.

        None if the robot has no kinematics, or no joints hold this pose.
        """


ContactSource: TypeAlias = Callable[[float], Vector]
"""Function that returns the true force of the surroundings on the tool at a past time, s; base frame, N, excluding
weight and unbalance.
"""


@runtime_checkable
class FeelingRobot(Protocol):
    """Robot that estimates the contact force itself. The cell supplies the source of the true force at power-up."""

    def feel(self, contact: ContactSource) -> None:
        """Set the source of the true contact force."""


@runtime_checkable
class LoadedRobot(Protocol):
    """Robot that compensates for the weight of its tool. The cell passes the load to it at power-up."""

    def carry(self, mass: float, centre: Vector) -> None:
        """Set the mass at the flange, kg, and its centre of gravity in the flange frame, m."""


@runtime_checkable
class EquippedRobot(Protocol):
    """Robot whose controller reads a force sensor itself, and serves it. The cell passes its sensor at power-up."""

    def equip(self, sensor: object) -> None:
        """Connect the sensor of the cell, if it is one that this controller reads."""


@runtime_checkable
class ArticulatedRobot(Protocol):
    """Robot whose arm is compliant in its joints."""

    @property
    def joint_stiffness(self) -> PerAxis:
        """Torsional stiffness of the joints, N·m/rad, axis 1 first."""

    @property
    def mode(self) -> tuple[float, float]:
        """Natural frequency, Hz, and damping ratio of the first mode of the tool on the arm, without contact."""

    def tool_pose_at(self, joints: PerAxis) -> Pose:
        """Return the true pose of the tool centre point at these joint angles, rad, by forward kinematics."""


class WrenchSource(Protocol):
    """Source of the true wrench on a sensor. The cell implements it.

    A reader may read a time again: after `on_change`, or when it restarts.
    """

    on_change: Callable[[float], object]
    """Callback for the time from which the wrench differs from the wrench that could be read before, s. The only
    sensor sets it.
    """

    def wrench(self, times: Floats) -> Floats:
        """Return the wrench (n, 6) on the tool about the sensor's origin in the sensor frame, N and N·m.

        Surface, gravity and the unbalance of a spindle exert the wrench: with the tool pointing down, pressing on a
        surface gives a negative fz. Columns are fx fy fz mx my mz. `times` (n,) are in ascending order, s.
        """

    def committed_until(self, now: float) -> float:
        """Return the time up to which a wrench read at `now` is final unless a fault changes it, s.

        The result is at least `now`.
        """

    def predicted_until(self, now: float) -> float:
        """Return the time up to which a sensor that handles `on_change` may read, s.

        The result is at least `committed_until`.
        """


@runtime_checkable
class MovingSource(Protocol):
    """Optional extension of a wrench source that provides the speed of the tool."""

    def speeds(self, times: Floats) -> Floats:
        """Return the speed (n,) of the tool, m/s, at `times` (n,) in ascending order, s."""


class EmulatedSensor(Protocol):
    """Emulated force/torque sensor, including its read-out device."""

    @property
    def endpoint(self) -> Any:
        """End of the wire at the device: an `Endpoint` of bytes, datagrams or CAN frames that emits no events.

        For a register-based device, it is `protocol.devices.jr3.board.Registers`.
        """

    @property
    def handlers(self) -> Handlers:
        """Handlers of the faults of the sensor."""

    def sampled_at(self, counter: int) -> float | None:
        """Return the time at which the newest sample sent with this counter was measured, s.

        The result is None if there is no such sample.
        """


@runtime_checkable
class SensorStiffness(Protocol):
    """Settings of an emulated sensor whose body deflects under load. The settings of a rigid sensor lack them."""

    @property
    def stiffness_n_m(self) -> Vector:
        """Stiffness against a force along x, y and z of the sensor frame, N/m."""

    @property
    def stiffness_nm_rad(self) -> Vector:
        """Stiffness against a moment about x, y and z of the sensor frame, N·m/rad."""


class Surface(Protocol):
    """Contact model that returns the force on the tip of the tool, such as `emulators.surface.contact.Contact`.

    In a model without memory, `remembered_until` is None, `aside` returns the model itself, and `rewind` does
    nothing. A model that also implements `ShapedSurface` provides its normals for the ground truth.
    """

    @property
    def handlers(self) -> Mapping[str, Handler]:
        """Handlers of the faults of the target `surface`, by name. Empty if the surface has no faults."""

    @property
    def remembered_until(self) -> float | None:
        """Time of the newest sample received, s; None if the force does not depend on the past.

        A model with memory receives times in ascending order, at least 8000 per second. Each call may continue from
        the previous call.
        """

    def force(self, positions: Floats, velocities: Floats, times: Floats) -> Floats:
        """Return the force (n, 3) on the tip, N, for positions (n, 3), m, and velocities (n, 3), m/s, of the tip.

        All arrays are in the base frame. `times` (n,) are in ascending order, s.
        """

    def aside(self) -> "Surface":
        """Return a copy for queries that must not change the memory or the counts of this surface."""

    def rewind(self, time: float) -> None:
        """Return to the state before this time, s, or to the earliest state kept.

        The samples after this state will be passed again.
        """


@runtime_checkable
class ShapedSurface(Protocol):
    """Optional extension of a contact model that provides the normals of its surface."""

    def normals(self, positions: Floats, times: Floats) -> Floats:
        """Return outward unit normals (n, 3) of the surface below positions (n, 3), m, base frame.

        The result is NaN if there is no normal. `times` (n,) are in ascending order, s.
        """


RobotFactory: TypeAlias = Callable[[StartPose, float, int], EmulatedRobot]
"""Factory of a robot, called with start pose, time of power-up in s, and seed. Raises ValueError for a pose that
the robot cannot hold.
"""
SensorFactory: TypeAlias = Callable[[WrenchSource, float, int], EmulatedSensor]
"""Factory of a sensor, called with the source of the wrench, time of power-up in s, and seed."""
SurfaceFactory: TypeAlias = Callable[[Callable[[float], object]], Surface]
"""Factory of a surface, called with the callback for the time, s, from which a fault has changed the surface."""
