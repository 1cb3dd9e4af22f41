"""Retraction without decisions: back to the depth of the start by orders alone, and the final state of the tool.

A run that can still decide retracts in its own cycles. This module is for a run that can no longer decide: an order
was refused, the link was cut, or an internal error ended it.
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
"""Pause before a refused order is repeated, s. Chosen."""
UNKNOWN = (math.nan, math.nan, math.nan)
"""Position of a robot that does not report its position."""
ARRIVED_M = 0.3e-3
"""Distance from the last order at which the robot counts as arrived, m. Chosen."""
ARRIVAL_S = 3.0
"""Time limit for the robot to arrive at its last order, s. Chosen."""
UNSEEN_S = 1.0
"""Time to wait for a robot to stop if it does not report its position, s. Chosen."""
TIME_CONSTANTS = 7.0
"""Number of time constants of the sensor's filter to wait at the end. Derived: less than 0.1 % then remains."""
REST_S = 0.05
"""Additional time to wait for a servo to stop, s. Chosen."""
HASTE = 2.0
"""Factor on `task.retract_speed_mm_s` for a run that can no longer decide. Chosen: a single order takes about half
of a cycle, and moves the tool as far as one cycle does.
"""
SOONEST_S = 0.02
"""Shortest time between two orders of such a retraction, for a robot that accepts orders at once, s. Chosen."""
FRAME_S = 1.0
"""Time limit for a frame that was measured after the sensor's filter had settled, s. Chosen."""


async def cancel_orders(motion: Motion) -> Sent:
    """Cancel the robot's orders. If the robot does not accept this, the last order remains active."""
    with suppress(BridgeError):
        return await motion.halt()
    return Sent(math.nan)


def force_text(force: float, saturated: bool) -> str:
    """Return a force (N) as text. NaN stands for an unknown force."""
    if not math.isfinite(force):
        return "an unknown force"
    return f"at least {force:.1f} N at the end of the sensor's range" if saturated else f"{force:.1f} N"


def not_retracted_reason(depth: float, force: str) -> Reason:
    """Return the reason why a tool has not retracted, from its depth below the start, m, and its force as text."""
    if math.isfinite(depth):
        text = f"the robot reports the tool {depth * 1e3:.1f} mm from the start, with {force}"
        return Reason(Cause.NOT_AWAY, text)
    return Reason(Cause.PLACE_UNKNOWN, f"the robot does not report where the tool was left, with {force}")


@dataclass(frozen=True, slots=True)
class FinalState:
    """Final state of a run: depth of the tool and force on it, as far as known."""

    depth: float
    """Reported position along the approach direction from the start point, m; NaN if unknown."""
    force: float
    """Magnitude of the contact force, N; NaN if unknown."""
    tolerance: float
    """Largest force at which the tool counts as free, N."""
    saturated: bool = False
    """Whether the sensor was at the end of its range, so that the force may be larger."""
    own_force: float = math.nan
    """Magnitude of the force measured by the robot itself, N, if it differs from the sensor's force by more than
    usual; otherwise NaN.
    """
    hidden: float = 0.0
    """Force across the approach that the moments show and the force axes do not, N."""
    unverified: tuple[str, ...] = ()
    """Force axes that were not verified in this run, along which a contact would go unnoticed."""
    because: str = ""
    """Reason why the tool was not retracted."""

    @property
    def is_away(self) -> bool:
        """Whether the tool is back at the depth of the start."""
        return self.depth <= ARRIVED_M

    @property
    def is_pressing(self) -> bool:
        """Whether the tool may be pressing on something."""
        return self.saturated or not self.force <= self.tolerance or self.hidden > 0.0

    @property
    def retracted(self) -> bool:
        """Whether the tool is off the surface, as far as known."""
        return self.is_away and not self.is_pressing and math.isnan(self.own_force)

    @property
    def failure(self) -> Reason | None:
        """Reason why a run with this final state has failed; None if it has not failed."""
        force = force_text(self.force, self.saturated)
        if not self.is_away:
            return not_retracted_reason(self.depth, force)
        if self.is_pressing and not math.isfinite(self.force):
            return Reason(Cause.LEFT_UNKNOWN, "the sensor reports no force after the retraction")
        if self.is_pressing:
            text = (
                f"{force} after the retraction: the tool touches something, or the sensor's zero has changed"
            )
            return Reason(Cause.LEFT_PRESSING, text)
        if math.isfinite(self.own_force):
            text = (
                f"the force sensor reports {force} after the retraction, "
                f"the robot itself measures {self.own_force:.0f} N"
            )
            return Reason(Cause.LEFT_DISAGREEING, text)
        return None

    @property
    def values(self) -> dict[str, bool | float | list[str] | None]:
        """Final state as plain values, for the recording; None for an unknown value, and for a force that the robot's
        own measurement contradicts.
        """
        depth = self.depth if math.isfinite(self.depth) else None
        known = math.isfinite(self.force) and not (
            self.saturated or self.hidden or math.isfinite(self.own_force)
        )
        return {
            "retracted": self.retracted,
            "depth_m": depth,
            "force_n": self.force if known else None,
            "unverified": list(self.unverified),
        }

    @property
    def place(self) -> str:
        """Description of the final state of the tool."""
        force = force_text(self.force, self.saturated) if math.isfinite(self.force) else "force unknown"
        if math.isfinite(self.own_force):
            force += f" (the robot itself measures {self.own_force:.0f} N)"
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
        """Last line of a run: the final state, and the reason if the tool has not been retracted."""
        return self.place if self.retracted else f"{self.place}, because {self.because}"


