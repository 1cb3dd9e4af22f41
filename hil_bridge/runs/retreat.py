"""The ways out of a movement: back to where the run started, by orders alone, and where the tool was left.

A run that can still decide retracts by its own cycles. What is here serves when it cannot: an order was refused, the
link was cut, or a bug ended it.
"""

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from hil_bridge.clock import Clock
from hil_bridge.control import Clamp, ControlLoop, LoopState, Observation, Request, Sample, Stop, Supervisor
from hil_bridge.devices.robots.seam import Motion, Pacing, RobotLink, Sent
from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.errors import BridgeError, Cause, DeviceError, OrderRefused, Reason, TransportError
from hil_bridge.runs.small_steps import FOLLOWS_M
from hil_bridge.settings.configuration import Config
from protocol.geometry import Pose, Quaternion, Vector

TRY_AGAIN_S = 0.3
"""Chosen: pause before an order that was refused is given again."""
UNKNOWN = (math.nan, math.nan, math.nan)
"""A position that no robot tells."""
ARRIVED_M = 0.3e-3
"""Chosen: distance from the last order at which the robot counts as come to rest, m."""
ARRIVAL_S = 3.0
"""Chosen: how long is waited for that."""
UNSEEN_S = 1.0
"""Chosen: how long is waited for a robot to come to rest that does not tell where it is."""
TIME_CONSTANTS = 7.0
"""Time constants of the sensor's filter, waited for at the end. Derived: after as many less than 0.1 % is left."""
REST_S = 0.05
"""Chosen: waited for beside the filter, for a servo to come to rest."""
HASTE = 2.0
"""Chosen: how many times faster than `task.retract_speed_mm_s` the tool leaves when a run can decide no more. An order
alone takes about half of a cycle, and each goes as far as in a cycle.
"""
SOONEST_S = 0.02
"""Chosen: time from one such order to the next at least, for a robot that takes them at once."""
FRAME_S = 1.0
"""Chosen: how long is waited for a frame of that moment."""


async def stand_still(motion: Motion) -> Sent:
    """Let the robot forget what it was ordered to. Where it does not take that, the last order stays the last."""
    with suppress(BridgeError):
        return await motion.halt()
    return Sent(math.nan)


def in_words(force: float, saturated: bool) -> str:
    """Format a force, N; NaN stands for an unknown one."""
    if not math.isfinite(force):
        return "an unknown force"
    return f"at least {force:.1f} N at the end of the sensor's range" if saturated else f"{force:.1f} N"


def not_away(depth: float, force: str) -> Reason:
    """Why a tool has not come back, from its depth below the start, m, and its force in words."""
    if math.isfinite(depth):
        text = f"the robot reports the tool {depth * 1e3:.1f} mm from the start, with {force}"
        return Reason(Cause.NOT_AWAY, text)
    return Reason(Cause.PLACE_UNKNOWN, f"the robot does not tell where the tool was left, with {force}")


