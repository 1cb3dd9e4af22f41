"""ur_rtde's control script, by its registers: what a cycle of it does, without its text being read.

Source: ur_rtde 1.6.5, `scripts/rtde_control.script` and `src/rtde_control_interface.cpp`, read for facts. A command
stands in the first input integer register. Some are done in each cycle while they stand there; the others once, until a
0 has been seen.
"""

import math
import re
from collections.abc import Callable, Iterator, Mapping

from emulators.devices.rtde.arm import Brake, Servo, Speed
from emulators.devices.rtde.controller import Controller
from emulators.devices.rtde.kinematics import Joints, compose
from emulators.devices.rtde.moves import Walk, joint_walk, line_walk
from emulators.orders import Act, HeardOrder
from protocol.devices.rtde.rotation import pose_of, six_of
from protocol.geometry import Pose

Turns = Iterator[None]
READY, DONE = 1, 2
STOP_SCRIPT = 255
_OFFSET = re.compile(rb"# float register offset[^\n]*\n\s*(\d{1,2})\b")
_REAL_TIME = frozenset({6, 9, 10, 11, 24, 25, 26, 27, 38, 58, *range(66, 72)})
_JOINT_PER_METRE = 2.0
"""Assumed: joint deceleration of a stop along a line, rad/s² for each m/s²."""


def register_offset(text: bytes) -> int:
    """The offset of its registers, 0 or 24, as the client has written it into the text."""
    found = _OFFSET.search(text)
    return 24 if found is not None and int(found[1]) == 24 else 0


