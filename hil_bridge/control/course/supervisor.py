"""The last word before the wire: what may be sent, what is clamped, what ends the run. Pure.

Which side is safe: away from the surface. Depth has three limits: a growth per second, a total, and the depth at which
the stiffness in hand predicts the force limit. A move that pulls back is never shortened by these, only by the
workspace. A request that leaves the workspace is cut where the straight way from the last allowed position meets its
border. So the cut position is never deeper than both ends. A stop is latched: only a new state, made by a person's
decision, ends it. A stop asks for a retraction, and the retraction is supervised too: where it makes the force rise,
the tool stands still.
"""

import math
from dataclasses import dataclass

from msgspec.structs import replace

from hil_bridge.control.course import orientation, retreat
from hil_bridge.control.course.depth_watch import untold_depth, watch_contact
from hil_bridge.control.course.free_space import FreeSpace, lifeless, watch_sample
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.sideways import HIDDEN_N
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
from hil_bridge.control.course.wall import beyond_friction
from hil_bridge.control.course.witness import Witness
from hil_bridge.control.sample import Sample
from hil_bridge.errors import Cause, ConfigError, Reason
from protocol.geometry import Quaternion, Vector, angle_between, normalise


@dataclass(frozen=True, slots=True)
class Supervisor:
    """Checks every cycle's observation and request against the limits."""

    limits: Limits
    speed: float = math.inf
    """Path velocity that the robot is given, m/s: a reported position that moves faster is not true."""
    witness: Witness | None = None
    """The rule for the robot's own force; None where it tells none."""
    presses_aside: bool = False
    """The tool may press against what is beside its way: a force from there is judged by `force_limit_n`."""

    def initial(self, position: Vector, depth: float = 0.0) -> SupervisorState:
        """State for a robot that stands at this position in the base frame and at this depth, m.

        Raises ConfigError when that is outside the workspace. A reported position is taken with the same tolerance as
        in a run: a tool may stand that far outside, and goes no farther out.
        """
        if not _inside_nearly(self.limits, position):
            raise ConfigError(
                f"the robot stands at {position} m, outside the box of limits.workspace_…_m",
                remedy=_in_millimetres(self.limits, position),
                cause=Cause.START,
            )
        return SupervisorState(depth, position)

    def allows(self, position: Vector) -> bool:
        """Whether a place, base frame, m, is in the box of the workspace, to the letter."""
        return _inside(self.limits, position)

    def step(
        self, state: SupervisorState, observation: Observation, request: Request
    ) -> tuple[SupervisorState, Verdict]:
        """One cycle. After the first stop every answer is that stop."""
        if state.stopped is not None:
            return state, state.stopped
        sample = observation.sample
        still = state.still + observation.dt if sample.sensor_sequence == state.sensor_sequence else 0.0
        pressed = _find_press(state.pressed, observation)
        seen = sample, observation.depth, observation.dt, observation.pressing
        contact = watch_contact(state.contact, seen, request.stiffness, self.limits)
        disagreed = None
        if self.witness is not None and sample.witness is not None:
            disagreed = self.witness.disagreed(state.disagreed, observation)
        stop, free = self._first_fault(state, observation, request, still, pressed), None
        if stop is None:
            if (
                disagreed
                and self.witness is not None
                and (text := self.witness.fault(disagreed, observation))
            ):
                stop = Stop(Cause.WITNESS, text)
            elif (deeper := untold_depth(contact, self.limits)) > 0.0:
                text = (
                    f"the tool is {deeper * 1e3:.1f} mm deeper than a force of {sample.force:.1f} N explains: "
                    f"the sensor may not tell {deeper * contact.stiffness:.0f} N"
                )
                stop = Stop(Cause.UNANSWERED, text)
            elif observation.free_force is not None:
                free, stop = self._in_free_space(state, observation)
        if stop is not None:
            return replace(
                state, still=still, pressed=pressed, stopped=stop, disagreed=disagreed, contact=contact
            ), stop
        verdict = _clamp(self.limits, state, request, observation.dt)
        if sample.overdue > 0.0 and verdict.depth > state.depth:
            verdict = _clamp(self.limits, state, _at_depth(request, state.depth), observation.dt)
            verdict = Clamp(verdict.depth, verdict.position, (OVERDUE,), goes_on=True)
        quaternion, home, lag = state.quaternion, state.home, state.lag
        if request.quaternion is not None:
            verdict, quaternion, home, lag = self._turn(state, observation, request.quaternion, verdict)
        return (
            SupervisorState(
                verdict.depth,
                verdict.position,
                sample.sensor_sequence,
                still,
                pressed,
                None,
                None if sample.tilt is None else (sample.now, sample.position),
                None,
                quaternion,
                home,
                lag,
                disagreed,
                free,
                contact,
            ),
            verdict,
        )

    def _in_free_space(
        self, state: SupervisorState, seen: Observation
    ) -> tuple[FreeSpace | None, Stop | None]:
        """The watch over the sensor while the tool moves through free space, and its stop."""
        if seen.position is None or seen.free_force is None:
            return None, None
        changed = seen.sample.unchanged < seen.dt  # since the decision before
        free = watch_sample(
            state.free, self.limits, seen.sample.now, -seen.free_force, (changed, seen.position)
        )
        lost = lifeless(
            free, self.limits, seen.sample.now, -seen.free_force, (seen.sample.unchanged, seen.position)
        )
        return free, None if lost is None else Stop(lost.cause, lost.text)

    def _turn(
        self, state: SupervisorState, seen: Observation, wanted: Quaternion, verdict: Allow | Clamp
    ) -> tuple[Allow | Clamp, Quaternion, Quaternion, float]:
        """The verdict with that on the orientation; the orientation allowed, that of the start, and the new lag."""
        before = state.quaternion or normalise(seen.sample.quaternion or wanted)
        home = state.home or before
        given, reasons = orientation.limit_turn(self.limits, home, before, wanted, seen.dt)
        lag = orientation.behind(state.lag, angle_between(before, given), seen.dt)
        if reasons:
            holds, goes_on = (verdict.holds, verdict.goes_on) if isinstance(verdict, Clamp) else ((), True)
            verdict = Clamp(verdict.depth, verdict.position, (*holds, *reasons), goes_on)
        return verdict, given, home, lag

    def stop(self, state: SupervisorState, cause: Cause, text: str) -> tuple[SupervisorState, Stop]:
        """End the motion for a reason that was found elsewhere. The first stop stays."""
        stop = state.stopped or Stop(cause, text)
        return replace(state, stopped=stop), stop

    def retreat(
        self, state: SupervisorState, observation: Observation, request: Request
    ) -> tuple[SupervisorState, Verdict]:
        """One cycle of pulling back, which no stop ends but one: a force that rises, or stays over its limit, while
        the tool moves away. The tool stands still then.

        Where the force cannot be known the tool goes back slowly to the depth of the start, where it has been. Where
        it pressed, it goes back by `blind_retract_mm` at least. The request must be finite. A stop stays latched.
        """
        before, seen, limits = state.retreat, observation, self.limits
        after = before
        known = retreat.is_known(limits, before, seen) and self._fresh(seen)
        if known:
            after, reason = retreat.watch(limits, before, seen, state.contact)
            if reason is not None:
                stop = Stop(reason.cause, reason.text)
                return replace(state, retreat=after, stopped=state.stopped or stop), stop
            held = SLOWLY if after.pull and after.stage in (Stage.GOES, Stage.TRUSTED) else WAITS
            highest = state.depth - retreat.longest_way(after, seen.dt)
        else:
            goal = retreat.blind_goal(limits, state.pressed, before)
            held = SLOWLY if goal < state.depth else NO_FARTHER
            highest = state.depth - max(min(state.depth - goal, retreat.BLIND_M_S * seen.dt), 0.0)
        verdict = _clamp(limits, state, request, seen.dt)
        if verdict.depth < highest:
            verdict = _clamp(limits, state, _at_depth(request, highest), seen.dt)
            verdict = Clamp(verdict.depth, verdict.position, (held,), goes_on=held is not NO_FARTHER)
        return replace(state, depth=verdict.depth, position=verdict.position, retreat=after), verdict

    def _fresh(self, seen: Observation) -> bool:
        return 0.0 <= (seen.sample.now - seen.sample.sensor_at) * 1e3 <= self.limits.stale_after_ms

    def _first_fault(
        self,
        state: SupervisorState,
        seen: Observation,
        request: Request,
        still: float,
        pressed: tuple[float, float] | None,
    ) -> Stop | None:
        """The first reason to end the run, None while there is none. One straight line: this runs in every cycle."""
        limits, sample, force = self.limits, seen.sample, seen.sample.force
        age, peak = sample.now - sample.sensor_at, sample.peak_force
        (x, y, z), (a, b, c), (u, v, w) = state.position, request.direction, request.position
        slip = a * (u - x) + b * (v - y) + c * (w - z) - (request.depth - state.depth)
        # A sum is a number only if all its parts are, and no part is infinite. The places are in the slip.
        of_forces = (
            force + sample.resultant + seen.against + peak + sample.peak_resultant + sample.peak_moment
        )
        of_scalars = age + seen.depth + (sample.tilt or 0.0) + sample.gap + seen.dt
        if not math.isfinite(of_scalars + of_forces + slip):
            return Stop(_not_a_number(seen), "a measurement or command is no number")
        if sample.fault:
            return Stop((sample.fault_cause or Cause.ROBOT_STATE), sample.fault, sample.fault_remedy)
        if abs(force) > limits.force_limit_n or abs(peak) > limits.force_limit_n:
            most = force if abs(force) >= abs(peak) else peak
            size = f"of at least {abs(most):.1f}" if sample.saturated else f"{most:.1f}"
            return Stop(Cause.FORCE, f"contact force {size} N is beyond {limits.force_limit_n:g} N")
        if sample.resultant > limits.resultant_limit_n or sample.peak_resultant > limits.resultant_limit_n:
            resultant = max(sample.resultant, sample.peak_resultant)
            text = f"resultant force {resultant:.1f} N is beyond {limits.resultant_limit_n:g} N"
            return Stop(Cause.RESULTANT_FORCE, text)
        if sample.peak_moment > limits.moment_limit_nm:
            text = f"moment {sample.peak_moment:.2f} N·m is beyond {limits.moment_limit_nm:g} N·m"
            return Stop(Cause.MOMENT, text)
        if (
            seen.against > limits.against_travel_n
            and (wall := beyond_friction(seen.against, force, limits.friction_share))
            > limits.against_travel_n
        ):
            text = (
                f"a force of {seen.against:.1f} N against the travel is {wall:.1f} N more than friction, allowed are "
                f"{limits.against_travel_n:g} N: something stands in the way"
            )
            return Stop(Cause.WALL, text)
        if seen.aside and (stop := self._unsure_aside(seen)):
            return stop
        if sample.saturated:
            return Stop(Cause.SATURATED, "the force sensor is at the end of its range")
        if -force > limits.pull_limit_n:
            text = (
                f"a pull of {-force:.1f} N is beyond {limits.pull_limit_n:g} N: "
                "a surface does not pull, so the sensor or its zero is wrong, or the tool hangs on to something"
            )
            return Stop(Cause.PULL, text)
        age_ms = age * 1e3
        if not 0.0 <= age_ms <= limits.stale_after_ms:  # as `_fresh`
            digits = 0 if age_ms - limits.stale_after_ms >= 1.0 else 2
            text = f"the newest force is {age_ms:.{digits}f} ms old, allowed are {limits.stale_after_ms:g} ms"
            return Stop(Cause.FORCE_TOO_OLD, text)
        if sample.unchanged * 1e3 >= limits.frozen_after_ms:
            text = f"the force sensor repeated the same counts for {sample.unchanged:.1f} s"
            return Stop(Cause.SAME_COUNTS, text)
        if still * 1e3 >= limits.still_after_ms:
            return Stop(Cause.NO_NEW_FRAME, f"no new force for {still * 1e3:.0f} ms")
        if sample.dead_axis:
            return Stop(Cause.DEAD_AXIS, sample.dead_axis)
        # before the checks that use the reported depth
        if sample.tilt is not None and (stop := self._untrue_pose(state, sample, sample.tilt)):
            return stop
        if pressed is not None and (deeper_mm := (seen.depth - pressed[1]) * 1e3) > limits.unanswered_mm:
            text = f"the force stayed at {force:.2f} N while the tool went {deeper_mm:.1f} mm deeper"
            return Stop(Cause.UNANSWERED, text)
        before = state.sensor_sequence
        if before is not None and sample.sensor_sequence < before:
            text = f"the sensor's frame counter went back from {before} to {sample.sensor_sequence}"
            return Stop(Cause.SEQUENCE, text)
        if sample.gap * 1e3 > limits.cycle_deadline_ms:
            text = (
                f"no decision for {sample.gap * 1e3:.0f} ms, allowed are {limits.cycle_deadline_ms:g} ms: "
                "the computer or the controller stood still"
            )
            return Stop(Cause.DEADLINE, text)
        if abs(slip) > _CONSISTENT or abs(math.hypot(a, b, c) - 1.0) > 1e-6:
            text = (
                f"requested depth and position differ by {abs(slip) * 1e3:.3f} mm, "
                "or the direction is no unit vector"
            )
            return Stop(Cause.INCONSISTENT, text)
        return None

    def _unsure_aside(self, seen: Observation) -> Stop | None:
        """Why a force across the approach ends the run, where nothing verified its axes; None while it may be."""
        limits, hidden = self.limits, seen.sample.hidden or 0.0
        if hidden > HIDDEN_N:
            text = f"the moments show {hidden:.1f} N across the approach, the force axes do not: one is dead or wrong"
            return Stop(Cause.DEAD_AXIS, text)
        allowed = limits.force_limit_n if self.presses_aside else limits.against_travel_n
        if (
            seen.aside > allowed
            and (beyond := beyond_friction(seen.aside, seen.sample.force, limits.friction_share)) > allowed
        ):
            text = (
                f"a force of {seen.aside:.1f} N across the approach is {beyond:.1f} N more than friction, allowed are "
                f"{allowed:g} N; no weight has verified its direction"
            )
            return Stop(Cause.WALL, text)
        return None

    def _untrue_pose(self, state: SupervisorState, sample: Sample, tilt: float) -> Stop | None:
        """Why the reported pose cannot be true, or is not where it was ordered to be; None while it may be."""
        limits, position = self.limits, sample.position
        if state.reported is not None:
            at, before = state.reported
            moved = math.dist(before, position)
            if moved > (sample.now - at) * self.speed * _FASTER + _STANDS:
                text = (
                    f"the reported position jumped by {moved * 1e3:.1f} mm in {(sample.now - at) * 1e3:.0f} ms, "
                    f"the robot moves at {self.speed * 1e3:g} mm/s"
                )
                return Stop(Cause.JUMP, text)
        apart = math.dist(position, state.position)
        if apart * 1e3 > limits.following_error_mm:
            text = (
                f"the reported position is {apart * 1e3:.1f} mm from the commanded one, "
                f"allowed are {limits.following_error_mm:g} mm"
            )
            return Stop(Cause.FOLLOWING, text)
        tilt_deg = math.degrees(tilt) if tilt else 0.0
        if tilt_deg > limits.tilt_deg and tilt_deg > limits.tilt_deg + math.degrees(state.lag):
            where = "start" if state.quaternion is None else "ordered orientation"
            text = (
                f"the robot reports a tool turned by {tilt_deg:.1f}° from the {where}, "
                f"allowed are {limits.tilt_deg:g}°"
            )
            return Stop(Cause.TILT, text)
        if not (_inside(limits, position) or _inside_nearly(limits, position)):
            text = f"the robot reports {position} m, outside the box of limits.workspace_…_m"
            return Stop(Cause.OUTSIDE, text)
        return None


