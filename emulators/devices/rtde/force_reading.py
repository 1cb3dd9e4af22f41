"""actual_TCP_force of the emulated controller: the reading of its sensor minus the weight of the configured
payload.

The sources state what is subtracted, and when. Universal Robots' forum, thread 2053: the weight of the configured
payload, also from the force of an external sensor. It has 9.82 N for 1 kg, and 0.982 N·m with its centre 0.1 m away
(right-handed here; that thread has the opposite sign of the moments). Universal_Robots_ROS_Driver, issues 512 and
643: an e-Series is zeroed at each start of a program. Script manual, and forum, thread 25749: zero_ftsensor()
applies to the built-in sensor only. Universal_Robots_ROS2_Driver, issue 1849: an external force is reported about
the tool. The same driver, pull request 1287: the force of an e-Series's own sensor is reported about the flange.
"""

import math
from typing import NamedTuple

from emulators.arm.own_force import NO_WRENCH, OwnForce
from emulators.devices.rtde.arm import ZERO
from emulators.devices.rtde.drives import own_errors
from emulators.devices.rtde.force_mode import about_tool, external_wrench
from emulators.devices.rtde.io import EXTERNAL_FORCE
from emulators.devices.rtde.manipulator import Manipulator
from emulators.devices.rtde.pose_error import PoseError
from emulators.devices.rtde.profile import RtdeProfile
from emulators.devices.rtde.running import Watchdog
from emulators.devices.rtde.state import Registers
from emulators.seams import ContactSource
from protocol.devices.rtde.fields import Value
from protocol.devices.rtde.force import GRAVITY
from protocol.geometry import Pose, Quaternion, Vector, Wrench, inverse, rotate

_BASE: Quaternion = (1.0, 0.0, 0.0, 0.0)


class Load(NamedTuple):
    """Load on a flange."""

    mass: float = 0.0
    """Mass, kg."""
    centre: Vector = (0.0, 0.0, 0.0)
    """Centre of gravity in the flange frame, m."""

    def weight(self, turn: Quaternion) -> Wrench:
        """Return the weight of the load on a flange of this orientation, N and N·m, in base axes and with moments
        about the flange.
        """
        x, y, _ = rotate(turn, self.centre)
        force = -GRAVITY * self.mass
        return 0.0, 0.0, force, y * force, -x * force, 0.0


class Tool(NamedTuple):
    """Tool in one cycle, as the controller is configured."""

    turn: Quaternion
    """Orientation of the flange."""
    tcp: Pose
    """Tool centre point in the flange frame."""
    payload: Load