class UrRtde:
    """One that plays."""

    def __init__(self, controller: Controller, offset: int) -> None:
        self._controller, self._offset = controller, offset
        self._busy = False
        self._servoing: Servo | None = None
        self._speed: Speed | None = None
        self._walk: Walk | None = None
        """A move that goes on beside other commands."""
        self._ended = False
        self._writes = self._operations = 0

    # --- registers

    def _i(self, number: int) -> int:
        return int(self._controller.number(f"input_int_register_{self._offset + number}"))

    def _d(self, first: int, count: int = 6) -> tuple[float, ...]:
        at = self._offset + first
        return tuple(
            self._controller.number(f"input_double_register_{number}") for number in range(at, at + count)
        )

    def _say(self, number: int, value: float) -> None:
        self._controller.write_output(f"output_int_register_{self._offset + number}", value)

    def _tell(self, values: tuple[float, ...]) -> None:
        for number, value in enumerate(values):
            self._controller.write_output(f"output_double_register_{self._offset + number}", value)

    def _progress(self, value: int) -> None:
        """Tell the progress of a move beside other commands, -1 at its end. Bits 16 … 22 count the writes, bits 24 … 30
        hold the move's number, and bit 15 stands with the value while it goes on.
        """
        self._writes = (self._writes + 1) % 128
        self._operations = (self._operations + (value == 0)) % 128
        running = (1 << 15) + value if value >= 0 else 0
        self._say(2, (self._operations << 24) + (self._writes << 16) + running)

    # --- for a judge of its client

    def intent(self, names: tuple[str, ...]) -> HeardOrder | None:
        """The order of the registers after a package of these inputs; None for nothing that moves."""
        words = _MOTIONS.get(self._i(0)) if f"input_int_register_{self._offset}" in names else None
        if words is None:
            return None
        six, controller = self._d(0), self._controller
        finite = all(map(math.isfinite, six))
        place = None
        if finite and words.endswith("joints"):
            place = controller.forward(six_joints(six)).position
        elif finite and words.endswith("pose"):
            place = pose_of(six).position
        reach_m = controller.profile.max_target_step_mm * 1e-3 if words.startswith("servo") else math.inf
        return HeardOrder(controller.now, Act.MOTION, words, controller.plays, place, any(six), reach_m)

    # --- turns

    def turns(self) -> Turns:
        """One turn a cycle."""
        self._say(0, READY)
        self._progress(-1)
        while not self._ended:
            command = self._i(0)
            if command == STOP_SCRIPT:
                return
            if command == 0:
                self._say(0, READY)
                self._busy = False
            elif command in _REAL_TIME:
                self._at_once(command)
                self._say(0, READY)
            elif not self._busy:
                self._busy = True
                yield from self._once(command)
                self._say(0, DONE)
            self._go_on()
            yield

    def _go_on(self) -> None:
        """Carry on a servo, an even speed or a move beside the commands."""
        controller = self._controller
        if self._walk is not None:
            place = next(self._walk, None)
            if place is None:
                self._walk = None
                self._progress(-1)
            else:
                controller.order(place)
        elif self._servoing is not None:
            controller.order(self._servoing)
        elif self._speed is not None:
            controller.order(self._speed)

    def _at_once(self, command: int) -> None:
        action = _AT_ONCE.get(command)
        if action is not None:
            action(self)
        else:
            self._tag(command)

    def _once(self, command: int) -> Turns:
        action = _ONCE.get(command)
        if action is not None:
            yield from action(self) or ()
        else:
            self._tag(command)

    def _tag(self, command: int) -> None:
        self._controller.unmodelled.touch(f"ur_rtde command {command}", "told as done, without effect")

    # --- servo and speed

    def servo_joints(self) -> None:
        self._servo(self._d(0))

    def servo_pose(self) -> None:
        six = self._d(0)
        if not all(map(math.isfinite, six)):
            self._controller.protective_stop("a target that is no number")
            return
        joints = self._controller.solve(pose_of(six))
        if joints is None:  # the kinematics call fails, and with it the program
            self._ended = True
            return
        self._servo(joints)

    def _servo(self, joints: tuple[float, ...]) -> None:
        time, lookahead, gain = self._d(8, 3)
        if not all(map(math.isfinite, (*joints, time, lookahead, gain))):
            self._controller.protective_stop("a target that is no number")
            return
        if self._servoing is None or joints != self._servoing.target:
            self._controller.target_taken()
        self._walk = self._speed = None
        self._servoing = Servo(
            six_joints(joints), min(max(lookahead, 0.03), 0.2), min(max(gain, 100.0), 2000.0), 1
        )

    def servo_stop(self) -> Turns:
        yield from self._stop(self._d(0, 1)[0] * _JOINT_PER_METRE)

    def speed_joints(self) -> None:
        self._even_speed(self._d(0), self._d(6, 1)[0])

    def speed_line(self) -> None:
        """speedl: the tool's velocity by the joints that it takes a cycle to go there."""
        controller, six = self._controller, self._d(0)
        if not all(map(math.isfinite, six)):
            controller.protective_stop("a speed that is no number")
            return
        dt = controller.period
        here = controller.forward(controller.arm.joints)
        turn = pose_of((0.0, 0.0, 0.0, *(part * dt for part in six[3:])))
        x, y, z = (p + v * dt for p, v in zip(here.position, six[:3], strict=True))
        there = Pose((x, y, z), compose(turn, Pose((0.0, 0.0, 0.0), here.quaternion)).quaternion)
        joints = controller.solve(there, controller.arm.joints)
        if joints is None:
            self._ended = True
            return
        speeds = tuple((b - a) / dt for a, b in zip(controller.arm.joints, joints, strict=True))
        self._even_speed(speeds, self._d(6, 1)[0] * _JOINT_PER_METRE)

    def _even_speed(self, speeds: tuple[float, ...], acceleration: float) -> None:
        if not all(map(math.isfinite, (*speeds, acceleration))):
            self._controller.protective_stop("a speed that is no number")
            return
        self._walk = self._servoing = None
        self._speed = Speed(six_joints(speeds), max(acceleration, 0.01))

    def stop(self) -> Turns:
        yield from self._stop(self._d(0, 1)[0])

    def stop_line(self) -> Turns:
        yield from self._stop(self._d(0, 1)[0] * _JOINT_PER_METRE)

    def _stop(self, deceleration: float) -> Turns:
        if self._walk is not None:
            self._progress(-1)
        self._servoing = self._speed = self._walk = None
        rate = deceleration if math.isfinite(deceleration) and deceleration > 0.0 else 1.0
        while not self._controller.still:
            self._controller.order(Brake(rate))
            yield

    # --- moves

    def _move(self, walk: Walk | None) -> Turns:
        if walk is None:
            self._ended = True
            return
        self._servoing = self._speed = None
        if self._i(1):
            self._walk = walk
            self._progress(0)
            return
        for place in walk:
            self._controller.order(place)
            yield

    def _line(self, goal: Pose | None) -> Turns:
        speed, acceleration = self._d(6, 2)
        walk = None if goal is None else line_walk(self._controller, goal, speed, acceleration)
        yield from self._move(walk)

    def _joints(self, goal: Joints | None) -> Turns:
        speed, acceleration = self._d(6, 2)
        walk = None if goal is None else joint_walk(self._controller, goal, speed, acceleration)
        yield from self._move(walk)

    def move_line(self) -> Turns:
        yield from self._line(self._pose_in(0))

    def move_line_to_joints(self) -> Turns:
        joints = self._joints_in(0)
        yield from self._line(None if joints is None else self._controller.forward(joints))

    def move_joints(self) -> Turns:
        yield from self._joints(self._joints_in(0))

    def move_joints_to_pose(self) -> Turns:
        pose = self._pose_in(0)
        yield from self._joints(None if pose is None else self._controller.solve(pose))

    def _joints_in(self, first: int) -> Joints | None:
        six = self._d(first)
        return six_joints(six) if all(map(math.isfinite, six)) else None

    def _pose_in(self, first: int) -> Pose | None:
        six = self._d(first)
        return pose_of(six) if all(map(math.isfinite, six)) else None

    # --- settings and questions

    def set_watchdog(self) -> None:
        rate = self._d(0, 1)[0]
        if math.isfinite(rate):
            self._controller.watch_input(f"input_int_register_{self._offset}", rate, "stop")

    def protective_stop(self) -> None:
        self._controller.protective_stop("ordered by a program")

    def zero_force(self) -> None:
        self._controller.force_zero = self._controller.measured

    def set_tcp(self) -> None:
        pose = self._pose_in(0)
        if pose is not None:
            self._controller.set_tcp(pose)

    def set_payload(self) -> None:
        self._controller.payload = self._d(0, 4)

    def enable_force(self) -> None:
        self._controller.enable_external_force(bool(self._i(1)))

    def tell_step_time(self) -> None:
        self._tell((self._controller.period,))

    def tell_flange(self) -> None:
        self._tell(six_of(self._controller.flange_pose()))

    def tell_tcp(self) -> None:
        self._tell(six_of(self._controller.tcp))

    def tell_torques(self) -> None:
        self._tell((0.0,) * 6)

    def tell_forward(self) -> None:
        self._tell(six_of(self._controller.forward(self._controller.arm.joints)))

    def tell_forward_of(self) -> None:
        """With a tool that stands in the registers behind the joints, also where the client has written none."""
        joints, tcp = self._joints_in(0), self._pose_in(6)
        if joints is not None and tcp is not None:
            self._tell(six_of(self._controller.forward(joints, tcp)))

    def tell_inverse(self) -> None:
        pose = self._pose_in(0)
        joints = None if pose is None else self._controller.solve(pose)
        self._ended = joints is None
        self._tell(joints or ())

    def tell_inverse_near(self) -> None:
        pose = self._pose_in(0)
        near = self._joints_in(6)
        joints = None if pose is None or near is None else self._controller.solve(pose, near)
        self._ended = joints is None
        self._tell(joints or ())

    def tell_solvable(self) -> None:
        pose = self._pose_in(0)
        self._say(1, pose is not None and self._controller.solve(pose) is not None)

    def tell_joints_inside(self) -> None:
        self._say(1, all(abs(angle) <= 2.0 * math.pi for angle in self._d(0)))

    def tell_still(self) -> None:
        self._say(1, self._controller.still)

    def tell_product(self) -> None:
        first, second = self._pose_in(0), self._pose_in(6)
        if first is not None and second is not None:
            self._tell(six_of(compose(first, second)))