def _not_a_number(seen: Observation) -> Cause:
    """Which part of a cycle's numbers is none, given that one is."""
    of_sensor = seen.sample.force + seen.sample.resultant + seen.sample.sensor_at + seen.against
    if not math.isfinite(
        of_sensor + seen.sample.peak_force + seen.sample.peak_resultant + seen.sample.peak_moment
    ):
        return Cause.FORCE_NOT_A_NUMBER
    known = math.isfinite(
        seen.sample.now + seen.depth + (seen.sample.tilt or 0.0) + seen.sample.gap + seen.dt
    )
    return Cause.COMMAND_NOT_A_NUMBER if known else Cause.POSE_NOT_A_NUMBER


_BEYOND_BARRIER = Reason(Cause.BARRIER, "deeper than where the force limit is predicted")


def _inside(limits: Limits, position: Vector) -> bool:
    (a, b, c), (x, y, z), (d, e, f) = limits.workspace_min_m, position, limits.workspace_max_m
    return a <= x <= d and b <= y <= e and c <= z <= f


def _inside_nearly(limits: Limits, position: Vector) -> bool:
    """Inside, or as little outside as a reported position may be wrong."""
    corners = limits.workspace_min_m, position, limits.workspace_max_m
    return all(low - _STANDS <= at <= high + _STANDS for low, at, high in zip(*corners, strict=True))


