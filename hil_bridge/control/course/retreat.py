"""Watch over a retraction: whether the force answers it, and where a tool may go without a force to go by. Pure.

The sign of the force along the approach tells the two dangers apart. A force that presses comes from the front: the
surface follows the tool, and the way back is right. A force the other way comes from behind, where something stands in
the way: the tool stands still at once.

A force from the front that does not come down may also have another reason: the robot does not go where it says. So the
retraction waits, and looks. A force that rises meanwhile is not of its making, and it continues. One that does not is
tried a second time, slowly, and for the last time.
"""

import math

from msgspec.structs import replace

from hil_bridge.control.course.depth_watch import Contact
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.verdict import Observation, Retreat, Stage
from hil_bridge.errors.causes import Cause, Reason


def is_known(limits: Limits, before: Retreat | None, seen: Observation) -> bool:
    """Whether the observation tells the force, apart from its age.

    A saturated reading may have any value and either sign. It counts as a force from the front, and no more, where one
    passed the limit there before.
    """
    if (
        not math.isfinite(seen.sample.force + seen.sample.resultant + seen.sample.peak_resultant)
        or seen.sample.fault
        or seen.sample.dead_axis
    ):
        return False
    return not seen.sample.saturated or (before is not None and before.front > limits.force_limit_n)


def watch(
    limits: Limits, before: Retreat | None, seen: Observation, contact: Contact | None = None
) -> tuple[Retreat, Reason | None]:
    """State after one cycle whose force is known, and why the tool must stand still; None while it need not. `contact`
    is the one from which the tool retracts.
    """
    before = before or _begin(limits, seen)
    if seen.sample.saturated:
        return replace(before, stage=Stage.TRUSTED), None
    pulls = before.pull > 0.0 or -seen.sample.force > limits.retract_rise_n
    if contact is not None and pulls and seen.sample.force < 0.0 < contact.untold:
        before, seen = _without_false_pull(before, seen, contact)
    after = _advance(limits, before, seen)
    if -seen.sample.force > max(-before.force, 0.0) + limits.pull_limit_n:
        text = f"a force of {-seen.sample.force:.1f} N from behind met the tool while the tool retracted"
        return after, Reason(Cause.BEHIND, text)
    if _from_front(limits, seen):
        return _press(limits, before, after, seen)
    if before.stage is Stage.WAITS:  # what pressed is gone
        after = _wait(limits, after, seen)
    return after, _no_way_back(limits, before, after, seen)


def longest_way(state: Retreat | None, dt: float) -> float:
    """How far the tool may go back in a cycle of `dt` s, m: inf where the retraction does not wait or try again."""
    match None if state is None else state.stage:
        case Stage.WAITS:
            return 0.0
        case Stage.SLOW:
            return _SLOW_M_S * dt
        case _:
            return BLIND_M_S * dt if state is not None and state.pull else math.inf


def blind_goal(limits: Limits, pressed: tuple[float, float] | None, before: Retreat | None) -> float:
    """Depth to which a tool may go back without a force to go by, m. `pressed` is as in `SupervisorState`."""
    if pressed is None or (before is not None and not before.from_contact):
        return 0.0
    return min(0.0, pressed[1] - limits.blind_retract_mm * 1e-3)


def _without_false_pull(before: Retreat, seen: Observation, contact: Contact) -> tuple[Retreat, Observation]:
    """Return the retraction, and the cycle without the pull that only a false zero reports.

    A tool that is deeper than its force explains reads a pull while the surface still presses it. That pull comes as
    the tool is unloaded, no faster than stiffness and way explain, and until it is where it was last free. What comes
    faster, or later, is something behind the tool.
    """
    sample, pull = seen.sample, before.pull
    unloaded = contact.stiffness * max(before.begun - max(seen.depth, contact.free), 0.0)
    if (explained := unloaded * _UNLOADS - before.force) > pull:
        pull = max(pull, min(-sample.force, contact.false_pull, explained))
    if not pull:
        return before, seen
    force = min(sample.force + pull, 0.0)
    lateral = math.sqrt(max(sample.resultant * sample.resultant - sample.force * sample.force, 0.0))
    sample = replace(sample, force=force, resultant=math.hypot(force, lateral))
    return replace(before, pull=pull), replace(seen, sample=sample)


def _begin(limits: Limits, seen: Observation) -> Retreat:
    """State of a retraction at its first known force."""
    within = max(seen.sample.resultant, seen.sample.peak_resultant) <= limits.force_limit_n
    return Retreat(
        began_at=seen.sample.now,
        from_contact=seen.pressing,
        lowest=seen.sample.resultant,
        depth=seen.depth,
        within=within,
        force=seen.sample.force,
        begun=seen.depth,
    )


