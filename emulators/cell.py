"""Emulated cell: any robot and any sensor, coupled by a tool and a surface.

See `emulators.seams` for the parts of a cell.

Frames: the base has z up. The tool frame's z axis points out of the flange, so a tool pointing down has the
quaternion (0, 1, 0, 0). The sensor frame has the orientation of the tool frame and its origin in the flange. The
sensor measures the wrench that surface, gravity and the unbalance of a spindle exert on the tool: pressing down on
the surface gives a negative Fz.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

from emulators.arm.compliance import ArmProfile, Load, bearing_of, is_rigid, mode_of
from emulators.arm.compliant_path import FINE_STEP_S, STEP_S, CompliantPath, Grid
from emulators.arm.compliant_path import Contact as ToolContact
from emulators.arm.end_compliance import end_compliance
from emulators.faults import Fault, Injection, Ledger
from emulators.faults.bus import BUS_FAULTS
from emulators.faults.computer import COMPUTER_FAULTS
from emulators.seams import (
    ArmPath,
    EmulatedRobot,
    EmulatedSensor,
    EquippedRobot,
    FeelingRobot,
    Floats,
    Joints,
    LoadedRobot,
    SensorStiffness,
    ShapedSurface,
    StartPose,
    Surface,
    SurfaceFactory,
    WrenchSource,
)
from emulators.spindle import Spindle
from emulators.surface.contact import Contact, SurfaceProfile
from emulators.surface.face import FACE_NEEDS_NO_MEMORY, ContactLoad, Face
from emulators.surface.faults import OBSTACLE_FAULTS, SURFACE_FAULTS, ObstacleProfile, Obstacles
from emulators.surface.plane_law import PlaneLaw
from emulators.surface.removal import Removed
from emulators.surface.tool_load import MEMORY_RATE_HZ, ToolLoad
from emulators.tool import ToolProfile, force_to_wrench, moment_matrix, rotation_matrix
from protocol.geometry import Pose, Quaternion, Vector, normalise, product
from protocol.marks import Mark, between, check_settings, setting

_GRAVITY = np.array([0.0, 0.0, -9.80665])
"""Standard gravity in the base frame, m/s²."""
_DEEPEST_M = 0.02
"""Largest depth of the tool inside the surface at the start, m; a greater depth is a configuration error. Chosen."""
OWN_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "bus": BUS_FAULTS,
    "surface": SURFACE_FAULTS,
    "obstacle": OBSTACLE_FAULTS,
    "computer": COMPUTER_FAULTS,
}
"""Faults in addition to the faults of the devices, by target. The bridge carries out the faults of bus and computer."""

Robot = TypeVar("Robot", bound=EmulatedRobot)
Sensor = TypeVar("Sensor", bound=EmulatedSensor)


def _unread(time: float) -> None:
    """Do nothing, because no sensor has read anything."""


@dataclass(frozen=True, slots=True)
class CellProfile:
    """Tool, surface, obstacle and start pose of an emulated cell, without its devices."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    arm: ArmProfile = field(default_factory=ArmProfile)
    tool: ToolProfile = field(default_factory=ToolProfile)
    surface: SurfaceProfile = field(default_factory=SurfaceProfile)
    obstacle: ObstacleProfile = field(default_factory=ObstacleProfile)
    start_position_mm: Vector = setting(
        (900.0, -100.0, 600.0),
        Mark.CHOSEN,
        "tool centre point at power-up in the base frame",
        between(-4095.0, 4095.0),
        unit="mm",
    )
    start_quaternion: Quaternion = setting(
        (0.0, 1.0, 0.0, 0.0), Mark.CHOSEN, "tool frame at power-up in the base frame, w x y z"
    )

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True)
class TrueState:
    """True state of the cell, for tests and comparisons. No device reports it."""

    position: Vector
    """Position of the tool centre point in the base frame, m. The run-out of a spindle is not included."""
    velocity: Vector
    """Velocity of the tool centre point in the base frame, m/s."""
    quaternion: Quaternion
    """Orientation of the tool frame in the base frame, w x y z."""
    contact_force: Vector
    """Force of surface and obstacles on the tool in the base frame, N; for a face, the sum over its points.

    It varies with the run-out of a spindle. The force of its unbalance is not included.
    """
    joints: Joints | None
    """Joint angles of the robot, axis 1 first, rad; None if the robot reports no joint angles."""
    normal: Vector | None = None
    """Outward unit normal of the surface below the tool centre point, base frame; None if it has no normals."""
    deflection: Vector = (0.0, 0.0, 0.0)
    """Position minus the position that the encoders of the robot measure, base frame, m; 0 for a rigid arm."""