def _in_millimetres(limits: Limits, position: Vector) -> str:
    """A hint for a box whose corners are told in mm; empty where it is none."""
    x, y, z = position
    corners = limits.workspace_min_m, limits.workspace_max_m
    if not _inside(limits, (x * 1e3, y * 1e3, z * 1e3)):
        return ""
    low, high = ([round(part * 1e-3, 6) for part in corner] for corner in corners)
    return f"its corners are in m; did you mean {low} and {high}?"


def _at_depth(request: Request, depth: float) -> Request:
    """The same request at another depth."""
    (x, y, z), (a, b, c), by = request.position, request.direction, depth - request.depth
    return Request(depth, (x + a * by, y + b * by, z + c * by), request.direction, request.barrier)


def _find_press(before: tuple[float, float] | None, observation: Observation) -> tuple[float, float] | None:
    """Force and depth from which a pressing tool has had no answer; None while it does not press.

    A dead sensor's force changes a little all the same: it is turned by the reported orientation, which jitters.
    """
    if not observation.pressing:
        return None
    sample, depth = observation.sample, observation.depth
    still = sample.unchanged >= observation.dt  # not one count on any axis since the decision before
    if before is None or not (still or abs(before[0] - sample.force) < _SAME_N):
        return sample.force, depth
    # Where a tool that was pulled back in between comes from does not count.
    return (before[0], depth) if depth < before[1] else before


