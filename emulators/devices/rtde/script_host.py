"""Controller as the host of a URScript program: `urscript.Host`."""

import math
import random
from collections.abc import Iterator, Set
from functools import lru_cache

from emulators.devices.rtde.arm import Brake, Servo, Speed
from emulators.devices.rtde.compliance import Compliance
from emulators.devices.rtde.controller import Controller
from emulators.devices.rtde.force_mode import ForceTask
from emulators.devices.rtde.kinematics import Joints, compose, invert, nearest
from emulators.devices.rtde.moves import JointPath, plan_arc, plan_joint_move, plan_line
from emulators.devices.rtde.running import ProgramMessage
from emulators.devices.rtde.state import getter, number_in
from emulators.devices.rtde.urscript import Message, Profile, RuntimeFailure, Socket, SyntaxFailure
from emulators.devices.rtde.urscript.failures import ScriptError
from emulators.orders import Act
from protocol.devices.rtde.fields import INPUTS, OUTPUTS
from protocol.devices.rtde.rotation import pose_of
from protocol.geometry import Pose, Vector

_JOINT_PER_METRE = 2.0
"""Joint acceleration per linear acceleration of the tool, rad/s² for each m/s². Assumed: an arm with a length of
half a metre.
"""
_WORDS = {"int": "int_register_", "double": "double_register_"}