def _advance(limits: Limits, before: Retreat, seen: Observation) -> Retreat:
    """Track the lowest force so far; before the retraction has taken effect, the newest."""
    resultant = seen.sample.resultant
    front = max(before.front, seen.sample.force, seen.sample.peak_force)
    if before.from_contact and (seen.sample.now - before.began_at) * 1e3 <= limits.retract_grace_ms:
        return replace(before, lowest=max(before.lowest, resultant), depth=seen.depth, front=front)
    depth = seen.depth if resultant < before.lowest - _FELL_N else before.depth
    return replace(before, lowest=min(before.lowest, resultant), depth=depth, front=front)


def _ahead(seen: Observation) -> float:
    """Force from where the tool was going: along the approach, and against the travel, from which it yields, N."""
    return math.hypot(max(seen.sample.force, 0.0), max(seen.against, seen.aside, 0.0))


def _from_front(limits: Limits, seen: Observation) -> bool:
    """Whether the force comes from there, but for friction and noise."""
    ahead = _ahead(seen)
    return ahead >= _FRONT_SHARE * (seen.sample.resultant - limits.retract_rise_n) and ahead > 0.0


def _no_way_back(limits: Limits, before: Retreat, after: Retreat, seen: Observation) -> Reason | None:
    """Why a tool that is pressed from elsewhere must stand still; None while it need not."""
    force = seen.sample.resultant
    if before.within and force > limits.force_limit_n:
        return Reason(Cause.RETRACT_OVER, f"the force rose to {force:.1f} N while the tool retracted")
    if force > after.lowest + limits.retract_rise_n:
        text = f"the force rose from {after.lowest:.1f} N to {force:.1f} N while the tool retracted"
        return Reason(Cause.RETRACT_RISE, text)
    over = abs(seen.sample.force) > limits.force_limit_n or force > limits.resultant_limit_n
    if over and _unanswered(limits, before, seen):
        return _stays(force, before, seen)
    return None


def _stays(force: float, before: Retreat, seen: Observation) -> Reason:
    back = (before.depth - seen.depth) * 1e3
    return Reason(
        Cause.RETRACT_STAYS, f"the force stayed at {force:.1f} N while the tool retracted by {back:.1f} mm"
    )


def _unanswered(limits: Limits, before: Retreat, seen: Observation) -> bool:
    """Whether the tool says to have gone back without the force coming down."""
    return (before.depth - seen.depth) * 1e3 > limits.unanswered_mm


def _press(
    limits: Limits, before: Retreat, after: Retreat, seen: Observation
) -> tuple[Retreat, Reason | None]:
    """State of a tool that the surface presses, and why it must stand still."""
    force, now = _ahead(seen), seen.sample.now
    match before.stage:
        case Stage.GOES:
            over = force > limits.force_limit_n
            rose = seen.sample.resultant > after.lowest + limits.retract_rise_n or (before.within and over)
            if not rose and not (over and _unanswered(limits, before, seen)):
                return after, None
            return replace(after, stage=Stage.WAITS, since=now, level=force, dt=seen.dt), None
        case Stage.WAITS:
            return _wait(limits, after, seen), None
        case Stage.SLOW:
            if force > after.level + limits.retract_rise_n:
                text = f"the force rose from {after.level:.1f} N to {force:.1f} N while the tool retracted slowly"
                return after, Reason(Cause.RETRACT_RISE, text)
            beyond = seen.depth < 0.0  # up to the depth of the start the tool has been
            if force > limits.force_limit_n and beyond and _unanswered(limits, before, seen):
                return after, _stays(force, before, seen)
            if force < after.level - limits.retract_rise_n:
                return replace(after, stage=Stage.TRUSTED), None
            return after, None
    return after, None


def _wait(limits: Limits, after: Retreat, seen: Observation) -> Retreat:
    """State of a retraction that waits: first for the robot to come to rest, then for what the force does."""
    waited, force = seen.sample.now - after.since, _ahead(seen)
    if waited <= _RESTS_S + 2.0 * after.dt:
        return replace(after, level=force)
    if force > after.level + limits.retract_rise_n:
        return replace(after, stage=Stage.TRUSTED)
    if force < after.level - limits.retract_rise_n or waited * 1e3 > limits.retract_grace_ms:
        return replace(after, stage=Stage.SLOW, level=force, lowest=seen.sample.resultant, depth=seen.depth)
    return after


_FELL_N = 0.25
"""Chosen: a force that came down by this much has answered the retraction."""

_FRONT_SHARE = 0.8
"""Share of the force along the approach from which it comes from the front. Derived: friction of 0.75 leaves it."""

_RESTS_S = 0.1
"""Time in which a robot comes to rest and the sensor tells so, s, beside two cycles. Chosen: twice what the slowest
stream takes from a decision to the force.
"""

_UNLOADS = 1.3
"""Chosen: how many times the force may fall that stiffness and way explain. Estimates are off by a fifth."""

BLIND_M_S = 2.75e-3
"""Speed without a force to go by, m/s. Chosen: that of an approach, for something may be in the way as there."""

_SLOW_M_S = 1e-3
"""Speed of the second try, m/s. Chosen: where it is wrong, 10 N more on 50 kN/m in the 0.2 s until it is seen."""
