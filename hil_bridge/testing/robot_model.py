"""Stateful model of a robot: after any sequence of orders, the client must report the same state as the model."""

from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack, suppress
from typing import Any

from hypothesis import strategies as st
from hypothesis.stateful import precondition, rule

from hil_bridge.clock import Clock
from hil_bridge.devices.robots.seam import Motion, RobotLink
from hil_bridge.errors import BridgeError
from hil_bridge.testing.cases import RobotCase
from hil_bridge.testing.model import Model, try_sequences
from hil_bridge.testing.naming import Finding
from hil_bridge.testing.robot_rig import LIMITS, SPEED_M_S, RobotRig, robot_rig

EXAMPLES = 4
"""Number of sequences to try. Every run tries the same sequences. Chosen."""
STEPS = 10
"""Maximum number of orders in a sequence. Chosen."""
_BOX_MM = 15
_offsets = st.tuples(*[st.integers(-_BOX_MM, _BOX_MM)] * 3)


class RobotModel(Model):
    """Simple model of a robot: the tool is within the bounding box of all orders, and stationary unless an order is
    in progress.
    """

    case: RobotCase

    def __init__(self) -> None:
        super().__init__()
        self._moving = AsyncExitStack()
        self.motion: Motion | None = None
        self.ended = False
        """Whether the motion was halted or abandoned."""
        self.stopped = self.troubled = False
        """Whether a stop is active (`stopped`), and whether a stop or a cut wire occurred in this session
        (`troubled`).
        """
        self.low: tuple[float, ...] = (0.0, 0.0, 0.0)
        self.high: tuple[float, ...] = (0.0, 0.0, 0.0)
        self.run(self._begin())

    async def _begin(self) -> None:
        self.rig: RobotRig = await self._stack.enter_async_context(robot_rig(self.case, Clock.running()))
        await self._open()

    async def _open(self) -> None:
        self.link: RobotLink = await self.rig.connect()
        self.link.start()
        await self.rig.within(self.link.ready(), "ready")
        self.troubled = False

    async def _attempt(self, name: str, act: Callable[[], Awaitable[Any]], expected: bool) -> Any:
        """Return the result of an action, or None if it raised a BridgeError. Fails if the error has no cause: it
        was not expected, and no stop or cut occurred.
        """
        try:
            return await self.rig.within(act(), name)
        except BridgeError as error:
            if not (expected or self.troubled):
                raise Finding(f"`{name}` fails without a cause: {error}") from error
            return None

    # --- orders

    @precondition(lambda self: self.motion is None)
    @rule()
    def begin(self) -> None:
        self._moving, self.ended = AsyncExitStack(), False
        entering = self.link.motion(LIMITS)
        motion = self.run(
            self._attempt("motion", lambda: self._moving.enter_async_context(entering), self.stopped)
        )
        self.motion = motion

    @precondition(lambda self: self.motion is not None)
    @rule(offset=_offsets, turn=st.integers(-4, 4))
    def order(self, offset: tuple[int, int, int], turn: int) -> None:
        motion = self.motion
        assert motion is not None
        pose = self.rig.place(*offset, (float(turn), 0.0, 0.0))
        refused = self.ended or self.stopped
        sent = self.run(self._attempt("to", lambda: motion.to(pose), refused))
        if sent is not None:
            if refused:
                why = "after a halt" if self.ended else "while the robot reports a stop"
                raise Finding(f"an order is accepted {why}; it must be refused")
            self.low = tuple(map(min, self.low, offset))
            self.high = tuple(map(max, self.high, offset))
        self._check()

    @precondition(lambda self: self.motion is not None)
    @rule()
    def hold(self) -> None:
        assert self.motion is not None
        self.motion.hold()
        self._check()

    @precondition(lambda self: self.motion is not None and not self.ended)
    @rule()
    def halt(self) -> None:
        motion = self.motion
        assert motion is not None
        self.ended = True
        self.run(self._attempt("halt", motion.halt, self.stopped))
        self.run(self.rig.wait(0.5))
        self.run(self.rig.check_stands("a halted robot continues to move"))

    @precondition(lambda self: self.motion is not None)
    @rule()
    def leave(self) -> None:
        leaving = self._moving
        self.motion = None
        self.run(self._attempt("leaving the movement", leaving.aclose, self.stopped))
        self.run(self.rig.wait(0.7))
        self.run(self.rig.check_stands("the robot continues to move after the movement was left"))
        self._check()

    # --- the world

    @rule(seconds=st.sampled_from([0.05, 0.3]))
    def wait(self, seconds: float) -> None:
        self.run(self.rig.wait(seconds))
        self._check()

    @precondition(lambda self: self.case.stop is not None and not self.stopped)
    @rule()
    def stop(self) -> None:
        assert self.case.stop is not None
        self.stopped = self.troubled = self.rig.inject(*self.case.stop) or self.troubled
        self.run(self.rig.wait(0.5))
        self.run(self.rig.check_stands("a stop is active, and"))

    @precondition(lambda self: self.stopped)
    @rule()
    def lift(self) -> None:
        self.rig.mend()
        self.stopped = False
        self.run(self.rig.wait(0.5))
        self.run(self.rig.check_stands("orders continued after a protective stop; it was lifted, and"))

    @rule()
    def cut(self) -> None:
        """Disconnect the cable temporarily, then restart the session, as a run must."""
        for wire in self.rig.wires:
            wire.cut = True
        self.troubled = True
        self.run(self.rig.wait(1.5))
        if self.motion is not None:
            self.motion.abandon()
            leaving, self.motion = self._moving, None
            self.run(self._attempt("leaving the movement", leaving.aclose, True))
        for wire in self.rig.wires:
            wire.cut = False
        self.run(self.rig.wait(0.5))
        self.run(
            self.rig.check_stands(
                "the cable was disconnected and reconnected without a movement in progress, and"
            )
        )
        self.run(self._anew())

    async def _anew(self) -> None:
        self.rig.mend()
        self.stopped = False
        await self.link.aclose()
        await self.rig.wait(1.5)
        with suppress(BridgeError):
            await self._open()
            return
        await self.link.aclose()
        await self.rig.wait(5.0)
        await self._open()

    # --- what must hold

    def _check(self) -> None:
        """Check that the report matches the true pose, and that the tool is within the range of the orders."""
        report = self.run(self._attempt("report", self.link.report, self.stopped))
        if report is not None:
            self.rig.check_report(report, SPEED_M_S)
        start = self.rig.case.start.position
        place = self.rig.true_pose().position
        beyond = [
            max(low * 1e-3 - (p - s), (p - s) - high * 1e-3)
            for low, high, p, s in zip(self.low, self.high, place, start, strict=True)
        ]
        if max(beyond) > 2e-3:
            raise Finding(f"the robot is {max(beyond) * 1e3:.1f} mm beyond the range of all orders: {place}")

    def teardown(self) -> None:
        async def end() -> None:
            if self.motion is not None:
                self.motion.abandon()
            with suppress(BridgeError):
                await self._moving.aclose()
            await self.link.aclose()
            await self._stack.aclose()

        self.end(end())


def check_any_order(case: RobotCase) -> None:
    """Try sequences of orders. A failing sequence is reported in its shortest form."""
    try_sequences(RobotModel, case, EXAMPLES, STEPS)
