"""Supervision of a retraction: whether the force responds, and how far a tool may move while the force is unknown.
Pure.

The sign of the force along the approach distinguishes two dangers. A force that presses comes from the front: the
surface follows the tool, and the direction of the retraction is right. A force in the other direction comes from an
obstacle behind the tool: the tool stops at once.

There is another possible reason why a force from the front does not decrease: the robot does not move as it
reports. So the retraction pauses and observes. If the force rises during the pause, the retraction is not the
cause, and it continues. Otherwise the retraction is tried a second and last time, slowly. Both compare the mean of the
force over a short time, because an arm may oscillate.
"""

import math

from msgspec.structs import replace

from hil_bridge.control.course.depth_watch import Contact
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.verdict import Observation, Retreat, Stage
from hil_bridge.errors.causes import Cause, Reason


def is_known(limits: Limits, before: Retreat | None, observation: Observation) -> bool:
    """Return whether the force of the observation is known, regardless of its age.

    A saturated reading may have any value and either sign. It counts only as a force from the front, and only if a
    force from the front exceeded the limit before.
    """
    if (
        not math.isfinite(
            observation.sample.force + observation.sample.resultant + observation.sample.peak_resultant
        )
        or observation.sample.fault
        or observation.sample.dead_axis
    ):
        return False
    return not observation.sample.saturated or (before is not None and before.front > limits.force_limit_n)


def watch(
    limits: Limits, before: Retreat | None, observation: Observation, contact: Contact | None = None
) -> tuple[Retreat, Reason | None]:
    """Return the state after one cycle with a known force, and the reason why the tool must stop (None if it may
    continue). `contact` is the contact from which the tool retracts.
    """
    before = before or _begin(limits, observation)
    if observation.sample.saturated:
        return replace(before, stage=Stage.TRUSTED), None
    pulls = before.pull > 0.0 or -observation.sample.force > limits.retract_rise_n
    if contact is not None and pulls and observation.sample.force < 0.0 < contact.unreported_n:
        before, observation = _without_false_pull(before, observation, contact)
    after = _advance(limits, before, observation)
    if -observation.sample.force > max(-before.force, 0.0) + limits.pull_limit_n:
        text = (
            f"a force of {-observation.sample.force:.1f} N from behind met the tool while the tool retracted"
        )
        return after, Reason(Cause.BEHIND, text)
    if _from_front(limits, observation):
        return _press(limits, before, after, observation)
    if before.stage is Stage.WAITS:  # no contact any more
        after = _wait(limits, after, observation)
    return after, _blocked_reason(limits, before, after, observation)


def longest_step_back(state: Retreat | None, dt: float) -> float:
    """Return how far the tool may move back in a cycle of `dt` s, m: inf if the retraction is not in a pause or a
    second try.
    """
    match None if state is None else state.stage:
        case Stage.WAITS:
            return 0.0
        case Stage.SLOW:
            return _SLOW_M_S * dt
        case _:
            return BLIND_M_S * dt if state is not None and state.pull else math.inf


def blind_goal(limits: Limits, pressed: tuple[float, float] | None, before: Retreat | None) -> float:
    """Return the depth to which a tool may retract while the force is unknown, m. `pressed` is defined in
    `SupervisorState`.
    """
    if pressed is None or (before is not None and not before.from_contact):
        return 0.0
    return min(0.0, pressed[1] - limits.blind_retract_mm * 1e-3)


def _without_false_pull(
    before: Retreat, observation: Observation, contact: Contact
) -> tuple[Retreat, Observation]:
    """Return the retraction, and the observation without the pull that is due to a false zero.

    If a tool is deeper than its force explains, the sensor reports a pull while the surface still presses the tool.
    This pull grows as the tool is unloaded: no faster than stiffness and distance explain, and only until the tool
    is back at the depth at which it was last free. A pull that comes faster, or later, comes from an obstacle
    behind the tool.
    """
    sample, pull = observation.sample, before.pull
    unloaded = contact.stiffness * max(before.begun - max(observation.depth, contact.free), 0.0)
    if (explained := unloaded * _UNLOADS - before.force) > pull:
        pull = max(pull, min(-sample.force, contact.false_pull, explained))
    if not pull:
        return before, observation
    force = min(sample.force + pull, 0.0)
    lateral = math.sqrt(max(sample.resultant * sample.resultant - sample.force * sample.force, 0.0))
    sample = replace(sample, force=force, resultant=math.hypot(force, lateral))
    return replace(before, pull=pull), replace(observation, sample=sample)


def _begin(limits: Limits, observation: Observation) -> Retreat:
    """Return the state of a retraction at its first sample with a known force."""
    within = max(observation.sample.resultant, observation.sample.peak_resultant) <= limits.force_limit_n
    return Retreat(
        began_at=observation.sample.now,
        from_contact=observation.pressing,
        lowest=observation.sample.resultant,
        depth=observation.depth,
        within=within,
        force=observation.sample.force,
        begun=observation.depth,
        mean=_ahead(observation),
    )


def _advance(limits: Limits, before: Retreat, observation: Observation) -> Retreat:
    """Return the state with the lowest force so far; before the retraction has taken effect, with the newest force."""
    resultant = observation.sample.resultant
    front = max(before.front, observation.sample.force, observation.sample.peak_force)
    mean = before.mean + observation.dt / (_MEAN_S + observation.dt) * (_ahead(observation) - before.mean)
    if before.from_contact and (observation.sample.now - before.began_at) * 1e3 <= limits.retract_grace_ms:
        lowest, depth = max(before.lowest, resultant), observation.depth
    else:
        depth = observation.depth if resultant < before.lowest - _FELL_N else before.depth
        lowest = min(before.lowest, resultant)
    return replace(before, lowest=lowest, depth=depth, front=front, mean=mean)


