"""Motions that programs order, told to a judge of the client behind them."""

import math
from typing import Protocol

from emulators.devices.rtde.io import RegisterBank
from emulators.devices.rtde.kinematics import Joints
from emulators.devices.rtde.manipulator import Manipulator
from emulators.devices.rtde.profile import RtdeProfile
from emulators.orders import Act, Orders, Reach, ReceivedOrder
from protocol.devices.rtde.program import COMMAND, POSE, Command
from protocol.geometry import Pose, turn_by

_COMMAND = f"input_int_register_{COMMAND}"
_PLACE = tuple(f"input_double_register_{number}" for number in range(POSE, POSE + 6))


class Playing(Protocol):
    """The controller, as far as it is asked here."""

    profile: RtdeProfile
    manipulator: Manipulator
    io: RegisterBank
    orders: Orders
    now: float

    @property
    def plays(self) -> bool:
        """Whether a program plays on an arm that may move."""

    @property
    def reported_pose_now(self) -> Pose:
        """Pose of the controller's tool, without noise."""


class Motions:
    """Tells each motion once: a program that repeats it has heard nothing new from its client.

    Without a listener nothing is computed.
    """

    def __init__(self, controller: Playing) -> None:
        self._controller = controller
        self.news = 0
        """Packages of inputs, and pieces that came over sockets of programs."""
        self.muted = False
        """Whether nothing is told: the client has not spoken since the program began."""
        self.by_registers = False
        """Whether the newest program is our streaming program, which refuses a leap: its packages tell the orders."""
        self._told: tuple[str, object] = ("", None)
        self._heard = 0
        """News at the newest motion that was told."""

    def hear_package(self, names: tuple[str, ...]) -> None:
        """Accept a package of inputs with these names."""
        controller = self._controller
        if not self.by_registers or controller.orders.listener is None:
            return
        if _COMMAND in names and controller.io.number(_COMMAND) == Command.SERVO:
            x, y, z, *turn = map(controller.io.number, _PLACE)
            self._tell("servo to a pose", Pose((x, y, z), turn_by(turn)), self._reach)

    def hear_servo(self, joints: Joints) -> None:
        """servoj to joints."""
        if self._is_new("servoj", joints):
            place = self._controller.manipulator.forward(joints) if all(map(math.isfinite, joints)) else None
            self._tell("servoj", place, self._reach)

    def hear_speed(self, words: str, speeds: Joints) -> None:
        """Speeds of the joints, or of the tool."""
        if self._is_new(words, speeds):
            by_tool = words == "speedl"
            speed = (
                (math.hypot(*speeds[:3]), math.hypot(*speeds[3:]))
                if by_tool
                else (0.0, max(map(abs, speeds)))
            )
            self._tell(words, None, self._reach, speed)

    def hear_move(self, words: str, goal: Pose) -> None:
        """Accept a move that is planned before it begins."""
        if self._listens:
            self._told, self._heard = (words, goal), self.news
            self._tell(words, goal)

    @property
    def _listens(self) -> bool:
        return self._controller.orders.listener is not None and not (self.muted or self.by_registers)

    def _is_new(self, words: str, values: object) -> bool:
        if not self._listens:
            return False
        told = (words, values)
        if told == self._told and self._heard == self.news:
            return False
        self._told, self._heard = told, self.news
        return True

    @property
    def _reach(self) -> Reach:
        """How fast the arm follows a target or a speed: what the controller bears, and a joint's speed of the turn."""
        profile = self._controller.profile
        return Reach(
            profile.cycle_ms * 1e-3, profile.max_tcp_speed_mm_s * 1e-3, profile.max_joint_speed_rad_s
        )

    def _tell(
        self,
        words: str,
        goal: Pose | None,
        reach: Reach | None = None,
        speed: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        controller, moves = self._controller, goal is not None or any(speed)
        order = ReceivedOrder(controller.now, Act.MOTION, words, controller.plays, goal, moves, reach)
        controller.orders.tell(order._replace(tool=controller.reported_pose_now, speed=speed))