class FallbackRetraction:
    """Retraction of the tool in a run that can no longer decide."""

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
        """Order the tool back to the depth of the start, where it has already been, as long as the robot accepts
        orders.

        Orders that are refused or not answered are repeated for `limits.retract_patience_s`. `blame` is called with
        the reason that prevents the retraction. At least one order is sent if the robot may still carry out an
        order that the state does not contain: the tool may be deeper, and the movement ends at the last order.
        Raises nothing except when the task is cancelled.
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
            begun, distance = self._clock.now(), loop.program.stroke.way(speed_mm_s, took)
            depth = min(max(supervisor.depth - distance, goal), supervisor.depth)
            request = self._request(supervisor.depth, supervisor.position, depth)
            after, verdict = self._supervisor.retreat(
                supervisor, self._observe(state, supervisor.depth), request
            )
            if isinstance(verdict, Stop):
                blame(verdict.reason)
                await cancel_orders(motion)
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
                return  # held at the border of the workspace
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
        """Return an observation from the sensor alone, without a robot report. `depth` is the ordered depth, m."""
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
        """Wait until the robot has stopped at the last order. Return its depth from the start, m, and the force, N.

        A polled robot moves to an order that it has accepted, even if it no longer responds. A robot that did not
        answer the last order may never have received it, and neither may a streaming robot. Unknown values are NaN.
        """
        may_move = answers and self._robot.facts.pacing is Pacing.ASKED
        depth = self._depth(start, commanded) if may_move else math.nan
        patience = self._clock.now() + ARRIVAL_S
        try:
            if not answers:
                raise DeviceError("the robot does not answer", cause=Cause.DEAD_LINK)
            while True:
                position = (await self._robot.report()).pose.position
                depth = self._depth(start, position)
                if math.dist(position, commanded) <= ARRIVED_M or self._clock.now() > patience:
                    break
            settled_at = await self._settle()
            # a robot that was stopped in motion overshoots the last order, and stops beyond it
            while self._clock.now() <= patience:
                before, position = position, (await self._robot.report()).pose.position
                depth = self._depth(start, position)
                if math.dist(before, position) <= FOLLOWS_M:
                    break
                await self._clock.sleep_until(self._clock.now() + REST_S)
        except BridgeError:
            await self._clock.sleep_until(self._clock.now() + UNSEEN_S)
            settled_at = await self._settle()
        while math.isnan(force := self._force(settled_at)) and self._clock.now() < settled_at + FRAME_S:
            await self._clock.sleep_until(self._clock.now() + REST_S)
        return depth, force

    async def _settle(self) -> float:
        """Wait until the filter has settled while the tool is stationary. Return the time, s."""
        settled_at = self._clock.now() + REST_S + TIME_CONSTANTS * self._sensor.delay
        await self._clock.sleep_until(settled_at)
        return settled_at

    def _depth(self, start: Vector, position: Vector) -> float:
        offsets = zip(position, start, self._config.frame.approach, strict=True)
        return sum((p - s) * n for p, s, n in offsets)

    def _force(self, since: float) -> float:
        """Return the magnitude of the contact force from a sufficiently fresh frame, N, or NaN."""
        newest, peaks = self._sensor.newest, self._sensor.peaks
        try:
            self._sensor.check()
        except BridgeError:
            return math.nan
        if newest is None or peaks is None or self._sensor.newest_at < since:
            return math.nan
        return peaks.resultant(newest.values)


def _is_in_flight(motion: Motion, known: Vector) -> bool:
    """Return whether the newest order, accepted by the robot or not, differs from the given position."""
    try:
        return motion.commanded not in (None, known)
    except BridgeError:
        return True