def _ahead(observation: Observation) -> float:
    """Return the force from the front, N: the force along the approach combined with the force against the travel,
    to which the retraction yields.
    """
    return math.hypot(max(observation.sample.force, 0.0), max(observation.against, observation.aside, 0.0))


def _from_front(limits: Limits, observation: Observation) -> bool:
    """Return whether the force comes from the front, apart from friction and noise."""
    ahead = _ahead(observation)
    return ahead >= _FRONT_SHARE * (observation.sample.resultant - limits.retract_rise_n) and ahead > 0.0


def _blocked_reason(
    limits: Limits, before: Retreat, after: Retreat, observation: Observation
) -> Reason | None:
    """Return the reason why a tool under a force from another direction must stop; None if it may continue."""
    force = observation.sample.resultant
    if before.within and force > limits.force_limit_n:
        return Reason(Cause.RETRACT_OVER, f"the force rose to {force:.1f} N while the tool retracted")
    if force > after.lowest + limits.retract_rise_n:
        text = f"the force rose from {after.lowest:.1f} N to {force:.1f} N while the tool retracted"
        return Reason(Cause.RETRACT_RISE, text)
    over = abs(observation.sample.force) > limits.force_limit_n or force > limits.resultant_limit_n
    if over and _unanswered(limits, before, observation):
        return _stays(force, before, observation)
    return None


def _stays(force: float, before: Retreat, observation: Observation) -> Reason:
    back = (before.depth - observation.depth) * 1e3
    return Reason(
        Cause.RETRACT_STAYS, f"the force stayed at {force:.1f} N while the tool retracted by {back:.1f} mm"
    )


def _unanswered(limits: Limits, before: Retreat, observation: Observation) -> bool:
    """Return whether the tool reports that it has moved back although the force has not decreased."""
    return (before.depth - observation.depth) * 1e3 > limits.unanswered_mm


def _press(
    limits: Limits, before: Retreat, after: Retreat, observation: Observation
) -> tuple[Retreat, Reason | None]:
    """Return the state of a tool that the surface presses, and the reason why it must stop; None if it may continue."""
    force, now = _ahead(observation), observation.sample.now
    match before.stage:
        case Stage.GOES:
            over = force > limits.force_limit_n
            rose = observation.sample.resultant > after.lowest + limits.retract_rise_n or (
                before.within and over
            )
            if not rose and not (over and _unanswered(limits, before, observation)):
                return after, None
            return replace(after, stage=Stage.WAITS, since=now, level=force, dt=observation.dt), None
        case Stage.WAITS:
            return _wait(limits, after, observation), None
        case Stage.SLOW:
            if after.mean > after.level + limits.retract_rise_n:
                text = f"the force rose from {after.level:.1f} N to {after.mean:.1f} N while the tool retracted slowly"
                return after, Reason(Cause.RETRACT_RISE, text)
            beyond = observation.depth < 0.0  # the tool has been at the start before
            if force > limits.force_limit_n and beyond and _unanswered(limits, before, observation):
                return after, _stays(force, before, observation)
            if after.mean < after.level - limits.retract_rise_n:
                return replace(after, stage=Stage.TRUSTED), None
            return after, None
    return after, None


def _wait(limits: Limits, after: Retreat, observation: Observation) -> Retreat:
    """Return the state of a paused retraction, which waits first for the robot to stop, then for the force to
    respond.
    """
    waited, force = observation.sample.now - after.since, after.mean
    if waited <= _RESTS_S + 2.0 * after.dt:
        return replace(after, level=force)
    if force > after.level + limits.retract_rise_n:
        return replace(after, stage=Stage.TRUSTED)
    if force < after.level - limits.retract_rise_n or waited * 1e3 > limits.retract_grace_ms:
        return replace(
            after, stage=Stage.SLOW, level=force, lowest=observation.sample.resultant, depth=observation.depth
        )
    return after


_FELL_N = 0.25
"""Minimum decrease of the force that counts as a response to the retraction, N. Chosen."""

_FRONT_SHARE = 0.8
"""Minimum share of the force along the approach for a force from the front. Derived: a friction of 0.75 leaves this
share.
"""

_MEAN_S = 0.1
"""Time constant of the mean force, s. Chosen: it reduces an oscillation at the first mode of an arm, 8 Hz or more, to a
fifth or less.
"""

_RESTS_S = 0.1
"""Time for a robot to stop and for the sensor to report it, in addition to two cycles, s. Chosen: twice the time
that the slowest stream takes from a decision to the force.
"""

_UNLOADS = 1.3
"""Largest ratio of the actual decrease of the force to the decrease that stiffness and distance explain. Chosen:
estimates are off by up to a fifth.
"""

BLIND_M_S = 2.75e-3
"""Speed while the force is unknown, m/s. Chosen: the speed of an approach, because there may equally be an obstacle
in the path.
"""

_SLOW_M_S = 1e-3
"""Speed of the second try, m/s. Chosen: in the wrong direction, it adds 10 N at 50 kN/m within the 0.2 s until the
sensor reports it.
"""