def _clamp(limits: Limits, state: SupervisorState, request: Request, dt: float) -> Allow | Clamp:
    """The request within the limits of motion, `dt` seconds after the one before. Written in single numbers: this runs
    in every cycle, and arrays of three would cost ten times as much.
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
    if math.dist(state.position, target) > longest:  # so that the part across may be longer, too
        (x, y, z), (_, (a, b, c)) = target, _parts(state.position, target, request.direction)
        length = math.hypot(a, b, c)
        if length > longest + _ROUNDING:
            cut = 1 - longest / length
            target = x - a * cut, y - b * cut, z - c * cut
            reasons.append(Reason(Cause.ACROSS, f"across faster than {limits.travel_mm_s:g} mm/s"))

    if not _inside(limits, target):
        (x, y, z), low, high = target, limits.workspace_min_m, limits.workspace_max_m
        u, v, w = state.position
        # A tool that stands a little outside since its start may stay there, and come back.
        low = min(low[0], u), min(low[1], v), min(low[2], w)
        high = max(high[0], u), max(high[1], v), max(high[2], w)
        if not (low[0] <= x <= high[0] and low[1] <= y <= high[1] and low[2] <= z <= high[2]):
            # The part across the approach is cut first: a border beside the way must not hold the depth.
            (along, _), (a, b, c) = _parts(state.position, target, request.direction), request.direction
            target = u + a * along, v + b * along, w + c * along
            share = min(map(_share_inside, state.position, target, low, high))
            # The last allowed position is inside; the border only takes off an error of the arithmetic.
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
    """A way from one place to another: its part along a direction, m, and that across."""
    (u, v, w), (x, y, z), (a, b, c) = before, after, direction
    x, y, z = x - u, y - v, z - w
    along = x * a + y * b + z * c
    return along, (x - a * along, y - b * along, z - c * along)


def _share_inside(before: float, target: float, low: float, high: float) -> float:
    """Share of the way from an allowed place to the target that stays between the borders, on one axis."""
    if low <= target <= high:
        return 1.0
    return ((high if target > before else low) - before) / (target - before)


_ROUNDING = 1e-9
"""Slack for arithmetic, m: a clamped request that comes again must be allowed."""

_CONSISTENT = 1e-5
"""Largest difference between a request's depth and its position, m. Chosen: far above what rounding makes of
metres, far below what a force would show.
"""

_STANDS = 1e-3
"""Largest error of a reported position that still counts as true, m. Chosen: some steps of a coarse robot."""

_FASTER = 1.5
"""Chosen: how many times the path velocity a reported position may move at, for two answers are not evenly spaced."""

_SAME_N = 2e-3
"""A force that differs by less is no answer to a tool that presses. Chosen: some times what the jitter of a reported
orientation makes of 100 N, and less than a count of most sensors.
"""
