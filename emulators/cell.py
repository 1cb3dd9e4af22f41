"""The emulated cell: robot, tool, surface and sensor coupled, each behind the wire of the real one.

Frames: base with z up; the tool frame's z axis points out of the flange, so that a tool pointing down has the
quaternion (0, 1, 0, 0); the sensor frame has the tool frame's orientation and lies in the flange. The sensor
reads the wrench that surface and gravity exert on the tool: pressing down on the surface gives a negative Fz.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from emulators.arm.kinematics import Joints
from emulators.arm.loops import ServoProfile
from emulators.cell_faults import CELL_FAULTS
from emulators.faults import Handler, Injection, Ledger
from emulators.jr3 import Gateway, GatewayProfile, Jr3Sensor, SensorProfile, UartGateway, UartGatewayProfile
from emulators.jr3.board import Board, BoardProfile
from emulators.jr3.sensor import SENSOR_RATE_HZ
from emulators.s3 import EMPTY_SITE, S3Controller, S3Profile, S3Site
from emulators.surface.contact import Contact, SurfaceProfile
from emulators.surface.faults import ObstacleProfile, Obstacles
from protocol.geometry import Quaternion, Vector
from protocol.marks import Mark, check_settings, setting
from protocol.s3.adlp import LinkProfile

Floats = NDArray[np.float64]

_GRAVITY = np.array([0.0, 0.0, -9.80665])
"""Standard gravity in the base frame, m/s²."""
_UP = np.array([0.0, 0.0, 1.0])
"""Base z."""
_PAST_S = 10.0
"""How much of what nobody measured a material is shown: as much as the motion keeps."""


@dataclass(frozen=True, slots=True)
class ToolProfile:
    """The rigid tool behind the sensor."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    length_mm: float = setting(
        200.0, Mark.CHOSEN, "sensor to tip, along tool z", unit="mm", minimum=0.0, maximum=1000.0
    )
    mass_kg: float = setting(
        0.5, Mark.CHOSEN, "what the sensor carries", unit="kg", minimum=0.0, maximum=10.0
    )
    centre_of_gravity_mm: Vector = setting(
        (0.0, 0.0, 80.0), Mark.CHOSEN, "centre of that mass in the sensor frame", unit="mm"
    )

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True)
class CellProfile:
    """Everything that an emulated cell is made of."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    robot: S3Profile = field(default_factory=S3Profile)
    servo: ServoProfile = field(default_factory=ServoProfile)
    link: LinkProfile = field(default_factory=LinkProfile)
    tool: ToolProfile = field(default_factory=ToolProfile)
    surface: SurfaceProfile = field(default_factory=SurfaceProfile)
    obstacle: ObstacleProfile = field(default_factory=ObstacleProfile)
    sensor: SensorProfile = field(default_factory=SensorProfile)
    gateway: GatewayProfile = field(default_factory=GatewayProfile)
    uart_gateway: UartGatewayProfile = field(default_factory=UartGatewayProfile)
    board: BoardProfile = field(default_factory=BoardProfile)
    start_position_mm: Vector = setting(
        (900.0, -100.0, 600.0),
        Mark.CHOSEN,
        "tool centre point at power-up, base frame",
        unit="mm",
        minimum=-4095.0,
        maximum=4095.0,
    )
    start_quaternion: Quaternion = setting(
        (0.0, 1.0, 0.0, 0.0), Mark.CHOSEN, "tool frame at power-up in the base frame, w x y z"
    )

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True)
class TrueState:
    """What the emulator knows and no device tells: for tests and comparisons."""

    position: Vector
    """Tool centre point in the base frame, m."""
    velocity: Vector
    """Its velocity in the base frame, m/s."""
    quaternion: Quaternion
    """Tool frame in the base frame, w x y z."""
    contact_force: Vector
    """Force of the surface, and of what hangs above, on the tool tip in the base frame, N."""
    joints: Joints
    """Axes 1 to 6, rad; zero position as assumed in `emulators.arm.kinematics`."""


class _Faulty(Protocol):
    """A receiver of the sensor that can go wrong."""

    @property
    def handlers(self) -> Mapping[str, Mapping[str, Handler]]:
        """By target."""


_Receiver = TypeVar("_Receiver", bound=_Faulty)


class Cell:
    """A robot, and a sensor that touches what it touches, each behind its wire.

    `robot` and `uart_gateway` are endpoints of bytes, `gateway` is one of CAN frames, `board` is registers. Raises
    ValueError for a start outside the robot's work area.
    """

    def __init__(self, profile: CellProfile, now: float, seed: int, site: S3Site = EMPTY_SITE) -> None:
        x, y, z = (p / 1000.0 for p in profile.start_position_mm)
        length = profile.tool.length_mm / 1000.0
        self.robot = S3Controller(
            profile.robot,
            profile.link,
            profile.servo,
            (x, y, z),
            profile.start_quaternion,
            now,
            seed,
            tool_length=length,
            site=site,
        )
        self._profile = profile
        self._powered_at = now
        self._seed = seed
        self._motion = self.robot.motion.path
        self._contact = Contact(profile.surface, self._changed)
        self._obstacles = Obstacles(profile.obstacle, z, self._tip_height, self._changed)
        motion = self._motion
        # A material that remembers cannot unlearn what came otherwise.
        foreseen_until = None if self.remembers else motion.predicted_until
        self.sensor = Jr3Sensor(profile.sensor, self.wrench, seed, motion.committed_until, foreseen_until)
        """What every receiver of the sensor reads. A sensor has one plug: use one receiver of a cell."""
        motion.on_change = self.sensor.forget
        self.sensor.on_change = self._contact.rewind
        self.ledger = Ledger(CELL_FAULTS)
        """What goes wrong on purpose."""
        for target, handlers in self.robot.handlers.items():
            self.ledger.attach(target, handlers)
        self.ledger.attach("signal", self.sensor.signal.handlers)
        self.ledger.attach("surface", self._contact.faults.handlers)
        self.ledger.attach("obstacle", self._obstacles.handlers)
        self._tip = np.array([0.0, 0.0, length])
        self._centre_of_gravity = np.array(profile.tool.centre_of_gravity_mm) / 1000.0
        self._weight = profile.tool.mass_kg * _GRAVITY
        self._turn(self._motion.orientation(now))

    @cached_property
    def gateway(self) -> Gateway:
        """The sensor's CAN gateway, powered with the cell."""
        return self._with_faults(Gateway(self._profile.gateway, self.sensor, self._powered_at, self._seed))

    @cached_property
    def uart_gateway(self) -> UartGateway:
        """The sensor's UART gateway, powered with the cell."""
        return self._with_faults(
            UartGateway(self._profile.uart_gateway, self.sensor, self._powered_at, self._seed)
        )

    @cached_property
    def board(self) -> Board:
        """The sensor's receiver board, powered with the cell."""
        return self._with_faults(Board(self._profile.board, self.sensor, self._powered_at))

    def inject(self, target: str, fault: str, now: float, **parameters: object) -> Injection:
        """Let a fault of `CELL_FAULTS` happen from now on, or at its next opportunity; `for_s` is a parameter too.

        Raises ValueError, in one line, for one that this cell cannot have and for a wrong parameter.
        """
        return self.ledger.inject(target, fault, now, parameters)

    @property
    def faults(self) -> Sequence[Injection]:
        """All that were injected so far: target, fault, begin, end, and how often each had an effect."""
        return self.ledger.injections

    def _with_faults(self, receiver: _Receiver) -> _Receiver:
        for target, handlers in receiver.handlers.items():
            self.ledger.attach(target, handlers)
        return receiver

    def _changed(self, time: float) -> None:
        """What the tool touches is another from this time on, s."""
        self.sensor.change(math.ceil(time * SENSOR_RATE_HZ - 1e-6))

    def _tip_height(self, time: float) -> float:
        return float(self._motion.trajectory(np.array([time]))[0][0, 2])

    def wrench(self, times: Floats) -> Floats:
        """Wrench (n, 6) on the tool about the sensor's origin in the sensor frame, N and N·m.

        `times` (n,) ascend, s.
        """
        wrenches = np.empty((6, len(times)))
        if not len(times):
            return wrenches.T
        forces = self._contact_force(self._contact, times).T
        for part, quaternion in self._motion.orientations(times):
            if quaternion != self._turned:
                self._turn(quaternion)
            np.matmul(self._force_to_wrench, forces[:, part], out=wrenches[:, part])
            wrenches[:, part] += self._weight_wrench
        return wrenches.T

    def _turn(self, quaternion: Quaternion) -> None:
        """Prepare for this orientation of the tool: it stays the same over many samples."""
        self._turned = quaternion
        rotation = rotation_matrix(np.array(quaternion))
        self._force_to_wrench = force_to_wrench(rotation, self._tip).T
        self._weight_wrench = (self._weight @ force_to_wrench(rotation, self._centre_of_gravity))[:, None]

    def true_state(self, time: float) -> TrueState:
        """The truth at `time`, s."""
        return self.true_states((time,))[0]

    def true_states(self, times: Sequence[float]) -> list[TrueState]:
        """The truth at each of these ascending times, s; many at once cost little more than one."""
        at = np.array(times)
        positions, velocities = self._motion.trajectory(at)
        # A copy: whoever asks for the truth must not change what the sensor will read.
        forces = self._contact_force(self._contact.aside(), at, count=False)
        quaternions = [q for part, q in self._motion.orientations(at) for _ in range(part.start, part.stop)]
        states = []
        for k, time in enumerate(times):
            position, quaternion = _vector(positions[k]), quaternions[k]
            joints = self.robot.joints_holding(position, quaternion, time)
            states.append(TrueState(position, _vector(velocities[k]), quaternion, _vector(forces[k]), joints))
        return states

    def contact_forces(self, times: Floats) -> Floats:
        """Force of the surface on the tool tip (n, 3) at ascending `times` (n,), s, base frame, N."""
        return self._contact_force(self._contact.aside(), times, count=False)

    def tellable_from(self, time: float) -> float:
        """The earliest moment from `time` on, s, of which the truth can still be told: a material that remembers has
        forgotten what was before the newest sample that it was shown.
        """
        shown = self._contact.remembered_until
        return time if shown is None else max(time, shown)

    @property
    def remembers(self) -> bool:
        """Whether the force depends on more than the present motion, so that truths have to be asked for in time."""
        return self._contact.remembered_until is not None

    def _contact_force(self, contact: Contact, times: Floats, count: bool = True) -> Floats:
        """Force of the surface, and of what hangs above the tool, (n, 3) at ascending `times` (n,), base frame, N.

        A material that remembers is first shown the samples that nobody read, so that its force is one of
        the motion and not of who looked when. It cannot go back: for times before what it was shown, it
        answers as if the tip jumped there.
        """
        shown = contact.remembered_until
        if shown is not None:
            begin = max(shown, times[0] - _PAST_S) * SENSOR_RATE_HZ
            # Samples are numbered; a millionth keeps rounding from moving one across.
            missed = np.arange(math.floor(begin + 1e-6) + 1, math.ceil(times[0] * SENSOR_RATE_HZ - 1e-6))
            if len(missed):
                past = missed / SENSOR_RATE_HZ
                contact.force(*self._motion.trajectory(past), past)
        positions, velocities = self._motion.trajectory(times)
        force = contact.force(positions, velocities, times)
        if self._obstacles.any:
            force = force + np.outer(self._obstacles.force(positions[:, 2], times, count), _UP)
        return force


def rotation_matrix(quaternion: Floats) -> Floats:
    """Matrix (3, 3) whose columns are the rotated frame's axes, of a unit quaternion w x y z."""
    w, x, y, z = quaternion.tolist()
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def force_to_wrench(rotation: Floats, arm: Floats) -> Floats:
    """Matrix (3, 6) that turns row forces in the base frame into row wrenches in the sensor frame.

    `rotation` (3, 3) is the sensor frame in the base frame, `arm` (3,) where the force acts, sensor frame, m.
    """
    x, y, z = arm.tolist()
    moment = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
    return np.hstack((rotation, rotation @ moment))


def _vector(row: Floats) -> Vector:
    x, y, z = row.tolist()
    return x, y, z
