"""Reports of the motions that programs command, to a judge of the client behind them."""

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


class RunningController(Protocol):
    """Parts of the controller that are used here."""

    profile: RtdeProfile
    manipulator: Manipulator
    io: RegisterBank
    orders: Orders
    now: float

    @property
    def plays(self) -> bool:
        """Whether a program is running and the arm may move."""

    @property
    def reported_pose_now(self) -> Pose:
        """Return the reported pose of the controller's tool, without noise."""


class Motions:
    """Reports each motion once. A program that repeats a motion has received no new data from its client.

    Nothing is computed if there is no listener.
    """

    def __init__(self, controller: RunningController) -> None:
        self._controller = controller
        self.news = 0
        """Number of times that a client sent inputs, or data through the socket of a program."""
        self.muted = False
        """Whether motions are not reported, because the client has sent nothing since the program began."""
        self.by_registers = False
        """Whether the newest program is our streaming program, which refuses large steps. Then its input packages
        are the orders.
        """
        self._reported_order: tuple[str, object] = ("", None)
        self._reported_news = 0
        """Value of `news` at the newest reported motion."""

    def accept_package(self, names: tuple[str, ...]) -> None:
        """Accept a package of inputs with these names."""
        controller = self._controller
        if not self.by_registers or controller.orders.listener is None:
            return
        if _COMMAND in names and controller.io.number(_COMMAND) == Command.SERVO:
            x, y, z, *turn = map(controller.io.number, _PLACE)
            self._report("servo to a pose", Pose((x, y, z), turn_by(turn)), self._reach)

    def report_servo(self, joints: Joints) -> None:
        """Report a servoj command."""
        if self._is_new("servoj", joints):
            place = self._controller.manipulator.forward(joints) if all(map(math.isfinite, joints)) else None
            self._report("servoj", place, self._reach)

    def report_speed(self, text: str, speeds: Joints) -> None:
        """Report commanded speeds of the joints, or of the tool."""
        if self._is_new(text, speeds):
            by_tool = text == "speedl"
            speed = (
                (math.hypot(*speeds[:3]), math.hypot(*speeds[3:]))
                if by_tool
                else (0.0, max(map(abs, speeds)))
            )
            self._report(text, None, self._reach, speed)

    def report_move(self, text: str, goal: Pose) -> None:
        """Report a planned move before it begins."""
        if self._listens:
            self._reported_order, self._reported_news = (text, goal), self.news
            self._report(text, goal)

    @property
    def _listens(self) -> bool:
        return self._controller.orders.listener is not None and not (self.muted or self.by_registers)

    def _is_new(self, text: str, values: object) -> bool:
        if not self._listens:
            return False
        order = (text, values)
        if order == self._reported_order and self._reported_news == self.news:
            return False
        self._reported_order, self._reported_news = order, self.news
        return True

    @property
    def _reach(self) -> Reach:
        """Return the speed at which the arm follows a target or a speed: the controller's limit, and a joint's
        speed for the rotation.
        """
        profile = self._controller.profile
        return Reach(
            profile.cycle_ms * 1e-3, profile.max_tcp_speed_mm_s * 1e-3, profile.max_joint_speed_rad_s
        )

    def _report(
        self,
        words: str,
        goal: Pose | None,
        reach: Reach | None = None,
        speed: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        controller, moves = self._controller, goal is not None or any(speed)
        order = ReceivedOrder(controller.now, Act.MOTION, words, controller.plays, goal, moves, reach)
        controller.orders.tell(order._replace(tool=controller.reported_pose_now, speed=speed))
