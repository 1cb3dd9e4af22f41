"""Supervisor: final check before a command is sent, which allows it, clamps it or ends the run. Pure.

Away from the surface is the safe side. Depth has three limits: a growth per second, a total, and the depth at which
the current stiffness predicts the force limit. These limits never shorten a move away from the surface; only the
workspace does. A request that leaves the workspace is cut where the straight line from the last allowed position
meets the border. So the cut position is never deeper than the deeper end of the line.

A stop is latched: only a new state, created by an operator's decision, ends it. A stop requests a retraction, and
the retraction is supervised too: if it raises the force, the tool stops.
"""

import math
from dataclasses import dataclass

from msgspec.structs import replace

from hil_bridge.control.course import orientation, retreat
from hil_bridge.control.course.depth_watch import unexplained_depth, watch_contact
from hil_bridge.control.course.free_space import FreeSpace, dead_sensor_reason, watch_sample
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.stop_checks import Cycle, find_stop, is_inside, is_nearly_inside
from hil_bridge.control.course.verdict import (
    LEAVES,
    NO_FARTHER,
    OVERDUE,
    SLOWLY,
    WAITS,
    Allow,
    Clamp,
    Observation,
    Request,
    Stage,
    Stop,
    SupervisorState,
    Verdict,
)
from hil_bridge.control.course.witness import Witness
from hil_bridge.errors import Cause, ConfigError, Reason
from protocol.geometry import Quaternion, Vector, angle_between, normalise


