"""actual_TCP_force of the emulated controller: what its sensor measures, less the weight of the payload that is set.

Source of all that is removed and when: the weight of the set payload, also of an external sensor's force, in Universal
Robots' forum, thread 2053, which has 9.82 N for 1 kg, and 0.982 N·m with its centre 0.1 m away (by the right hand here;
that thread has the moments with the other sign). An e-Series is zeroed at each start of a program
(Universal_Robots_ROS_Driver, issues 512 and 643). zero_ftsensor() is of the built-in sensor alone (script manual, and
forum, thread 25749). An external force is told about the tool (Universal_Robots_ROS2_Driver, issue 1849), that of an
e-Series's own sensor about the flange (its pull request 1287).
"""

import math
from typing import NamedTuple

from emulators.arm.own_force import NO_WRENCH, OwnForce
from emulators.devices.rtde.drives import own_errors
from emulators.devices.rtde.force_mode import about_tool, external_wrench
from emulators.devices.rtde.io import EXTERNAL_FORCE
from emulators.devices.rtde.manipulator import Manipulator
from emulators.devices.rtde.profile import RtdeProfile
from emulators.devices.rtde.running import Watchdog
from emulators.devices.rtde.state import Registers
from protocol.devices.rtde.fields import Value
from protocol.devices.rtde.force import GRAVITY
from protocol.geometry import Pose, Quaternion, Vector, Wrench, inverse, rotate

_BASE: Quaternion = (1.0, 0.0, 0.0, 0.0)


class Load(NamedTuple):
    """What a flange carries."""

    mass: float = 0.0
    """kg"""
    centre: Vector = (0.0, 0.0, 0.0)
    """In the flange, m."""

    def weight(self, turn: Quaternion) -> Wrench:
        """On a flange of this orientation: base axes, moments about the flange, N and N·m."""
        x, y, _ = rotate(turn, self.centre)
        force = -GRAVITY * self.mass
        return 0.0, 0.0, force, y * force, -x * force, 0.0


class Tool(NamedTuple):
    """The tool in one cycle, as the controller takes it to be."""

    turn: Quaternion
    """Orientation of the flange."""
    tcp: Pose
    """In the flange."""
    payload: Load


class ForceReading:
    """The force of one controller, cycle by cycle: base axes, N and N·m."""

    def __init__(self, profile: RtdeProfile, seed: int, now: float) -> None:
        self._max_force_n = profile.max_force_n
        self.external = False
        """Whether `external_force_torque` is its force sensor."""
        rate = profile.force_watchdog_hz
        self.watchdog = Watchdog(EXTERNAL_FORCE, 1.0 / rate if rate else math.inf, "pause", now)
        self.payload: tuple[float, ...] = (0.0,) * 4
        """Mass, kg, and its centre, m, as the controller takes them to be."""
        self.own = OwnForce(own_errors(profile), seed)
        """The force that the arm feels by itself, without weights."""
        self.load = Load()
        """What the flange carries indeed."""
        self._at_tcp = profile.force_point == "tcp"
        self._turns = profile.force_offset_axes == "flange"
        self.zeros: tuple[Wrench, Wrench] = (NO_WRENCH, NO_WRENCH)
        """Taken off what the own sensor tells, and what force mode takes of it; axes of the sensor's offset."""
        self._levels: tuple[Wrench, Wrench] = (NO_WRENCH, NO_WRENCH)
        """Both without noise and zero, as of the newest cycle, base axes."""
        self._turn = _BASE
        """Orientation of the sensor's offset in the newest cycle."""
        self.felt: Wrench = NO_WRENCH
        """As told, with moments about the tool."""

    def carry(self, mass: float, centre: Vector) -> None:
        """Set the payload at the flange, kg and m, as its operator has set it in the controller."""
        self.load, self.payload = Load(mass, centre), (mass, *centre)

    def enable_external(self, enable: bool, now: float) -> None:
        """Take `external_force_torque` for the force sensor, or the arm's own."""
        self.external, self.watchdog.last = enable, now

    def is_overdue(self, now: float) -> bool:
        """Whether an external force has not come for too long."""
        return self.external and self.watchdog.is_overdue(now)

    def problem(self) -> str:
        """Reason of a protective stop for an external force, or an empty string."""
        too_large = self.external and math.hypot(*self.felt[:3]) > self._max_force_n
        return "the force is too large" if too_large else ""

    def zero(self) -> None:
        """Take the present force of the own sensor for zero. A force that is not a number stays."""
        turn = inverse(self._turn)
        told, felt = (_turned(turn, level) for level in self._levels)
        if all(map(math.isfinite, (*told, *felt))):
            self.zeros = told, felt

    def read(self, now: float, inputs: Registers, manipulator: Manipulator) -> Wrench:
        """actual_TCP_force: of a client's forces, or of those that the arm feels."""
        mass, x, y, z = self.payload
        tool = Tool(manipulator.turn, manipulator.tcp, Load(mass, (x, y, z)))
        if self.external:
            return self._read_external(inputs.get(EXTERNAL_FORCE), tool)
        return self._read_own(now, any(manipulator.speeds), tool)

    def _read_own(self, now: float, moving: bool, tool: Tool) -> Wrench:
        """Read the arm's own sensor at the time `now`, s. The arm reports no moments of a contact."""
        own = self.own.at(now, moving, tool.turn)
        arm = rotate(tool.turn, tool.tcp.position)
        left = _minus(self.load.weight(tool.turn), tool.payload.weight(tool.turn))
        at_tool = about_tool(left, arm)
        shown = at_tool if self._at_tcp else left
        self._turn = tool.turn if self._turns else _BASE
        self._levels = _plus(self.own.level, shown), _plus(self.own.level, at_tool)
        zeros = [_turned(self._turn, zero) for zero in self.zeros]
        self.felt = _minus(_plus(own, at_tool), zeros[1])
        return _minus(_plus(own, shown), zeros[0])

    def _read_external(self, given: Value | None, tool: Tool) -> Wrench:
        """Read a client's `external_force_torque`, along the flange's axes and about the flange."""
        arm = rotate(tool.turn, tool.tcp.position)
        weight = about_tool(tool.payload.weight(tool.turn), arm)
        self.felt = _minus(external_wrench(given, tool.turn, tool.tcp), weight)
        return self.felt


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
