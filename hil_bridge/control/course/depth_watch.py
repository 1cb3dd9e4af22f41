"""Check of depth against force: whether a pressing tool is deeper than its force explains. Pure.

If a sensor's zero drifts, or another program resets it, the sensor reports the desired force while the tool is
pressed deeper and deeper. A stationary surface contradicts this: its stiffness relates the depth of a contact to
the force. The depth gained since the touch, less the change of the force divided by the stiffness, indicates an
unreported force.

A travelling tool also follows a sloping surface. So the allowed depth grows with the distance from the touch, and
with the distance from a recently visited position. A slow drift while the tool repeats a path endlessly is
therefore interpreted as a slope.
"""

import math
from typing import Protocol

from msgspec import Struct

from hil_bridge.control.course.limits import Limits
from hil_bridge.control.sample import Sample
from protocol.geometry import Vector

SETTLES_S = 1.5
"""Time in contact after which the touch is recorded as the reference for depth and force, s. Chosen: three time
constants of the mean. The force is steady by then.
"""
_MEAN_S = 0.5
"""Time constant of the means, s. Chosen: shorter than a drift, which lasts for seconds; longer than noise,
vibration and an oscillation of the loop.
"""
_STEEPEST = 1.0
"""Largest depth that a surface may gain along a path across the approach, as a share of the path's length. Chosen:
45°.
"""
_SAME_PLACE_M = 0.3e-3
"""Distance within which a lost contact counts as regained at the same position, m. Chosen: two steps of a coarse
robot. The mean position of a travelling tool lags by more than that.
"""
_ROOM = 0.5
"""Share of the margin below the force limit that an unreported force may use. Chosen. The rest covers errors of the
stiffness.
"""
_PULL = 1.3
"""Largest ratio of a false pull to the unreported force. Chosen: estimates of the stiffness are off by up to a
fifth.
"""


class Level(Struct, frozen=True, gc=False):
    """Mean depth, force and position over a time in contact."""

    depth: float
    """Mean reported depth, m."""
    force: float
    """Mean contact force along the approach, N."""
    place: Vector
    """Mean reported position, base frame, m."""


class Contact(Struct, frozen=True, gc=False):
    """State of a contact, derived from depth and force."""

    free: float
    """Reported depth at which the tool was last free before this contact, m."""
    now: Level | None = None
    """Means over the last half second in contact; None before the touch."""
    lasted: float = 0.0
    """Time in contact, s."""
    stiffness: float = 0.0
    """Estimated stiffness of the contact, N/m; 0 before the contact has settled."""
    touch: Level | None = None
    """Means of the contact at the time when it settled; None before."""
    near: Level | None = None
    """Means of the contact at a position that the tool has recently visited."""

    @property
    def unreported_n(self) -> float:
        """Force that the depth below the touch implies but the sensor does not report, N, assuming a level surface."""
        if self.now is None or self.touch is None:
            return 0.0
        return max(_deeper(self.touch, self.now, self.stiffness) * self.stiffness, 0.0)

    @property
    def false_pull(self) -> float:
        """Pull that the sensor may falsely report when the tool is unloaded, N."""
        return _PULL * self.unreported_n


class ContactFacts(Protocol):
    """Parts of an observation that the depth check needs."""

    @property
    def sample(self) -> Sample: ...
    @property
    def depth(self) -> float: ...
    @property
    def dt(self) -> float: ...
    @property
    def pressing(self) -> bool: ...


def watch_contact(
    before: Contact | None, facts: ContactFacts, stiffness: tuple[float | None, float], limits: Limits
) -> Contact:
    """Return the contact after one more sample. `stiffness` holds the learnt value (None if unknown) and the
    expected value, N/m.
    """
    sample, depth, dt, pressing = facts.sample, facts.depth, facts.dt, facts.pressing
    if before is None:
        before = Contact(depth)
    now = before.now
    if not pressing:
        if now is None:
            return before if before.free == depth else Contact(depth)
        # A contact that is lost without motion may only be lost because of the zero.
        lifted = (
            depth <= before.free or _across(now.place, sample.position, now.depth - depth) > _SAME_PLACE_M
        )
        return Contact(depth) if lifted else before
    force = sample.force if sample.paired_force is None else sample.paired_force
    (x, y, z) = position = sample.position
    if now is None:
        return Contact(before.free, Level(depth, force, position))
    share = dt / (_MEAN_S + dt)
    u, v, w = now.place
    place = u + share * (x - u), v + share * (y - v), w + share * (z - w)
    now = Level(now.depth + share * (depth - now.depth), now.force + share * (force - now.force), place)
    lasted = before.lasted + dt
    if lasted < SETTLES_S:
        return Contact(before.free, now, lasted)
    if before.touch is None or before.near is None:
        known = _contact_stiffness(stiffness, before.free, now)
        return Contact(free=before.free, now=now, lasted=lasted, stiffness=known, touch=now, near=now)
    known, near = stiffness[0] or before.stiffness, before.near
    away = _STEEPEST * _across(near.place, place, now.depth - near.depth)
    # the first bound is never the larger one, and is fast to compute
    if away > limits.pull_limit_n / known and away > _allowed(limits, now.force, known):
        near = now
    return Contact(free=before.free, now=now, lasted=lasted, stiffness=known, touch=before.touch, near=near)


def unexplained_depth(contact: Contact, limits: Limits) -> float:
    """Return the depth that neither force nor slope explains, m, if it is larger than allowed; otherwise 0."""
    now, touch, near = contact.now, contact.touch, contact.near
    if now is None or touch is None or near is None:
        return 0.0
    stiffness = contact.stiffness
    least = limits.pull_limit_n / stiffness
    for level in (touch,) if near is touch else (touch, near):
        deeper = now.depth - level.depth - (now.force - level.force) / stiffness
        # the first bound is never the larger one, and is fast to compute
        if deeper > least and deeper > (allowed := _allowed(limits, now.force, stiffness)):
            deeper -= _STEEPEST * _across(level.place, now.place, now.depth - level.depth)
            if deeper > allowed:
                return deeper
    return 0.0


def _allowed(limits: Limits, force: float, stiffness: float) -> float:
    """Return the depth that may stay unexplained, m. A false force below `pull_limit_n` is not detected here."""
    room = _ROOM * (limits.force_limit_n * (1.0 - limits.force_margin_share) - force)
    least, most = limits.pull_limit_n / stiffness, max(room, limits.pull_limit_n) / stiffness
    return min(max(limits.unanswered_mm * 1e-3, least), most)


def _deeper(before: Level, now: Level, stiffness: float) -> float:
    return now.depth - before.depth - (now.force - before.force) / stiffness


def _across(before: Vector, after: Vector, deeper: float) -> float:
    """Return the distance between two points across the approach, m. One point is deeper than the other by the
    given depth.
    """
    (u, v, w), (x, y, z) = before, after
    x, y, z = x - u, y - v, z - w
    return math.sqrt(max(x * x + y * y + z * z - deeper * deeper, 0.0))


def _contact_stiffness(stiffness: tuple[float | None, float], free: float, now: Level) -> float:
    """Return the stiffness of a settled contact, N/m: the learnt value, or force divided by depth up to the
    expected value.
    """
    learnt, expected = stiffness
    if learnt:
        return learnt
    pressed = now.depth - free
    return min(now.force / pressed, expected) if pressed > 0.0 and now.force > 0.0 else expected