@dataclass(frozen=True, slots=True)
class FinalState:
    """Where the tool was left, as far as it is known."""

    depth: float
    """Reported position along the approach direction from the start point, m; NaN where it is not known."""
    force: float
    """Length of the contact force, N; NaN where it is not known."""
    tolerance: float
    """Force up to which the tool counts as free, N."""
    saturated: bool = False
    """The sensor was at the end of its range, so that the force may be any above."""
    own_force: float = math.nan
    """Length of the force that the robot itself feels, N, where that is no ordinary difference; else NaN."""
    hidden: float = 0.0
    """Force across the approach that the moments show and the force axes do not, N."""
    unverified: tuple[str, ...] = ()
    """Force axes on which something may press that nothing has verified in this run."""
    because: str = ""
    """Why it was not retracted."""

    @property
    def is_away(self) -> bool:
        """Whether the tool is back at the depth of the start."""
        return self.depth <= ARRIVED_M

    @property
    def is_pressing(self) -> bool:
        """Whether the tool may press on something."""
        return self.saturated or not self.force <= self.tolerance or self.hidden > 0.0

    @property
    def retracted(self) -> bool:
        """Whether the tool is off the surface, by all that is known."""
        return self.is_away and not self.is_pressing and math.isnan(self.own_force)

    @property
    def failure(self) -> Reason | None:
        """Why a run that left the tool here has failed; None where it has not."""
        force = in_words(self.force, self.saturated)
        if not self.is_away:
            return not_away(self.depth, force)
        if self.is_pressing and not math.isfinite(self.force):
            return Reason(Cause.LEFT_UNKNOWN, "the sensor tells no force after the retraction")
        if self.is_pressing:
            text = (
                f"{force} after the retraction: the tool touches something, or the sensor's zero has changed"
            )
            return Reason(Cause.LEFT_PRESSING, text)
        if math.isfinite(self.own_force):
            text = f"the force sensor tells {force} after the retraction, the robot itself feels {self.own_force:.0f} N"
            return Reason(Cause.LEFT_DISAGREEING, text)
        return None

    @property
    def values(self) -> dict[str, bool | float | list[str] | None]:
        """The same as plain values, for the record; None for what is not known."""
        depth = self.depth if math.isfinite(self.depth) else None
        known = math.isfinite(self.force) and not self.saturated and not self.hidden
        return {
            "retracted": self.retracted,
            "depth_m": depth,
            "force_n": self.force if known else None,
            "unverified": list(self.unverified),
        }

    @property
    def place(self) -> str:
        """Where it was left, in words."""
        force = in_words(self.force, self.saturated) if math.isfinite(self.force) else "force unknown"
        if math.isfinite(self.own_force):
            force += f" (the robot itself feels {self.own_force:.0f} N)"
        if self.hidden:
            force += f" (the moments show {self.hidden:.0f} N across the approach)"
        if self.unverified:
            force += f" ({' '.join(self.unverified)} not verified)"
        if self.retracted:
            return f"retracted, {force}"
        depth = f"{self.depth * 1e3:.1f} mm" if math.isfinite(self.depth) else "an unknown depth"
        return f"NOT retracted: left at {depth}, {force}"

    @property
    def text(self) -> str:
        """The result in words, for the last line of a run."""
        because = f", because {self.because}; hil-bridge free lifts it off"
        return f"{self.place}{'' if self.retracted else because}"