@dataclass(frozen=True, slots=True)
class Supervisor:
    """Supervisor, which checks the observation and the request of every cycle against the limits."""

    limits: Limits
    speed: float = math.inf
    """Path velocity set on the robot, m/s. A reported position that moves faster is false."""
    witness: Witness | None = None
    """Rule for the robot's own force; None if the robot reports no force."""
    presses_aside: bool = False
    """Whether the tool may press against an obstacle next to its path. If so, `force_limit_n` applies to the force
    from the obstacle.
    """

    def initial(self, position: Vector, depth: float = 0.0) -> SupervisorState:
        """Return the initial state for a robot at the given position (base frame, m) and depth (m).

        Raises ConfigError if the position is outside the workspace. The tolerance for a reported position is the
        same as in a run: a tool may start outside by that tolerance, and moves no farther out.
        """
        if not is_nearly_inside(self.limits, position):
            raise ConfigError(
                f"the robot is at {position} m, outside the box of limits.workspace_…_m",
                remedy=_in_millimetres(self.limits, position),
                cause=Cause.START,
            )
        return SupervisorState(depth, position)

    def allows(self, position: Vector) -> bool:
        """Return whether a position (base frame, m) is inside the box of the workspace, without tolerance."""
        return is_inside(self.limits, position)

    def step(
        self, state: SupervisorState, observation: Observation, request: Request
    ) -> tuple[SupervisorState, Verdict]:
        """Check one cycle and return the new state and verdict. After the first stop, every verdict is that stop."""
        if state.stopped is not None:
            return state, Stop(state.stopped)
        sample = observation.sample
        still = state.still + observation.dt if sample.sensor_sequence == state.sensor_sequence else 0.0
        pressed = _find_press(state.pressed, observation)
        contact = watch_contact(state.contact, observation, request.stiffness, self.limits)
        disagreed = None
        if self.witness is not None and sample.witness is not None:
            disagreed = self.witness.disagreed(state.disagreed, observation)
        (x, y, z), (a, b, c), (u, v, w) = state.position, request.direction, request.position
        slip = a * (u - x) + b * (v - y) + c * (w - z) - (request.depth - state.depth)
        cycle = Cycle(
            limits=self.limits,
            state=state,
            observation=observation,
            request=request,
            slip=slip,
            still=still,
            pressed=pressed,
            speed=self.speed,
            presses_aside=self.presses_aside,
        )
        stop, free = find_stop(cycle), None
        if stop is None and disagreed and self.witness is not None:
            stop = self.witness.find_stop(disagreed, observation)
        if stop is None and (deeper := unexplained_depth(contact, self.limits)) > 0.0:
            text = (
                f"the tool is {deeper * 1e3:.1f} mm deeper than a force of {sample.force:.1f} N explains: "
                f"the sensor may not tell {deeper * contact.stiffness:.0f} N"
            )
            stop = Reason(Cause.UNANSWERED, text)
        if stop is None and observation.free_force is not None:
            free, stop = self._in_free_space(state, observation)
        if stop is not None:
            known = {"still": still, "pressed": pressed, "disagreed": disagreed, "contact": contact}
            return replace(state, stopped=stop, **known), Stop(stop)
        verdict, quaternion, home, lag = self._bound(state, observation, request)
        return (
            SupervisorState(
                depth=verdict.depth,
                position=verdict.position,
                sensor_sequence=sample.sensor_sequence,
                still=still,
                pressed=pressed,
                stopped=None,
                reported=None if sample.tilt is None else (sample.now, sample.position),
                retreat=None,
                quaternion=quaternion,
                home=home,
                lag=lag,
                disagreed=disagreed,
                free=free,
                contact=contact,
            ),
            verdict,
        )

    def _bound(
        self, state: SupervisorState, observation: Observation, request: Request
    ) -> tuple[Allow | Clamp, Quaternion | None, Quaternion | None, float]:
        """Return the limited request, the allowed orientation, the orientation at the start, and the lag of the
        rotation.
        """
        verdict = _clamp(self.limits, state, request, observation.dt)
        if observation.sample.overdue > 0.0 and verdict.depth > state.depth:
            verdict = _clamp(self.limits, state, _at_depth(request, state.depth), observation.dt)
            verdict = Clamp(verdict.depth, verdict.position, (OVERDUE,), goes_on=True)
        if request.quaternion is None:
            return verdict, state.quaternion, state.home, state.lag
        return self._turn(state, observation, request.quaternion, verdict)

    def _in_free_space(
        self, state: SupervisorState, observation: Observation
    ) -> tuple[FreeSpace | None, Reason | None]:
        """Return the updated sensor check while the tool moves through free space, and the reason to stop."""
        if observation.position is None or observation.free_force is None:
            return None, None
        changed = observation.sample.unchanged < observation.dt  # since the previous decision
        free = watch_sample(
            state.free,
            self.limits,
            observation.sample.now,
            -observation.free_force,
            (changed, observation.position),
        )
        return free, dead_sensor_reason(
            free,
            self.limits,
            observation.sample.now,
            -observation.free_force,
            (observation.sample.unchanged, observation.position),
        )

    def _turn(
        self, state: SupervisorState, observation: Observation, target: Quaternion, verdict: Allow | Clamp
    ) -> tuple[Allow | Clamp, Quaternion, Quaternion, float]:
        """Return the verdict including the orientation, the allowed orientation, the orientation at the start, and
        the new lag.
        """
        before = state.quaternion or normalise(observation.sample.quaternion or target)
        home = state.home or before
        allowed, reasons = orientation.limit_turn(self.limits, home, before, target, observation.dt)
        lag = orientation.behind(state.lag, angle_between(before, allowed), observation.dt)
        if reasons:
            holds, goes_on = (verdict.holds, verdict.goes_on) if isinstance(verdict, Clamp) else ((), True)
            verdict = Clamp(verdict.depth, verdict.position, (*holds, *reasons), goes_on)
        return verdict, allowed, home, lag

    def stop(self, state: SupervisorState, reason: Reason) -> tuple[SupervisorState, Stop]:
        """End the motion for an external reason. The first stop is kept."""
        stopped = state.stopped or reason
        return replace(state, stopped=stopped), Stop(stopped)

    def retreat(
        self, state: SupervisorState, observation: Observation, request: Request
    ) -> tuple[SupervisorState, Verdict]:
        """Check one cycle of a retraction. Only one condition stops it: a force that rises, or stays above its
        limit, while the tool moves away.

        The tool then stops. If the force is unknown, the tool moves slowly back to the depth of the start, where it
        has already been. If it pressed, it moves back by at least `blind_retract_mm`. The request must be finite. A
        stop stays latched.
        """
        before, effective, limits = state.retreat, observation, self.limits
        after = before
        known = retreat.is_known(limits, before, effective) and self._fresh(effective)
        if known:
            after, reason = retreat.watch(limits, before, effective, state.contact)
            if reason is not None:
                return replace(state, retreat=after, stopped=state.stopped or reason), Stop(reason)
            hold = SLOWLY if after.pull and after.stage in (Stage.GOES, Stage.TRUSTED) else WAITS
            highest = state.depth - retreat.longest_step_back(after, effective.dt)
        else:
            goal = retreat.blind_goal(limits, state.pressed, before)
            hold = SLOWLY if goal < state.depth else NO_FARTHER
            highest = state.depth - max(min(state.depth - goal, retreat.BLIND_M_S * effective.dt), 0.0)
        verdict = _clamp(limits, state, request, effective.dt)
        if verdict.depth < highest:
            verdict = _clamp(limits, state, _at_depth(request, highest), effective.dt)
            verdict = Clamp(verdict.depth, verdict.position, (hold,), goes_on=hold is not NO_FARTHER)
        return replace(state, depth=verdict.depth, position=verdict.position, retreat=after), verdict

    def _fresh(self, observation: Observation) -> bool:
        return (
            0.0 <= (observation.sample.now - observation.sample.sensor_at) * 1e3 <= self.limits.stale_after_ms
        )


_BEYOND_BARRIER = Reason(Cause.BARRIER, "deeper than where the force limit is predicted")


def _in_millimetres(limits: Limits, position: Vector) -> str:
    """Return a hint for a box whose corners seem to be in mm; empty otherwise."""
    x, y, z = position
    corners = limits.workspace_min_m, limits.workspace_max_m
    if not is_inside(limits, (x * 1e3, y * 1e3, z * 1e3)):
        return ""
    low, high = ([round(part * 1e-3, 6) for part in corner] for corner in corners)
    return f"its corners are in m; did you mean {low} and {high}?"