@dataclass(frozen=True, slots=True)
class Parts(Generic[Robot, Sensor]):
    """Factories of the devices and the surface of a cell; see `emulators.seams`."""

    robot: Callable[[StartPose, float, int], Robot]
    """`RobotFactory`, called with start pose, time of power-up in s, and seed."""
    sensor: Callable[[WrenchSource, float, int], Sensor]
    """`SensorFactory`, called with the source of the wrench, time of power-up in s, and seed."""
    surface: SurfaceFactory | None = None
    """Factory of the contact model. The default is the contact model in the profile of the cell."""
    faults: Mapping[str, Mapping[str, Fault]] = field(default_factory=dict)
    """Definitions of the device faults, by target. The handlers of the devices carry them out."""
    sensor_stiffness: SensorStiffness | None = None
    """Settings of the sensor with the stiffness of its body; None for a rigid sensor."""


class Cell(Generic[Robot, Sensor]):
    """Robot and sensor coupled by a tool and a surface. The cell is the `WrenchSource` of the sensor.

    Raises ValueError for a start pose that the robot cannot hold, for an invalid surface, and for a surface that
    does not support this tool.
    """

    def __init__(self, profile: CellProfile, now: float, seed: int, parts: Parts[Robot, Sensor]) -> None:
        x, y, z = (p / 1000.0 for p in profile.start_position_mm)
        length = profile.tool.length_mm / 1000.0
        self.robot = parts.robot(StartPose((x, y, z), profile.start_quaternion, length), now, seed)
        """Emulated robot, powered up with the cell."""
        self._profile = profile
        self._powered_at = now
        radius = profile.tool.face_radius_mm / 1000.0
        face = Face(radius, profile.tool.face_rings) if radius > 0.0 else None
        self._surface: Surface
        if parts.surface is None:
            self._surface = Contact(profile.surface, self._on_surface_change, face)
        else:
            self._surface = parts.surface(self._on_surface_change)
        self.has_memory = self._surface.remembered_until is not None
        """Whether the force depends on the past. True states must then be read before the surface discards them."""
        if face is not None and self.has_memory and parts.surface is not None:
            raise ValueError(FACE_NEEDS_NO_MEMORY)
        self._refuse_buried((x, y, z))
        self._tried_surface: Surface | None = None
        self._advanced_surface: Surface | None = None
        """Copy of a surface with memory that has received the motion of a compliant arm's tool ahead of the sensor."""
        self._obstacles = Obstacles(profile.obstacle, z, self._tip_height, self._on_surface_change)
        self._load = ToolLoad(self.robot.path, now, face, self._obstacles, parts.surface is not None)
        self._spindle = Spindle(profile.tool, now, seed) if profile.tool.spindle_rpm > 0.0 else None
        self._load.spindle = self._spindle
        self._is_simple = face is None and self._spindle is None and not self.has_memory
        """Whether surface and tool exert one force, without memory."""
        self._moment_of_tip = moment_matrix((0.0, 0.0, length))
        u, v, w = profile.tool.centre_of_gravity_mm
        self._moment_of_weight = moment_matrix((u / 1000.0, v / 1000.0, w / 1000.0))
        self._weight = profile.tool.mass_kg * _GRAVITY
        self.path: ArmPath = self._compliant_path(parts.sensor_stiffness) or self.robot.path
        """True path of the tool centre point."""
        self._load.path = self.path
        ((_, quaternion),) = self.path.orientations(np.array([now]))
        self._turn(quaternion)
        self.on_change: Callable[[float], object] = _unread
        """Callback for the time from which the wrench differs from the wrench read before, s; set by the sensor."""
        self.committed_until = self.path.committed_until
        """Function that returns the time up to which a wrench read now is final unless a fault changes it, s."""
        # A surface with memory would have to process a changed future again.
        self.predicted_until = self.committed_until if self.has_memory else self.path.predicted_until
        """Function that returns the time up to which a sensor that handles `on_change` may read the wrench, s."""
        self.path.on_change = self._on_path_change
        self.sensor = parts.sensor(self, now, seed)
        """Emulated sensor, powered up with the cell."""
        self._equip_robot((u / 1000.0, v / 1000.0, w / 1000.0))
        self.ledger = Ledger({**parts.faults, **OWN_FAULTS, **parts.faults})
        """Ledger of the cell's faults: known, injected and active faults."""
        for device in (self.robot, self.sensor):
            for target, handlers in device.handlers.items():
                self.ledger.attach(target, handlers)
        self.ledger.attach("surface", self._surface.handlers)
        self.ledger.attach("obstacle", self._obstacles.handlers)

    def _equip_robot(self, centre: Vector) -> None:
        """Pass contact force, sensor and load to a robot that uses them. `centre` is the centre of gravity, m."""
        robot: object = self.robot
        if isinstance(robot, FeelingRobot):
            robot.feel(self._contact_at)
        if isinstance(robot, EquippedRobot):
            robot.equip(self.sensor)
        if isinstance(robot, LoadedRobot):
            robot.carry(self._profile.tool.mass_kg, centre)

    def _compliant_path(self, sensor: SensorStiffness | None) -> CompliantPath | None:
        """Return the path of the tool on a compliant arm; None if the arm is rigid.

        Raises ValueError for a robot that does not support the configured compliance.
        """
        tool, arm = self._profile.tool, self._profile.arm
        if is_rigid(arm, self.robot):
            return None
        u, v, w = tool.centre_of_gravity_mm
        load = Load(tool.mass_kg, (u * 1e-3, v * 1e-3, (w - tool.length_mm) * 1e-3))
        step = STEP_S if self._spindle is None else FINE_STEP_S
        grid = Grid(
            self._powered_at, 1.0 / MEMORY_RATE_HZ if self.has_memory else step, has_memory=self.has_memory
        )
        contact = ToolContact(self._try_motion, self._accept_motion, self._plane_law)
        mode = mode_of(arm, self.robot)
        bearing = bearing_of(arm, self.robot, load, end_compliance(tool, sensor))
        return CompliantPath(self.robot.path, mode, bearing, contact, grid)

    def _try_motion(self, times: Floats, positions: Floats, velocities: Floats) -> Floats:
        """Return the force (n, 3) of surface, obstacles and unbalance on a tool with this motion, N.

        Has no side effects.
        """
        self._tried_surface = (self._advanced_surface or self._surface).aside()
        force = self._load.of_motion(self._tried_surface, times, (positions, velocities), count=False).force
        if self._spindle is not None:
            force = force + self._spindle.force(times, self.path.orientations(times))
        return force

    def _plane_law(self) -> PlaneLaw | None:
        """Return the law of the surface if it is a plane, and nothing else acts on a tool that is a point."""
        if self._has_plain_load and isinstance(self._surface, Contact):
            return self._surface.plane
        return None

    @property
    def _has_plain_load(self) -> bool:
        """Whether the load on the tool is one force, that of a surface without memory."""
        return self._is_simple and not self._obstacles.any

    def _accept_motion(self) -> None:
        """Accept the motion of the last trial: continue with the surface that has received this motion."""
        if self.has_memory:
            self._advanced_surface = self._tried_surface

    def _refuse_buried(self, start: Vector) -> None:
        """Raise ValueError if the tool starts deep inside our surface."""
        if not isinstance(self._surface, Contact):
            return
        depth = float(self._surface.depth_and_normal(np.array([start]))[0][0])
        if depth > _DEEPEST_M:
            raise ValueError(
                f"the tool starts {depth * 1e3:.0f} mm inside the surface (start_position_mm z "
                f"{start[2] * 1e3:g}); start above {(start[2] + depth) * 1e3:.0f} mm, or lower the surface"
            )

    def inject(self, target: str, fault: str, now: float, **parameters: object) -> Injection:
        """Inject a fault from now on, or at its next opportunity. The duration `for_s` is one of the parameters.

        Raises ValueError, in one line, for a fault unknown to this cell and for an invalid parameter.
        """
        return self.ledger.inject(target, fault, now, parameters)

    @property
    def faults(self) -> Sequence[Injection]:
        """All faults injected so far: target, fault, start, end, and number of effects of each."""
        return self.ledger.injections

    def _on_path_change(self, time: float) -> None:
        """Notify the sensor that an order has changed the path from this time on, s."""
        self._advanced_surface = None
        self.on_change(time)

    def _on_surface_change(self, time: float) -> None:
        """Handle a change of a surface or an obstacle from this time on, s."""
        self._surface.rewind(time)
        if isinstance(self.path, CompliantPath):
            self.path.rewind(time)
            self._advanced_surface = None
        self.on_change(time)

    def _tip_height(self, time: float) -> float:
        return float(self.path.trajectory(np.array([time]))[0][0, 2])

    def wrench(self, times: Floats) -> Floats:
        """Return the wrench (n, 6) on the tool about the sensor's origin in the sensor frame, N and N·m.

        `times` (n,) are in ascending order, s.
        """
        if not len(times):
            return np.empty((0, 6))
        remembered = self._surface.remembered_until
        if remembered is not None and remembered >= times[0]:
            self._surface.rewind(float(times[0]))
        force, moment = self._contact_load(self._surface, times)
        parts = []
        for part, quaternion in self.path.orientations(times):
            if quaternion != self._orientation:
                self._turn(quaternion)
            wrench = self._force_to_wrench @ force[part].T
            wrench += self._weight_wrench
            if moment is not None:
                wrench[3:] += self._rotation.T @ moment[part].T
            parts.append(wrench)
        wrenches = parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)
        if self._spindle is not None:
            wrenches += self._spindle.wrench(times)
        return wrenches.T

    def speeds(self, times: Floats) -> Floats:
        """Return the speed (n,) of the tool centre point, m/s, at `times` (n,) in ascending order, s."""
        _, velocities = self.path.trajectory(times)
        speeds: Floats = np.sqrt(np.einsum("ij,ij->i", velocities, velocities))
        return speeds

    def _turn(self, quaternion: Quaternion) -> None:
        """Compute the matrices for this orientation of the tool, which remains constant over many samples."""
        self._orientation = quaternion
        self._rotation = rotation = rotation_matrix(quaternion)
        self._force_to_wrench = force_to_wrench(rotation, self._moment_of_tip).T
        self._weight_wrench = (self._weight @ force_to_wrench(rotation, self._moment_of_weight))[:, None]

    def true_state(self, time: float) -> TrueState:
        """Return the true state at `time`, s."""
        return self.true_states((time,))[0]

    def true_states(self, times: Sequence[float]) -> list[TrueState]:
        """Return the true states at these times in ascending order, s. Many states cost little more than one."""
        at = np.array(times)
        positions, velocities = self.path.trajectory(at)
        # A copy, because reading the true state must not change the sensor's samples.
        surface = self._surface.aside()
        forces = self._contact_load(surface, at, count=False).force
        normals: list[Vector | None] = [None] * len(at)
        if isinstance(surface, ShapedSurface):
            rows = surface.normals(positions, at)
            normals = [None if any(map(math.isnan, row)) else row for row in _vectors(rows)]
        quaternions = [q for part, q in self.path.orientations(at) for _ in range(part.start, part.stop)]
        undeflected = positions  # position of a rigid arm, which the encoders measure
        if isinstance(self.path, CompliantPath):
            undeflected = self.robot.path.trajectory(at)[0]
        joints = [
            self.robot.joints_holding(Pose(position, quaternion), time)
            for position, quaternion, time in zip(_vectors(undeflected), quaternions, times, strict=True)
        ]
        if isinstance(self.path, CompliantPath):
            turns = zip(self.path.rotations(at).tolist(), quaternions, strict=True)
            quaternions = [normalise(product((1.0, 0.5 * x, 0.5 * y, 0.5 * z), q)) for (x, y, z), q in turns]
        vectors = (_vectors(rows) for rows in (positions, velocities, forces, positions - undeflected))
        motion = zip(*vectors, quaternions, joints, normals, strict=True)
        return [TrueState(p, v, q, force, j, n, d) for p, v, force, d, q, j, n in motion]

    def contact_forces(self, times: Floats) -> Floats:
        """Return the force of surface and obstacles on the tool (n, 3), base frame, N.

        It varies with the run-out of a spindle. The force of its unbalance is not included. `times` (n,) are
        in ascending order, s.
        """
        if (solved := self._solved_path) is not None:
            return solved.contact_forces(times)
        return self._load.at(self._surface.aside(), times, count=False).force

    def _contact_load(self, surface: Surface, times: Floats, count: bool = True) -> ContactLoad:
        """Return the load of the contact on the tool at `times` (n,) in ascending order, s."""
        if (solved := self._solved_path) is not None:
            return ContactLoad(solved.contact_forces(times), None)
        return self._load.at(surface, times, count)

    @property
    def _solved_path(self) -> CompliantPath | None:
        """Path of a compliant arm's tool if the points at which it was solved give the contact force.

        They do not for a face, which has a moment, for a surface with memory, for a tool with a spindle, whose
        unbalance they contain, and while samples are counted. A plug-in with faults counts its samples itself.
        """
        path, own = self.path, self._surface
        if not isinstance(path, CompliantPath) or not self._has_plain_load:
            return None
        is_counted = own.faults.faulty if isinstance(own, Contact) else bool(own.handlers)
        return None if is_counted else path

    def _contact_at(self, time: float) -> Vector:
        """Return the contact force at a past time, s, or at the earliest time that is still available."""
        return _vectors(self.contact_forces(np.array([self.truth_available_from(time)])))[0]

    def truth_available_from(self, time: float) -> float:
        """Return the earliest time, not before `time`, for which the true state is still available, s.

        A surface with memory discards everything before the newest sample that it has received.
        """
        remembered = self._surface.remembered_until
        return time if remembered is None else max(time, remembered)

    @property
    def removed(self) -> Removed | None:
        """Material that the tool has removed from the surface so far; None if the surface does not wear."""
        return self._surface.removed if isinstance(self._surface, Contact) else None


def _vectors(rows: Floats) -> list[Vector]:
    return [(x, y, z) for x, y, z in rows.tolist()]