class ForceReading:
    """Force of one controller, cycle by cycle, in base axes, N and N·m."""

    def __init__(self, profile: RtdeProfile, seed: int, now: float) -> None:
        self._max_force_n = profile.max_force_n
        self.external = False
        """Whether `external_force_torque` is the force sensor."""
        rate = profile.force_watchdog_hz
        self.watchdog = Watchdog(EXTERNAL_FORCE, 1.0 / rate if rate else math.inf, "pause", now)
        self.payload: tuple[float, ...] = (0.0,) * 4
        """Configured payload: mass, kg, and centre of gravity, m."""
        self.own = OwnForce(own_errors(profile), seed)
        """Force measured by the arm itself, without weights."""
        range_n = profile.force_pose_error_n
        self._pose_error = PoseError(range_n, seed) if any(range_n) else None
        self._joints = ZERO
        """Joint angles in the newest cycle, rad."""
        self.load = Load()
        """Actual load on the flange."""
        self._at_tcp = profile.force_point == "tcp"
        self._turns = profile.force_offset_axes == "flange"
        self.zeros: tuple[Wrench, Wrench] = (NO_WRENCH, NO_WRENCH)
        """Zeros to subtract: from the reading of the own sensor, and from the force for force mode. They are in the
        axes of the sensor's offset.
        """
        self._weights: tuple[Wrench, Wrench] = (NO_WRENCH, NO_WRENCH)
        """Weight that the payload does not account for in both readings in the newest cycle, in base axes."""
        self._turn = _BASE
        """Orientation of the sensor's offset in the newest cycle."""
        self.tool_force: Wrench = NO_WRENCH
        """Reported force, with moments about the tool."""

    def feel(self, contact: ContactSource) -> None:
        """Set the source of the contact force. The arm measures it with the error of its pose."""
        error = self._pose_error
        self.own.feel(contact if error is None else lambda at: error.measure(contact(at), self._joints))

    def carry(self, mass: float, centre: Vector) -> None:
        """Put a load on the flange, kg and m, and configure it as the payload, as an operator does."""
        self.load, self.payload = Load(mass, centre), (mass, *centre)

    def enable_external(self, enable: bool, now: float) -> None:
        """Select the force sensor: `external_force_torque` or the arm's own sensor."""
        self.external, self.watchdog.last = enable, now

    def is_overdue(self, now: float) -> bool:
        """Return whether an external force is overdue."""
        return self.external and self.watchdog.is_overdue(now)

    def problem(self) -> str:
        """Return the reason of a protective stop that an external force causes, or an empty string."""
        too_large = self.external and math.hypot(*self.tool_force[:3]) > self._max_force_n
        return "the force is too large" if too_large else ""

    def zero(self) -> None:
        """Zero the own sensor at the current force. A non-finite force leaves the zero unchanged."""
        turn = inverse(self._turn)
        reported, sensed = (_turned(turn, _plus(self.own.level, weight)) for weight in self._weights)
        if all(map(math.isfinite, (*reported, *sensed))):
            self.zeros = reported, sensed

    def read(self, now: float, inputs: Registers, manipulator: Manipulator) -> Wrench:
        """Return actual_TCP_force, from the force that a client sends or from the arm's own sensor."""
        self._joints = manipulator.joints
        mass, x, y, z = self.payload
        tool = Tool(manipulator.turn, manipulator.tcp, Load(mass, (x, y, z)))
        if self.external:
            return self._read_external(inputs.get(EXTERNAL_FORCE), tool)
        return self._read_own(now, any(manipulator.speeds), tool)

    def _read_own(self, now: float, moving: bool, tool: Tool) -> Wrench:
        """Read the arm's own sensor at the time `now`, s. The arm reports no moments caused by a contact."""
        own = self.own.at(now, moving, tool.turn)
        left = at_tool = NO_WRENCH
        if self.load != tool.payload:
            left = _minus(self.load.weight(tool.turn), tool.payload.weight(tool.turn))
            at_tool = about_tool(left, rotate(tool.turn, tool.tcp.position))
        reported = at_tool if self._at_tcp else left
        self._turn = tool.turn if self._turns else _BASE
        self._weights = reported, at_tool
        zero, zero_at_tool = self.zeros
        force = _minus(_plus(own, reported), _turned(self._turn, zero))
        self.tool_force = force
        if at_tool is not reported or zero_at_tool != zero:
            self.tool_force = _minus(_plus(own, at_tool), _turned(self._turn, zero_at_tool))
        return force

    def _read_external(self, wrench: Value | None, tool: Tool) -> Wrench:
        """Read a client's `external_force_torque`, given in the axes of the flange and with moments about the
        flange.
        """
        arm = rotate(tool.turn, tool.tcp.position)
        weight = about_tool(tool.payload.weight(tool.turn), arm)
        self.tool_force = _minus(external_wrench(wrench, tool.turn, tool.tcp), weight)
        return self.tool_force


def _turned(turn: Quaternion, wrench: Wrench) -> Wrench:
    if turn is _BASE or wrench is NO_WRENCH:
        return wrench
    return (*rotate(turn, wrench[:3]), *rotate(turn, wrench[3:]))


def _plus(one: Wrench, other: Wrench) -> Wrench:
    (a, b, c, d, e, f), (o, p, q, r, s, t) = one, other
    return a + o, b + p, c + q, d + r, e + s, f + t


def _minus(one: Wrench, other: Wrench) -> Wrench:
    (a, b, c, d, e, f), (o, p, q, r, s, t) = one, other
    return a - o, b - p, c - q, d - r, e - s, f - t
