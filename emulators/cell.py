"""The emulated cell: any robot and any sensor, coupled by a tool and a surface. See `emulators.seams` for its parts.

Frames: the base has z up. The tool frame's z axis points out of the flange, so that a tool pointing down has the
quaternion (0, 1, 0, 0). The sensor frame has the tool frame's orientation and lies in the flange. The sensor reads the
wrench that surface and gravity exert on the tool: pressing down on the surface gives a negative Fz.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

from emulators.arm.compliance import ArmProfile, Load, bearing_of
from emulators.arm.compliant_path import STEP_S, CompliantPath, Grid, Mode
from emulators.arm.compliant_path import Contact as ToolContact
from emulators.faults import Fault, Injection, Ledger
from emulators.faults.bus import BUS_FAULTS
from emulators.faults.computer import COMPUTER_FAULTS
from emulators.seams import (
    ArmPath,
    EmulatedRobot,
    EmulatedSensor,
    FeelingRobot,
    Floats,
    Joints,
    LoadedRobot,
    ShapedSurface,
    StartPose,
    Surface,
    SurfaceFactory,
    WrenchSource,
)
from emulators.surface.contact import Contact, SurfaceProfile
from emulators.surface.face import ONE_POINT_REMEMBERED, Face, Pushed, joined, turning_of
from emulators.surface.faults import OBSTACLE_FAULTS, SURFACE_FAULTS, ObstacleProfile, Obstacles
from emulators.surface.removal import Removed
from protocol.geometry import Pose, Quaternion, Vector, normalise, product, rotation_rows
from protocol.marks import Mark, SettingError, between, check_settings, setting

_GRAVITY = np.array([0.0, 0.0, -9.80665])
"""Standard gravity in the base frame, m/s²."""
_DEEPEST_M = 0.02
"""Chosen: a tool that starts deeper inside the surface, m, is no tool that presses, but a wrong start."""
_HEAVIEST_KG = 10.0
"""Chosen: heaviest tool of the cell."""
_UP = np.array([0.0, 0.0, 1.0])
"""Base z."""
_PAST_S = 10.0
"""How much of the motion a surface with memory is shown late, s: as much as an arm's path keeps."""
_SPREAD_AT_ONCE = 128
"""Chosen: samples of a face that are computed at once. Larger arrays do not stay in a processor's cache."""
_TURN_S = 0.02
"""The turning of a tool is its mean over so long before, s. Chosen: some ticks of an arm, between which it is still."""
_MEMORY_RATE_HZ = 8000
"""Chosen: a surface with memory is shown at least so many samples a second, as many as our sensor takes."""

OWN_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "bus": BUS_FAULTS,
    "surface": SURFACE_FAULTS,
    "obstacle": OBSTACLE_FAULTS,
    "computer": COMPUTER_FAULTS,
}
"""Faults beside those of the devices, by target. The bridge carries out those of bus and computer."""

Robot = TypeVar("Robot", bound=EmulatedRobot)
Sensor = TypeVar("Sensor", bound=EmulatedSensor)


def _unread(time: float) -> None:
    """No sensor has read anything."""


class WrongForce(Exception):
    """A surface of a plug-in answered with what is no force. `blamed` is the surface and its method."""

    def __init__(self, surface: Surface, positions: Floats, force: object) -> None:
        if isinstance(force, np.ndarray) and force.shape == positions.shape:
            row = int(np.argmin(np.isfinite(force.astype(float)).all(axis=1)))
            text = f"the surface answers {force[row].tolist()} N for a tip at {positions[row].round(6).tolist()} m"
        else:
            told = f"shape {force.shape}" if isinstance(force, np.ndarray) else type(force).__name__
            text = f"the surface answers {told} for {len(positions)} positions, not an array of shape {positions.shape}"
        super().__init__(text)
        self.blamed = surface, "force"