class ControllerHost:
    """Robot on which one program runs."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._motions = controller.motions
        self._random = random.Random(controller.now)
        self._servoing: Servo | None = None
        """Newest servoj command; None after any other motion."""
        self._inputs = controller.io.inputs
        """Inputs at the newest servoj command. If they differ, a repeated target counts as another one."""
        self._solved: tuple[object, Joints | None] = (None, None)
        """Newest inverse kinematics query and its result."""
        self.period = controller.period

    # --- messages

    def tell(self, message: Message, text: str, title: str = "") -> None:
        self._controller.console.tell(ProgramMessage(self._controller.now, message, text, title))

    @property
    def popup_open(self) -> bool:
        return self._controller.console.popup_open

    def report_failure(self, failure: RuntimeFailure | SyntaxFailure) -> None:
        kind = Message.SYNTAX if isinstance(failure, SyntaxFailure) else Message.RUNTIME
        self._controller.counts[str(kind)] += 1
        place = failure.line, failure.column
        self._controller.console.tell(ProgramMessage(self._controller.now, kind, failure.text, "", *place))

    def report_tagged(self, function: str, detail: str) -> None:
        self._controller.unmodelled.touch(f"URScript {function}()", detail)
        self._controller.report_order(Act.REFUSED, f"URScript {function}(), which has no effect here", False)

    # --- time and registers

    def clock(self) -> float:
        controller = self._controller
        return controller.snapshots[-1].time + controller.period

    def random(self) -> float:
        return self._random.random()

    def read_register(self, direction: str, kind: str, number: int) -> float:
        name, shift = _register(direction, kind, number)
        io = self._controller.io
        value = number_in(io.inputs if direction == "input" else io.outputs, name)
        return value if shift is None else int(value) >> shift & 1

    def write_register(self, kind: str, number: int, value: float) -> None:
        name, shift = _register("output", kind, number)
        if shift is not None:
            bits = int(self.read_integer(name))
            value = bits | 1 << shift if value else bits & ~(1 << shift)
        elif kind == "int" and not -(2**31) <= value < 2**31:
            raise ScriptError("an integer register has 32 bits")
        self._controller.io.write_output(name, value)

    def read_integer(self, name: str) -> float:
        """Return a numeric output; 0 if it was never written."""
        return number_in(self._controller.io.outputs, name)

    def watch_input(self, name: str, frequency_hz: float, action: str) -> None:
        self._controller.player.watch_input(name, frequency_hz, action, self._controller.now)

    def read_digital(self, direction: str, number: int) -> bool:
        """Return False: no input is wired (assumed)."""
        name = "actual_digital_output_bits"
        return direction == "output" and bool(int(self.read_integer(name)) >> number & 1)

    def write_digital(self, number: int, on: bool) -> None:
        bits = int(self.read_integer("actual_digital_output_bits"))
        bits = bits | 1 << number if on else bits & ~(1 << number)
        self._controller.io.write_output("actual_digital_output_bits", bits)

    def read_analog(self, direction: str, number: int) -> float:
        return self.read_integer(f"standard_analog_output{number}") if direction == "output" else 0.0

    def write_analog(self, number: int, share: float) -> None:
        self._controller.io.write_output(f"standard_analog_output{number}", share)

    @property
    def flags(self) -> Set[int]:
        return self._controller.io.flags

    def set_flag(self, number: int, on: bool) -> None:
        (self._controller.io.flags.add if on else self._controller.io.flags.discard)(number)

    def open_socket(self, address: str, port: int) -> Socket | None:
        return self._controller.console.open_socket(address, port)

    def output(self, name: str) -> tuple[float, ...]:
        if name not in OUTPUTS and name not in INPUTS:
            raise ScriptError(f"there is no output {name[:40]}")
        return getter(name)(self._controller.snapshots[-1])

    # --- the arm

    @property
    def joints(self) -> Joints:
        return self._controller.manipulator.joints

    @property
    def target(self) -> Joints:
        return self._controller.arm.joints

    @property
    def speeds(self) -> Joints:
        return self._controller.manipulator.speeds

    @property
    def target_speeds(self) -> Joints:
        return self._controller.arm.motion

    @property
    def speed_scaling(self) -> float:
        return self._controller.io.slider

    @property
    def tcp(self) -> Pose:
        return self._controller.manipulator.tcp

    @property
    def payload(self) -> tuple[float, ...]:
        return self._controller.force.payload

    @property
    def still(self) -> bool:
        return self._controller.manipulator.still

    def forward(self, joints: Joints, tcp: Pose | None = None) -> Pose:
        return self._controller.manipulator.forward(joints, tcp)

    def solve(self, pose: Pose, near: Joints | None = None, tcp: Pose | None = None) -> Joints | None:
        """Return joint angles for a pose.

        The newest result is cached: a program first checks whether a solution exists, and then requests it.
        """
        controller = self._controller
        question = pose, near or controller.arm.target, tcp or controller.manipulator.tcp
        if question != self._solved[0]:
            flange = compose(pose, invert(question[2]))
            self._solved = question, nearest(controller.manipulator.lengths, flange, question[1])
        return self._solved[1]

    def servo(self, joints: Joints, time: float, lookahead: float, gain: float) -> int:
        """Command servoj. Values outside the manual's ranges are clamped (assumed)."""
        controller = self._controller
        self._motions.report_servo(joints)
        if not all(map(math.isfinite, (*joints, time, lookahead, gain))):
            controller.protective_stop("a servo's setting that is not a number")
            return 1
        cycles = max(1, round(min(max(time, 0.0), 1.0) / controller.period))
        inputs = controller.io.inputs
        if self._servoing is None or joints != self._servoing.target or inputs is not self._inputs:
            controller.target_changed()
        self._inputs = inputs
        servo = Servo(joints, min(max(lookahead, 0.03), 0.2), min(max(gain, 100.0), 2000.0), cycles)
        self._servoing = servo
        controller.order(servo)
        return cycles

    def speed(self, speeds: Joints, acceleration: float) -> None:
        self._motions.report_speed("speedj", speeds)
        self._turn(speeds, acceleration)

    def _turn(self, speeds: Joints, acceleration: float) -> None:
        self._servoing = None
        self._controller.order(Speed(speeds, max(acceleration, 0.01)))

    def speed_line(self, velocity: Joints, acceleration: float) -> bool:
        controller = self._controller
        self._motions.report_speed("speedl", velocity)
        dt, joints = controller.period, controller.arm.joints
        here = controller.manipulator.forward(joints)
        turn = pose_of((0.0, 0.0, 0.0, *(part * dt for part in velocity[3:])))
        x, y, z = (p + v * dt for p, v in zip(here.position, velocity[:3], strict=True))
        there = Pose((x, y, z), compose(turn, Pose((0.0, 0.0, 0.0), here.quaternion)).quaternion)
        solution = controller.manipulator.solve(there, joints)
        if solution is None:
            return False
        a, b, c, d, e, f = ((new - old) / dt for old, new in zip(joints, solution, strict=True))
        self._turn((a, b, c, d, e, f), acceleration * _JOINT_PER_METRE)
        return True

    def brake(self, deceleration: float) -> None:
        self._servoing = None
        self._controller.order(Brake(deceleration))

    def brake_line(self, deceleration: float) -> None:
        self.brake(deceleration * _JOINT_PER_METRE)

    def line(self, goal: Pose, profile: Profile) -> Iterator[object] | None:
        self._motions.report_move("move along a line", goal)
        walk = plan_line(self._controller, goal, *profile)
        return None if walk is None else self._walk(walk)

    def swing(self, goal: Joints, profile: Profile) -> Iterator[object] | None:
        self._motions.report_move("move in joints", self.forward(goal))
        walk = plan_joint_move(self._controller, goal, *profile)
        return None if walk is None else self._walk(walk)

    def arc(self, via: Pose, goal: Pose, profile: Profile) -> Iterator[object] | None:
        self._motions.report_move("move along an arc", goal)
        walk = plan_arc(self._controller, via, goal, profile.speed, profile.acceleration)
        return None if walk is None else self._walk(walk)

    def _walk(self, walk: JointPath) -> Iterator[None]:
        self._servoing = None
        for place in walk:
            self._controller.order(place)
            yield None

    def set_tcp(self, tcp: Pose) -> None:
        self._controller.manipulator.tcp = tcp

    def set_payload(self, mass: float, centre: tuple[float, ...]) -> None:
        self._controller.force.payload = (mass, *centre)

    # --- force and stops

    def zero_force(self) -> None:
        self._controller.zero_force()

    @property
    def _compliance(self) -> Compliance:
        return self._controller.compliance

    def force_mode(
        self, frame: Pose, compliant: tuple[bool, ...], wrench: Joints, kind: int, limits: Joints
    ) -> None:
        self._compliance.begin(ForceTask(frame, compliant, wrench, kind, limits))

    def freedrive(self, frame: Pose, free: tuple[bool, ...]) -> None:
        self._compliance.free(frame, free)

    def end_force_mode(self, freedrive: bool) -> None:
        self._compliance.end(freedrive)

    @property
    def damping(self) -> float:
        return self._compliance.damping

    @property
    def gain_scaling(self) -> float:
        return self._compliance.gain_scaling

    def set_damping(self, damping: float) -> None:
        self._compliance.damping = damping

    def set_gain_scaling(self, scaling: float) -> None:
        self._compliance.gain_scaling = scaling

    def steps_since_contact(self, direction: Vector, threshold_n: float) -> int:
        usual = self._controller.profile.tool_contact_n
        return self._compliance.history.steps_since_contact(direction, threshold_n or usual)

    def joints_before(self, steps: int) -> Joints:
        return self._compliance.history.joints_before(steps) or self.joints

    def enable_external_force(self, enable: bool) -> None:
        self._controller.force.enable_external(enable, self._controller.now)

    def protective_stop(self, why: str) -> None:
        self._controller.protective_stop(why)

    def power_off(self) -> None:
        self._controller.power_off()


@lru_cache(maxsize=1024)
def _register(direction: str, kind: str, number: int) -> tuple[str, int | None]:
    """Return the RTDE field of a register, and the bit of the register in that field; None instead of the bit if it
    is a complete field.
    """
    if kind == "bit":
        if not 0 <= number < 128:
            raise ScriptError(f"there is no boolean register {number}")
        if number >= 64:
            return f"{direction}_bit_register_{number}", None
        group = "0_to_31" if number < 32 else "32_to_63"
        return f"{direction}_bit_registers{group}", number % 32
    if not 0 <= number < 48:
        raise ScriptError(f"there is no {kind} register {number}")
    return f"{direction}_{_WORDS[kind]}{number}", None