def six_joints(values: tuple[float, ...]) -> Joints:
    """Six values as joints; what is no number stays, and is refused where it is ordered."""
    a, b, c, d, e, f = values
    return a, b, c, d, e, f


_AT_ONCE: Mapping[int, Callable[[UrRtde], None]] = {
    9: UrRtde.speed_joints,
    10: UrRtde.speed_line,
    11: UrRtde.servo_joints,
    24: UrRtde.servo_pose,
    26: UrRtde.tell_step_time,
    38: UrRtde.tell_torques,
    58: UrRtde.tell_flange,
}
"""Commands that are done in each cycle, by number; the others of `_REAL_TIME` are ready without effect."""

_MOTIONS: Mapping[int, str] = {
    1: "moveJ to joints",
    2: "moveJ to a pose",
    3: "moveL to a pose",
    4: "moveL to joints",
    9: "speedJ",
    10: "speedL",
    11: "servoJ to joints",
    24: "servoL to a pose",
}
"""Commands that move the arm, by number, as far as their effect is known."""

_ONCE: Mapping[int, Callable[[UrRtde], Turns | None]] = {
    1: UrRtde.move_joints,
    2: UrRtde.move_joints_to_pose,
    3: UrRtde.move_line,
    4: UrRtde.move_line_to_joints,
    8: UrRtde.zero_force,
    15: UrRtde.stop,
    16: UrRtde.servo_stop,
    17: UrRtde.set_payload,
    29: UrRtde.set_tcp,
    30: UrRtde.tell_inverse_near,
    31: UrRtde.protective_stop,
    33: UrRtde.stop_line,
    34: UrRtde.stop,
    35: UrRtde.set_watchdog,
    36: UrRtde.tell_solvable,
    37: UrRtde.tell_joints_inside,
    39: UrRtde.tell_product,
    40: UrRtde.tell_tcp,
    43: UrRtde.tell_forward,
    44: UrRtde.tell_forward_of,
    46: UrRtde.tell_inverse,
    47: UrRtde.tell_still,
    56: UrRtde.enable_force,
    57: UrRtde.enable_force,
    60: UrRtde.tell_solvable,
    61: UrRtde.tell_solvable,
}
"""Commands that are done once, by number; the others are done without effect."""
