"""Depth against force: whether a pressing tool is deeper than its force explains. Pure.

A sensor whose zero drifts, or is taken by somebody else, tells the wanted force while the tool is pressed deeper and
deeper. A surface that stands does not let it: depth and force of a contact belong together by its stiffness. What the
tool is deeper than at its touch, less the change of the force by the stiffness, is a force that nobody tells.

A tool that travels also follows a surface that slopes. So the depth counts less the way from the touch, and less the
way from a place that it has been at lately: what drifts slowly while the tool repeats for ever is taken for a slope.
"""

import math
from typing import Protocol

from msgspec import Struct

from hil_bridge.control.course.limits import Limits
from hil_bridge.control.sample import Sample
from protocol.geometry import Vector

SETTLES_S = 1.5
"""Chosen: time in contact after which depth and force of the touch count: three of the mean's; the force is held."""
_MEAN_S = 0.5
"""Chosen: time constant of the means. A drift lasts for seconds; noise, vibration and a swing of the loop do not."""
_STEEPEST = 1.0
"""Chosen: depth that a surface may gain on a way across the approach, as a share of it: 45°."""
_SAME_PLACE_M = 0.3e-3
"""Chosen: distance within which a contact that was lost is found again at the same place, m: two steps of a coarse
robot. The mean of the place of a tool that travels stays farther behind.
"""
_ROOM = 0.5
"""Chosen: share of the room below the force limit that an untold force may take. The rest is for the stiffness."""
_PULL = 1.3
"""Chosen: how many times the untold force a false pull may be: estimates of the stiffness are off by a fifth."""


class Level(Struct, frozen=True, gc=False):
    """Means of a time in contact."""

    depth: float
    """Reported depth, m."""
    force: float
    """Contact force along the approach that belongs to it, N."""
    place: Vector
    """Reported position, base frame, m."""


class Contact(Struct, frozen=True, gc=False):
    """A contact as depth and force have shown it."""

    free: float
    """Reported depth at which the tool was last free before it, m."""
    now: Level | None = None
    """The last half second in contact; None before the touch."""
    lasted: float = 0.0
    """Time in contact, s."""
    stiffness: float = 0.0
    """Stiffness of the contact as far as it is known, N/m; 0 before it has settled."""
    touch: Level | None = None
    """Where it had settled; None before."""
    near: Level | None = None
    """The same at a place where the tool has been lately."""

    @property
    def untold(self) -> float:
        """Force that the depth below the touch tells and the sensor does not, N, if the surface lies level."""
        if self.now is None or self.touch is None:
            return 0.0
        return max(_deeper(self.touch, self.now, self.stiffness) * self.stiffness, 0.0)

    @property
    def false_pull(self) -> float:
        """Pull that a sensor may tell when such a tool is unloaded, N."""
        return _PULL * self.untold


class ContactFacts(Protocol):
    """The parts of an observation that the watch needs."""

    @property
    def sample(self) -> Sample: ...
    @property
    def depth(self) -> float: ...
    @property
    def dt(self) -> float: ...
    @property
    def pressing(self) -> bool: ...


def watch_contact(
    before: Contact | None, seen: ContactFacts, stiffness: tuple[float | None, float], limits: Limits
) -> Contact:
    """Return the contact after one more sample. `stiffness` are the one learnt, None if there is none, and the one
    expected, N/m.
    """
    sample, depth, dt, pressing = seen.sample, seen.depth, seen.dt, seen.pressing
    if before is None:
        before = Contact(depth)
    now = before.now
    if not pressing:
        if now is None:
            return before if before.free == depth else Contact(depth)
        # A contact that is lost in its place may be lost by the zero alone.
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
        known = _known(stiffness, before.free, now)
        return Contact(free=before.free, now=now, lasted=lasted, stiffness=known, touch=now, near=now)
    known, near = stiffness[0] or before.stiffness, before.near
    away = _STEEPEST * _across(near.place, place, now.depth - near.depth)
    # the first bound is never the larger one, and quickly made
    if away > limits.pull_limit_n / known and away > _allowed(limits, now.force, known):
        near = now
    return Contact(free=before.free, now=now, lasted=lasted, stiffness=known, touch=before.touch, near=near)


def untold_depth(contact: Contact, limits: Limits) -> float:
    """Depth that neither force nor slope explains, m, where that is more than is allowed; 0 where it is not."""
    now, touch, near = contact.now, contact.touch, contact.near
    if now is None or touch is None or near is None:
        return 0.0
    stiffness = contact.stiffness
    least = limits.pull_limit_n / stiffness
    for level in (touch,) if near is touch else (touch, near):
        deeper = now.depth - level.depth - (now.force - level.force) / stiffness
        # the first bound is never the larger one, and quickly made
        if deeper > least and deeper > (allowed := _allowed(limits, now.force, stiffness)):
            deeper -= _STEEPEST * _across(level.place, now.place, now.depth - level.depth)
            if deeper > allowed:
                return deeper
    return 0.0


def _allowed(limits: Limits, force: float, stiffness: float) -> float:
    """Depth that may stay unexplained, m. A false force below `pull_limit_n` is none that this watch sees."""
    room = _ROOM * (limits.force_limit_n * (1.0 - limits.force_margin_share) - force)
    least, most = limits.pull_limit_n / stiffness, max(room, limits.pull_limit_n) / stiffness
    return min(max(limits.unanswered_mm * 1e-3, least), most)


def _deeper(before: Level, now: Level, stiffness: float) -> float:
    return now.depth - before.depth - (now.force - before.force) / stiffness


def _across(before: Vector, after: Vector, deeper: float) -> float:
    """Distance of two places across the approach, of which one is so much deeper, m."""
    (u, v, w), (x, y, z) = before, after
    x, y, z = x - u, y - v, z - w
    return math.sqrt(max(x * x + y * y + z * z - deeper * deeper, 0.0))


def _known(stiffness: tuple[float | None, float], free: float, now: Level) -> float:
    """Stiffness of a contact that has settled, N/m: learnt, else force by depth, up to that expected."""
    learnt, expected = stiffness
    if learnt:
        return learnt
    pressed = now.depth - free
    return min(now.force / pressed, expected) if pressed > 0.0 and now.force > 0.0 else expected