@dataclass(frozen=True, slots=True)
class ToolProfile:
    """The rigid tool behind the sensor."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    length_mm: float = setting(
        200.0, Mark.CHOSEN, "sensor to tip, along tool z", between(0.0, 1000.0), unit="mm"
    )
    mass_kg: float = setting(
        0.5, Mark.CHOSEN, "what the sensor carries", between(0.0, _HEAVIEST_KG), unit="kg"
    )
    centre_of_gravity_mm: Vector = setting(
        (0.0, 0.0, 80.0), Mark.CHOSEN, "centre of that mass in the sensor frame", unit="mm"
    )
    face_radius_mm: float = setting(
        0.0,
        Mark.CHOSEN,
        "radius of its face, a flat disc perpendicular to tool z about the tip; 0 for a point",
        between(0.0, 500.0),
        unit="mm",
    )
    face_rings: int = setting(
        3,
        Mark.CHOSEN,
        "rings of contact points of that face about the one in its middle: 7 points with 1, 19 with 2, 37 with 3",
        between(1, 8),
    )

    def __post_init__(self) -> None:
        if _HEAVIEST_KG < self.mass_kg <= _HEAVIEST_KG * 1e3:
            raise SettingError(
                "mass_kg",
                f"must be at most {_HEAVIEST_KG:g}, got {self.mass_kg:g}; it is in kg, did you mean "
                f"{self.mass_kg * 1e-3:g}?",
            )
        check_settings(self)


@dataclass(frozen=True, slots=True)
class CellProfile:
    """Tool, surface and start of an emulated cell: all but its devices."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    arm: ArmProfile = field(default_factory=ArmProfile)
    tool: ToolProfile = field(default_factory=ToolProfile)
    surface: SurfaceProfile = field(default_factory=SurfaceProfile)
    obstacle: ObstacleProfile = field(default_factory=ObstacleProfile)
    start_position_mm: Vector = setting(
        (900.0, -100.0, 600.0),
        Mark.CHOSEN,
        "tool centre point at power-up, base frame",
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
    """The truth, which no device tells: for tests and comparisons."""

    position: Vector
    """Tool centre point in the base frame, m."""
    velocity: Vector
    """Velocity of the tool in the base frame, m/s."""
    quaternion: Quaternion
    """Tool frame in the base frame, w x y z."""
    contact_force: Vector
    """Force of surface and obstacles on the tool in the base frame, N: of a face, the sum of all its points."""
    joints: Joints | None
    """Axes of the robot, axis 1 first, rad; None where the robot tells none."""
    normal: Vector | None = None
    """Outward unit normal of the surface below the tool centre point, base frame; None where the surface tells none."""


@dataclass(frozen=True, slots=True)
class Parts(Generic[Robot, Sensor]):
    """The devices of a cell, and how each is made; see `emulators.seams` for the factories."""

    robot: Callable[[StartPose, float, int], Robot]
    """A `RobotFactory`: start, time of power-up in s, seed."""
    sensor: Callable[[WrenchSource, float, int], Sensor]
    """A `SensorFactory`: what it feels, time of power-up in s, seed."""
    surface: SurfaceFactory | None = None
    """The contact model; by default that of the cell's profile."""
    faults: Mapping[str, Mapping[str, Fault]] = field(default_factory=dict)
    """Words for the faults of the devices, by target; their handlers carry them out."""


class Cell(Generic[Robot, Sensor]):
    """A robot, and a sensor that touches the same surface as the robot's tool: the sensor's `WrenchSource`.

    Raises ValueError for a start that the robot cannot hold, and for a surface that cannot be or not with this tool.
    """

    def __init__(self, profile: CellProfile, now: float, seed: int, parts: Parts[Robot, Sensor]) -> None:
        x, y, z = (p / 1000.0 for p in profile.start_position_mm)
        length = profile.tool.length_mm / 1000.0
        self.robot = parts.robot(StartPose((x, y, z), profile.start_quaternion, length), now, seed)
        """Powered up with the cell."""
        self._profile = profile
        self._powered_at = now
        radius = profile.tool.face_radius_mm / 1000.0
        self._face = Face(radius, profile.tool.face_rings) if radius > 0.0 else None
        self._surface: Surface
        self._foreign = parts.surface is not None
        """The surface is not ours, so that its answers are looked at."""
        if parts.surface is None:
            self._surface = Contact(profile.surface, self._changed, self._face)
        else:
            self._surface = parts.surface(self._changed)
            if self._face is not None and self.has_memory:
                raise ValueError(ONE_POINT_REMEMBERED)
        self._refuse_buried((x, y, z))
        self._asked_surface: Surface | None = None
        self._kept_surface: Surface | None = None
        """A surface with memory that has seen the motion of a compliant arm's tool further than the sensor has."""
        self._obstacles = Obstacles(profile.obstacle, z, self._tip_height, self._changed)
        self._moment_of_tip = moment_matrix((0.0, 0.0, length))
        u, v, w = profile.tool.centre_of_gravity_mm
        self._moment_of_weight = moment_matrix((u / 1000.0, v / 1000.0, w / 1000.0))
        self._weight = profile.tool.mass_kg * _GRAVITY
        self.path: ArmPath = self._compliant_path() or self.robot.path
        """True path of the tool centre point."""
        path = self.path
        ((_, quaternion),) = path.orientations(np.array([now]))
        self._turn(quaternion)
        self.on_change: Callable[[float], object] = _unread
        """Called by the cell with the time from which the wrench differs from the one read, s; set by the sensor."""
        self.committed_until = path.committed_until
        """Up to when the wrench may be read at a given time and stays unless a fault changes it, s."""
        # A surface with memory would have to be shown a changed future again.
        self.predicted_until = path.committed_until if self.has_memory else path.predicted_until
        """Up to when it may be read by a sensor that minds `on_change`, s."""
        path.on_change = self._moved_otherwise
        self.sensor = parts.sensor(self, now, seed)
        """Powered up with the cell."""
        robot: object = self.robot
        if isinstance(robot, FeelingRobot):
            robot.feel(self._contact_at)
        if isinstance(robot, LoadedRobot):
            robot.carry(profile.tool.mass_kg, (u / 1000.0, v / 1000.0, w / 1000.0))
        self.ledger = Ledger({**parts.faults, **OWN_FAULTS, **parts.faults})
        """The faults of the cell."""
        for device in (self.robot, self.sensor):
            for target, handlers in device.handlers.items():
                self.ledger.attach(target, handlers)
        self.ledger.attach("surface", self._surface.handlers)
        self.ledger.attach("obstacle", self._obstacles.handlers)

    def _compliant_path(self) -> CompliantPath | None:
        """Return the path of the tool on a compliant arm; None for a rigid one. Raises ValueError for a robot that
        cannot have the compliance.
        """
        tool, arm = self._profile.tool, self._profile.arm
        if arm.compliance == "rigid":
            return None
        u, v, w = tool.centre_of_gravity_mm
        load = Load(tool.mass_kg, (u * 1e-3, v * 1e-3, (w - tool.length_mm) * 1e-3))
        grid = Grid(self._powered_at, 1.0 / _MEMORY_RATE_HZ if self.has_memory else STEP_S)
        contact = ToolContact(self._force_on_moving_tool, self._keep_surface)
        mode = Mode(arm.frequency_hz, arm.damping_ratio)
        return CompliantPath(self.robot.path, mode, bearing_of(arm, self.robot, load), contact, grid)

    def _force_on_moving_tool(self, times: Floats, positions: Floats, velocities: Floats) -> Floats:
        """Force (n, 3), N, of surface and obstacles on a tool with this motion; a question that changes nothing."""
        self._asked_surface = (self._kept_surface or self._surface).aside()
        return self._pushed_back(self._asked_surface, times, (positions, velocities), count=False).force

    def _keep_surface(self) -> None:
        """Continue from the surface that was asked last: it has seen the motion up to the newest one."""
        if self.has_memory:
            self._kept_surface = self._asked_surface

    def _refuse_buried(self, start: Vector) -> None:
        """Raise ValueError for a tool that starts deep inside our surface."""
        if not isinstance(self._surface, Contact):
            return
        depth = float(self._surface.depth_and_normal(np.array([start]))[0][0])
        if depth > _DEEPEST_M:
            raise ValueError(
                f"the tool starts {depth * 1e3:.0f} mm inside the surface (start_position_mm z "
                f"{start[2] * 1e3:g}); start above {(start[2] + depth) * 1e3:.0f} mm, or lower the surface"
            )

    def inject(self, target: str, fault: str, now: float, **parameters: object) -> Injection:
        """Let a fault happen from now on, or at its next opportunity; `for_s` is a parameter too.

        Raises ValueError, in one line, for one that this cell cannot have and for a wrong parameter.
        """
        return self.ledger.inject(target, fault, now, parameters)

    @property
    def faults(self) -> Sequence[Injection]:
        """All that were injected so far: target, fault, begin, end, and how often each had an effect."""
        return self.ledger.injections

    def _moved_otherwise(self, time: float) -> None:
        """Note that an order has changed the path from this time on, s."""
        self._kept_surface = None
        self.on_change(time)

    def _changed(self, time: float) -> None:
        """Surface or obstacle are others from this time on, s."""
        self._surface.rewind(time)
        if isinstance(self.path, CompliantPath):
            self.path.rewind(time)
            self._kept_surface = None
        self.on_change(time)

    def _tip_height(self, time: float) -> float:
        return float(self.path.trajectory(np.array([time]))[0][0, 2])

    def wrench(self, times: Floats) -> Floats:
        """Wrench (n, 6) on the tool about the sensor's origin in the sensor frame, N and N·m.

        `times` (n,) ascend, s.
        """
        wrenches = np.empty((6, len(times)))
        if not len(times):
            return wrenches.T
        shown = self._surface.remembered_until
        if shown is not None and shown >= times[0]:
            self._surface.rewind(float(times[0]))
        pushed = self._pushed(self._surface, times)
        forces, moments = pushed.force.T, None if pushed.moment is None else pushed.moment.T
        for part, quaternion in self.path.orientations(times):
            if quaternion != self._turned:
                self._turn(quaternion)
            np.matmul(self._force_to_wrench, forces[:, part], out=wrenches[:, part])
            wrenches[:, part] += self._weight_wrench
            if moments is not None:
                wrenches[3:, part] += self._rotation.T @ moments[:, part]
        return wrenches.T

    def speeds(self, times: Floats) -> Floats:
        """Speed (n,) of the tool centre point, m/s, at ascending `times` (n,), s."""
        _, velocities = self.path.trajectory(times)
        speeds: Floats = np.sqrt(np.einsum("ij,ij->i", velocities, velocities))
        return speeds

    def _turn(self, quaternion: Quaternion) -> None:
        """Prepare for this orientation of the tool: it stays the same over many samples."""
        self._turned = quaternion
        self._rotation = rotation = rotation_matrix(quaternion)
        self._force_to_wrench = force_to_wrench(rotation, self._moment_of_tip).T
        self._weight_wrench = (self._weight @ force_to_wrench(rotation, self._moment_of_weight))[:, None]

    def true_state(self, time: float) -> TrueState:
        """Return the truth at `time`, s."""
        return self.true_states((time,))[0]

    def true_states(self, times: Sequence[float]) -> list[TrueState]:
        """Return the truth at each of these ascending times, s; many at once cost little more than one."""
        at = np.array(times)
        positions, velocities = self.path.trajectory(at)
        # A copy, because a question for the truth must not change the sensor's samples.
        surface = self._surface.aside()
        forces = self._pushed(surface, at, count=False).force
        normals = surface.normals(positions, at) if isinstance(surface, ShapedSurface) else None
        quaternions = [q for part, q in self.path.orientations(at) for _ in range(part.start, part.stop)]
        seen = positions
        turns = None
        if isinstance(self.path, CompliantPath):
            seen, turns = self.robot.path.trajectory(at)[0], self.path.rotations(at)
        states = []
        for k, time in enumerate(times):
            position, quaternion = _vector(positions[k]), quaternions[k]
            joints = self.robot.joints_holding(Pose(_vector(seen[k]), quaternion), time)
            if turns is not None:
                quaternion = normalise(product((1.0, *(0.5 * turns[k]).tolist()), quaternion))
            normal = None if normals is None or np.isnan(normals[k]).any() else _vector(normals[k])
            states.append(
                TrueState(position, _vector(velocities[k]), quaternion, _vector(forces[k]), joints, normal)
            )
        return states

    def contact_forces(self, times: Floats) -> Floats:
        """Force of surface and obstacles on the tool (n, 3) at ascending `times` (n,), s, base frame, N."""
        return self._pushed(self._surface.aside(), times, count=False).force

    def _contact_at(self, time: float) -> Vector:
        """Return the contact force at a past time, s; of a surface with memory the oldest that is still known."""
        return _vector(self.contact_forces(np.array([self.truth_available_from(time)]))[0])

    def truth_available_from(self, time: float) -> float:
        """Return the earliest moment from `time` on, s, of which the truth is still known.

        A surface with memory has lost all before the newest sample that it was shown.
        """
        shown = self._surface.remembered_until
        return time if shown is None else max(time, shown)

    @property
    def removed(self) -> Removed | None:
        """Depths that the tool has removed from the surface so far; None where the surface does not wear."""
        return self._surface.removed if isinstance(self._surface, Contact) else None

    @property
    def has_memory(self) -> bool:
        """Whether the force depends on more than the present motion, so that truths have to be asked for in time."""
        return self._surface.remembered_until is not None

    def _pushed(self, surface: Surface, times: Floats, count: bool = True) -> Pushed:
        """Force and moment of surface and obstacles on the tool at ascending `times` (n,), s."""
        return self._pushed_back(surface, times, self.path.trajectory(times), count)

    def _pushed_back(
        self, surface: Surface, times: Floats, motion: tuple[Floats, Floats], count: bool = True
    ) -> Pushed:
        """Return the same for positions and velocities (n, 3) of the tool.

        A surface with memory is first shown the samples since power-up that were never read. So its force depends on
        the motion and not on the reads. Where it cannot go back far enough, it answers as if the tip jumped there.
        """
        if (shown := surface.remembered_until) is not None:
            begin = max(shown, times[0] - _PAST_S, self._powered_at) * _MEMORY_RATE_HZ
            # Samples are numbered; a millionth keeps rounding from moving one across.
            missed = np.arange(math.floor(begin + 1e-6) + 1, math.ceil(times[0] * _MEMORY_RATE_HZ - 1e-6))
            if len(missed):
                past = missed / _MEMORY_RATE_HZ
                self._touched(surface, past, *self.path.trajectory(past))
        positions, velocities = motion
        force, moment = self._touched(surface, times, positions, velocities)
        if self._obstacles.any:
            force = force + np.outer(self._obstacles.force(positions[:, 2], times, count), _UP)
        return Pushed(force, moment)

    def _touched(self, surface: Surface, times: Floats, positions: Floats, velocities: Floats) -> Pushed:
        """Force and moment of the surface alone on a tool with these positions and velocities (n, 3) of its centre."""
        if self._face is None:
            return Pushed(self._answered(surface, positions, velocities, times), None)
        parts = []
        for begin in range(0, len(times), _SPREAD_AT_ONCE):
            part = slice(begin, begin + _SPREAD_AT_ONCE)
            orientations = self.path.orientations(times[part])
            before = self.path.orientations(times[part] - _TURN_S)
            turning = turning_of(orientations, before, _TURN_S)
            points = self._face.spread(
                positions[part], velocities[part], orientations, rotation_matrix, turning
            )
            times_of_points = np.repeat(times[part], self._face.count)
            forces = self._answered(surface, points.positions, points.velocities, times_of_points)
            parts.append(self._face.gathered(forces, points.arms))
        return joined(parts)

    def _answered(self, surface: Surface, positions: Floats, velocities: Floats, times: Floats) -> Floats:
        """Check the forces of a surface. Raises WrongForce for an invalid answer of a plug-in."""
        force: Any = surface.force(positions, velocities, times)
        if self._foreign and not (
            isinstance(force, np.ndarray) and force.shape == positions.shape and np.isfinite(force).all()
        ):
            raise WrongForce(surface, positions, force)
        answered: Floats = force
        return answered


def rotation_matrix(quaternion: Quaternion) -> Floats:
    """Matrix (3, 3) whose columns are the rotated frame's axes, of a unit quaternion w x y z."""
    return np.array(rotation_rows(quaternion))


def moment_matrix(arm: Vector) -> Floats:
    """Matrix (3, 3) that turns row forces into row moments; `arm` is where the force acts, m."""
    x, y, z = arm
    return np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])


def force_to_wrench(rotation: Floats, moment: Floats) -> Floats:
    """Matrix (3, 6) that turns row forces in the base frame into row wrenches in the sensor frame.

    `rotation` (3, 3) is the sensor frame in the base frame, `moment` (3, 3) the matrix of where the force acts there.
    """
    matrix = np.empty((3, 6))
    matrix[:, :3] = rotation
    matrix[:, 3:] = rotation @ moment
    return matrix


def _vector(row: Floats) -> Vector:
    x, y, z = row.tolist()
    return x, y, z
