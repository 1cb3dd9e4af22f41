"""Movement sequence of the S3: a start, any number of points, and an end at the last point."""

from collections.abc import Callable
from typing import Protocol

from hil_bridge.devices.robots.last_order import LastOrder
from hil_bridge.devices.robots.seam import Sent
from hil_bridge.errors import BridgeError, GateStop, OrderRefused
from protocol.devices.s3.adlp import HEADER_SIZE
from protocol.devices.s3.arap import Move, MoveKind, Telegram, stop_program
from protocol.geometry import Pose, Quaternion, Vector
from protocol.robot import pose_fault

_POINT = MoveKind.POINT
_ZEROS: Vector = (0.0, 0.0, 0.0)
"""Coordinates of the order that starts a sequence."""


class Orders(Protocol):
    """Part of the link that a movement sequence uses."""

    def encoded(self, move: Move) -> Telegram:
        """Encode a move for this link."""

    async def exchange(self, *telegrams: Telegram, soon: bool = False) -> Telegram:
        """Send an order and wait for its answer."""

    @property
    def sent(self) -> Sent:
        """Time at which the newest order was sent."""


class S3Motion(LastOrder):
    """Movement sequence in progress; see `hil_bridge.devices.robots.seam.Motion`.

    The controller receives the complete path with each point, so `settled` returns at once and `hold` has nothing
    to discard.
    """

    def __init__(
        self,
        link: Orders,
        speed: float,
        present: Pose | None = None,
        judge: Callable[[Pose], str] = lambda pose: "",
        take_back: Callable[[], None] = lambda: None,
    ) -> None:
        """Begin with `present`, the last reported pose of the robot, at which a sequence without points is ended.

        `judge` returns the last gate's reason why a pose must not be ordered, or "" if it may be ordered.
        `take_back` informs the gate that the robot has not accepted the pose.
        """
        self._link, self._judge, self._take_back = link, judge, take_back
        self._present = present
        self.speed = speed
        """Speed along the path for the following orders, m/s."""
        super().__init__()

    def telegram(
        self, kind: MoveKind, position: Vector = _ZEROS, quaternion: Quaternion = (*_ZEROS, 0.0)
    ) -> Telegram:
        """Return the order for one step of the sequence. The position is in m, the orientation a quaternion w x y
        z; both describe the tool in the base frame.
        """
        return self._link.encoded(Move(kind, position, quaternion, self.speed))

    async def to(self, target: Pose, *, soon: bool = False) -> Sent:
        if self.halted or self.abandoned:
            raise OrderRefused("the robot was halted: nothing more is ordered in this movement")
        if wrong := pose_fault(target):
            raise OrderRefused(f"the robot is not sent to {wrong}")
        order = self.telegram(_POINT, *target)
        if stopped := self._judge(ordered_pose(order)):
            raise GateStop(stopped)
        before, self._last = self._last, target
        try:
            await self._link.exchange(order, soon=soon)
        except BridgeError as error:
            self._take_back()
            if isinstance(error, OrderRefused):
                self._last = before
            raise
        return self._link.sent

    async def settled(self) -> None:
        """Do nothing: the controller has the complete path."""

    def hold(self) -> None:
        """Do nothing: the controller stays at the end of its path."""

    async def halt(self) -> Sent:
        self.halted = True
        await self._link.exchange(stop_program())
        return self._link.sent

    def abandon(self) -> None:
        self.abandoned = True

    async def end(self) -> None:
        """End the sequence at the last ordered point, unless it was halted or abandoned."""
        if not (self.halted or self.abandoned):
            await self._link.exchange(self.telegram(MoveKind.END, *(self._last or self._present or ())))


def ordered_pose(order: Telegram) -> Pose:
    """Return the pose that an order encodes."""
    move = Move.from_telegram(order, (len(order.data) + HEADER_SIZE,))
    return Pose(move.position, move.quaternion)