def _at_depth(request: Request, depth: float) -> Request:
    """Return a copy of the request at another depth."""
    (x, y, z), (a, b, c), by = request.position, request.direction, depth - request.depth
    return Request(depth, (x + a * by, y + b * by, z + c * by), request.direction, request.barrier)


def _find_press(before: tuple[float, float] | None, observation: Observation) -> tuple[float, float] | None:
    """Return the force and depth since which a pressing tool has caused no response; None while the tool does not
    press.

    Even the force of a dead sensor changes a little, because it is rotated by the reported orientation, which
    jitters.
    """
    if not observation.pressing:
        return None
    sample, depth = observation.sample, observation.depth
    still = sample.unchanged >= observation.dt  # no change on any axis since the previous decision
    if before is None or not (still or abs(before[0] - sample.force) < _SAME_N):
        return sample.force, depth
    # After an intermediate retraction, the earlier depth does not count.
    return (before[0], depth) if depth < before[1] else before


def _clamp(limits: Limits, state: SupervisorState, request: Request, dt: float) -> Allow | Clamp:
    """Clamp the request to the motion limits. The previous request was `dt` seconds earlier.

    The calculation uses plain numbers because it runs in every cycle, and arrays of three elements take ten times
    as long.
    """
    reasons: list[Reason] = []
    depth, target = request.depth, request.position
    deepest_now = state.depth + limits.correction_mm_s * 1e-3 * dt
    deepest_total = limits.correction_total_mm * 1e-3
    if state.depth > deepest_total:
        deepest_total = state.depth
    if depth > deepest_now or depth > deepest_total or depth > request.barrier:
        deepest = min(deepest_now, deepest_total, request.barrier)
        if deepest == request.barrier:
            reasons.append(_BEYOND_BARRIER)
        elif deepest_now < deepest_total:
            reasons.append(Reason(Cause.DEEPER, f"deeper faster than {limits.correction_mm_s:g} mm/s"))
        else:
            text = f"deeper than {limits.correction_total_mm:g} mm in total"
            reasons.append(Reason(Cause.TOTAL, text))
        excess, (x, y, z), (a, b, c) = depth - deepest, target, request.direction
        target, depth = (x - a * excess, y - b * excess, z - c * excess), deepest

    longest = limits.travel_mm_s * 1e-3 * dt
    if math.dist(state.position, target) > longest:  # the part across may then also be longer
        (x, y, z), (_, (a, b, c)) = target, _parts(state.position, target, request.direction)
        length = math.hypot(a, b, c)
        if length > longest + _ROUNDING:
            cut = 1 - longest / length
            target = x - a * cut, y - b * cut, z - c * cut
            reasons.append(Reason(Cause.ACROSS, f"across faster than {limits.travel_mm_s:g} mm/s"))

    if not is_inside(limits, target):
        (x, y, z), low, high = target, limits.workspace_min_m, limits.workspace_max_m
        u, v, w = state.position
        # A tool that started slightly outside may stay there, and return.
        low = min(low[0], u), min(low[1], v), min(low[2], w)
        high = max(high[0], u), max(high[1], v), max(high[2], w)
        if not (low[0] <= x <= high[0] and low[1] <= y <= high[1] and low[2] <= z <= high[2]):
            # The part across the approach is cut first: a lateral border must not hold the depth.
            (along, _), (a, b, c) = _parts(state.position, target, request.direction), request.direction
            target = u + a * along, v + b * along, w + c * along
            share = min(map(_share_inside, state.position, target, low, high))
            # The last allowed position is inside; the border only removes rounding errors.
            x, y, z = (
                min(max(before + share * (to - before), lowest), highest)
                for before, to, lowest, highest in zip(state.position, target, low, high, strict=True)
            )
            target = x, y, z
            depth = state.depth + share * (depth - state.depth)
            reasons.append(LEAVES)

    if not reasons:
        return Allow(depth, request.position)
    return Clamp(depth, target, tuple(reasons))


def _parts(before: Vector, after: Vector, direction: Vector) -> tuple[float, Vector]:
    """Split a motion into its component along a direction, m, and the vector across it, m."""
    (u, v, w), (x, y, z), (a, b, c) = before, after, direction
    x, y, z = x - u, y - v, z - w
    along = x * a + y * b + z * c
    return along, (x - a * along, y - b * along, z - c * along)


def _share_inside(before: float, target: float, low: float, high: float) -> float:
    """Return the share of the line from an allowed point to the target that stays between the borders, on one axis."""
    if low <= target <= high:
        return 1.0
    return ((high if target > before else low) - before) / (target - before)


_ROUNDING = 1e-9
"""Tolerance for rounding errors, m. It allows a clamped request to be repeated."""

_SAME_N = 2e-3
"""Smallest change of force that counts as a response to a pressing tool, N. Chosen: several times the change of 100
N that the jitter of a reported orientation causes, and less than a count of most sensors.
"""
