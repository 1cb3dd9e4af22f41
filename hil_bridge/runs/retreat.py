"""Retreat without decisions: back to the depth of the start by orders alone, and the final state of the tool.

A run that can still decide retracts by its own cycles. This module serves when it cannot: an order was refused, the
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
"""Chosen: pause before a refused order is repeated."""
UNKNOWN = (math.nan, math.nan, math.nan)
"""Position of a robot that does not report one."""
ARRIVED_M = 0.3e-3
"""Chosen: distance from the last order at which the robot counts as arrived, m."""
ARRIVAL_S = 3.0
"""Chosen: longest wait for that."""
UNSEEN_S = 1.0
"""Chosen: wait for the standstill of a robot that does not report its position."""
TIME_CONSTANTS = 7.0
"""Time constants of the sensor's filter to wait at the end. Derived: less than 0.1 % then remains."""
REST_S = 0.05
"""Chosen: additional wait for the standstill of a servo."""
HASTE = 2.0
"""Chosen: factor on `task.retract_speed_mm_s` for a run that can decide no more. An order
alone takes about half of a cycle, and each goes as far as in a cycle.
"""
SOONEST_S = 0.02
"""Chosen: least time between two such orders, for a robot that accepts them at once."""
FRAME_S = 1.0
"""Chosen: longest wait for a frame of that moment."""


async def stand_still(motion: Motion) -> Sent:
    """Cancel the robot's orders. If it does not accept that, the last order remains in force."""
    with suppress(BridgeError):
        return await motion.halt()
    return Sent(math.nan)


def in_words(force: float, saturated: bool) -> str:
    """Format a force, N; NaN stands for an unknown one."""
    if not math.isfinite(force):
        return "an unknown force"
    return f"at least {force:.1f} N at the end of the sensor's range" if saturated else f"{force:.1f} N"


def not_away(depth: float, force: str) -> Reason:
    """Return the reason for a tool that is not back, from its depth below the start, m, and its force as text."""
    if math.isfinite(depth):
        text = f"the robot reports the tool {depth * 1e3:.1f} mm from the start, with {force}"
        return Reason(Cause.NOT_AWAY, text)
    return Reason(Cause.PLACE_UNKNOWN, f"the robot does not tell where the tool was left, with {force}")


@dataclass(frozen=True, slots=True)
class FinalState:
    """Final depth of the tool and force on it, as far as known."""

    depth: float
    """Reported position along the approach direction from the start point, m; NaN if unknown."""
    force: float
    """Length of the contact force, N; NaN if unknown."""
    tolerance: float
    """Force up to which the tool counts as free, N."""
    saturated: bool = False
    """The sensor was at the end of its range, so the force may be larger."""
    own_force: float = math.nan
    """Length of the force measured by the robot itself, N, if it differs by more than usual; else NaN."""
    hidden: float = 0.0
    """Force across the approach that the moments show and the force axes do not, N."""
    unverified: tuple[str, ...] = ()
    """Force axes that were not verified in this run, on which something may press."""
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
        """Whether the tool is off the surface, as far as known."""
        return self.is_away and not self.is_pressing and math.isnan(self.own_force)

    @property
    def failure(self) -> Reason | None:
        """Why a run with this final state has failed; None if it has not."""
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
        """The same as plain values, for the record; None for an unknown value."""
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
        """Description of the final state."""
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
        """Last line of a run: the final state, and the remedy if the tool is not retracted."""
        because = f", because {self.because}; hil-bridge free lifts it off"
        return f"{self.place}{'' if self.retracted else because}"


class FallbackRetraction:
    """Retracts the tool of a run that can decide no more."""

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
        """Order the tool back to the depth of the start, where it has been, as long as the robot accepts orders.

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
        """Wait until the filter has settled at a stationary tool; return the time, s."""
        settled = self._clock.now() + REST_S + TIME_CONSTANTS * self._sensor.delay
        await self._clock.sleep_until(settled)
        return settled

    def _depth(self, start: Vector, position: Vector) -> float:
        offsets = zip(position, start, self._config.frame.approach, strict=True)
        return sum((p - s) * n for p, s, n in offsets)

    def _force(self, since: float) -> float:
        """Return the length of the contact force in a sufficiently fresh frame, N; NaN without one."""
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