class FallbackRetraction:
    """Retracts a tool whose run can decide no more."""

    def __init__(
        self, config: Config, clock: Clock, robot: RobotLink, sensor: ForceSensor, loop: ControlLoop
    ) -> None:
        self._config, self._clock, self._robot, self._sensor = config, clock, robot, sensor
        self._loop = loop
        self._supervisor = Supervisor(config.limits)

    async def retract(
        self,
        motion: Motion,
        state: LoopState,
        orientation: Quaternion,
        blame: Callable[[Reason], None],
    ) -> None:
        """Order the tool back to the depth of the start, where it has been, as long as the robot takes orders.

        Orders that are refused or not answered are given again for `limits.retract_patience_s`. `blame` is given what
        prevents it. At least one order is given where the robot may yet take one that the state does not know: it may
        be deeper, and the movement ends at the last one. Raises nothing but what cancels the task.
        """
        limits, loop = self._config.limits, self._loop
        speed_mm_s, took = HASTE * loop.program.parameters.retract_speed_mm_s, loop.sample_time / HASTE
        supervisor = state.supervisor
        patience = self._clock.now() + limits.retract_patience_s
        in_flight = _is_in_flight(motion, supervisor.position)
        goal = 0.0
        if state.program.in_contact:  # a surface may have risen above the start
            goal = min(goal, supervisor.depth - self._config.task.retract_mm * 1e-3)
        while supervisor.depth > goal or in_flight:
            begun, way = self._clock.now(), loop.program.stroke.way(speed_mm_s, took)
            depth = min(max(supervisor.depth - way, goal), supervisor.depth)
            request = self._request(supervisor.depth, supervisor.position, depth)
            after, verdict = self._supervisor.retreat(
                supervisor, self._observe(state, supervisor.depth), request
            )
            if isinstance(verdict, Stop):
                blame(verdict.reason)
                await stand_still(motion)
                return
            try:
                await motion.to(Pose(verdict.position, orientation))
                await motion.settled()
            except BridgeError as error:
                blame(error.reason(Cause.DEAD_LINK))
                if isinstance(error, TransportError) or self._clock.now() >= patience:
                    if not isinstance(error, OrderRefused):
                        motion.abandon()
                    return
                await self._clock.sleep_until(self._clock.now() + TRY_AGAIN_S)
                continue
            if verdict.depth >= supervisor.depth and not (isinstance(verdict, Clamp) and verdict.goes_on):
                return  # held back at the border of the workspace
            supervisor, in_flight = after, False
            if self._clock.now() < begun + SOONEST_S:
                await self._clock.sleep_until(begun + SOONEST_S)
            took = min(self._clock.now() - begun, loop.sample_time)
            patience = self._clock.now() + limits.retract_patience_s

    def _request(self, before: float, position: Vector, depth: float) -> Request:
        approach = self._config.frame.approach
        x, y, z = (p + n * (depth - before) for p, n in zip(position, approach, strict=True))
        return Request(depth, (x, y, z), approach)

    def _observe(self, state: LoopState, depth: float) -> Observation:
        """Observation from the sensor alone, without a status of the robot, which was ordered to this depth, m."""
        sensor, newest, now = self._sensor, self._sensor.newest, self._clock.now()
        force = resultant = math.nan
        fault = None
        if newest is not None and sensor.peaks is not None:
            force, resultant = sensor.peaks.along(newest.values), sensor.peaks.resultant(newest.values)
        try:
            sensor.check()
        except BridgeError as error:
            fault = error.reason(Cause.SENSOR_FAILED)
        sample = Sample(
            now=now,
            position=UNKNOWN,
            force=force,
            resultant=resultant,
            sensor_at=sensor.newest_at,
            sensor_sequence=0 if newest is None else newest.sequence,
            saturated=bool(sensor.saturated),
            fault=fault,
        )
        return Observation(sample, depth, pressing=state.program.in_contact)

    async def rest(self, start: Vector, commanded: Vector, answers: bool) -> tuple[float, float]:
        """Wait until the robot has come to rest at the last order; its depth from the start, m, and the force, N.

        A robot that is asked goes to an order that it has taken, also where it does not answer any more. One that did
        not answer the last order, and a streamed one, may never have been given it. NaN for what cannot be known.
        """
        taken = answers and self._robot.facts.pacing is Pacing.ASKED
        depth = self._depth(start, commanded) if taken else math.nan
        patience = self._clock.now() + ARRIVAL_S
        try:
            if not answers:
                raise DeviceError("the robot does not answer", cause=Cause.DEAD_LINK)
            while True:
                position = (await self._robot.report()).pose.position
                depth = self._depth(start, position)
                if math.dist(position, commanded) <= ARRIVED_M or self._clock.now() > patience:
                    break
            settled = await self._settle()
            # one that was stopped on its way passes the last order, and comes to rest behind it
            while self._clock.now() <= patience:
                before, position = position, (await self._robot.report()).pose.position
                depth = self._depth(start, position)
                if math.dist(before, position) <= FOLLOWS_M:
                    break
                await self._clock.sleep_until(self._clock.now() + REST_S)
        except BridgeError:
            await self._clock.sleep_until(self._clock.now() + UNSEEN_S)
            settled = await self._settle()
        while math.isnan(force := self._force(settled)) and self._clock.now() < settled + FRAME_S:
            await self._clock.sleep_until(self._clock.now() + REST_S)
        return depth, force

    async def _settle(self) -> float:
        """Wait until the filter has settled at a tool that stands; when it has, s."""
        settled = self._clock.now() + REST_S + TIME_CONSTANTS * self._sensor.delay
        await self._clock.sleep_until(settled)
        return settled

    def _depth(self, start: Vector, position: Vector) -> float:
        offsets = zip(position, start, self._config.frame.approach, strict=True)
        return sum((p - s) * n for p, s, n in offsets)

    def _force(self, since: float) -> float:
        """Length of the contact force in a frame that is fresh enough, N; NaN if there is none."""
        newest, peaks = self._sensor.newest, self._sensor.peaks
        try:
            self._sensor.check()
        except BridgeError:
            return math.nan
        if newest is None or peaks is None or self._sensor.newest_at < since:
            return math.nan
        return peaks.resultant(newest.values)


def _is_in_flight(motion: Motion, known: Vector) -> bool:
    """Return whether the newest order, which the robot may have taken or not, is another than this position."""
    try:
        return motion.commanded not in (None, known)
    except BridgeError:
        return True
