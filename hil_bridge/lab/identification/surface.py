"""The surface that a recording has pressed: stiffness, damping, power of the depth, friction."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from hil_bridge.devices.facts import Pacing, RobotFacts
from hil_bridge.lab.fidelity.contact import fit_law
from hil_bridge.lab.fidelity.measures import LEAST_SAMPLES, Floats, smooth_noise_of
from hil_bridge.lab.fidelity.tables import Table
from hil_bridge.lab.identification.blocks import Ints, Mask, blocks_of, jackknife
from hil_bridge.lab.identification.observations import Contact, Observations
from hil_bridge.lab.identification.values import Part, Quantity, Value, Why

_SCALE_SHARE = 0.02
"""Chosen: a sensor tells a quick load about half as much too small by its creep, and its scale is no better known."""
_DELAY_S = 0.02
"""Chosen: time between place and force that a recording leaves open."""
_RATE_S = 0.01
"""Chosen: speed is that over twice this time."""
_RATE_OVER = 2
"""Chosen: samples below which a stretch tells no speed."""
_NOISE_SHARE = 0.5
"""Chosen: at most so much of the depth's variance is taken for noise."""
_DELAYS_S = np.arange(-0.02, 0.0801, 0.002)
"""Chosen: delays of the force behind the place that are tried. The slowest sensor here has 20 ms."""
_WINDOW_M = 0.02
"""Chosen: over so long a way across the surface its height is taken for a parabola."""
_LEAST_WAY_M = 0.003
"""Chosen: a shorter way across the surface tells no friction, and hides no power of the depth."""
_HALF_WINDOW_S = 0.3
"""Chosen: the direction of the way is that over twice this time."""
_LEAST_SPEED_M_S = 0.001
"""Chosen: a slower tool stands."""
_MOST_STRETCHES = 6
"""Chosen: a tool that begins to press more often bounces, and tells no friction."""
_FULL_SPEED = 0.9
"""Chosen: samples at a lower share of the usual speed are at the begin or the end of the way."""
_RISE = 3.0
"""Chosen: a stretch tells the power of the depth where its largest force is so many times the least."""

STIFFNESS = Quantity("surface.stiffness", Part.SURFACE, "stiffness of the contact", "N/m")
DAMPING = Quantity("surface.damping", Part.SURFACE, "damping of the contact", "N·s/m")
EXPONENT = Quantity("surface.exponent", Part.SURFACE, "power of the depth in the force", "")
FRICTION = Quantity("surface.friction", Part.SURFACE, "friction coefficient", "")


def surface_values(seen: Observations) -> Iterator[Value]:
    """All values of the surface."""
    contact = seen.contact
    if contact is None:
        why = Why.NO_CONTACT if seen.stream is not None or seen.cycles else Why.NO_FORCE
        yield from (quantity.unseen(why) for quantity in (STIFFNESS, DAMPING, EXPONENT, FRICTION))
        return
    slopes = _aligned(contact, seen.robot)
    stiffness = jackknife(slopes[0].blocks, lambda mask: _best(slopes, mask).stiffness(mask))
    if not stiffness.half < stiffness.value:
        yield from (quantity.unseen(Why.TOO_OPEN) for quantity in (STIFFNESS, DAMPING))
        yield _exponent(contact)
        yield _friction(contact, 0.0)
        return
    yield STIFFNESS.value(
        stiffness.wider(_SCALE_SHARE * abs(stiffness.value), "and 2 % for the sensor's creep and scale"),
        "slope of the force over the reported depth while the tool presses; the delay between both is fitted, and "
        "level, slope and bend of the surface are taken off every 20 mm",
    )
    yield _damping(contact, _best(slopes, np.ones(len(contact.times), bool)), stiffness.value)
    yield _exponent(contact)
    yield _friction(contact, stiffness.value)


def _aligned(contact: Contact, robot: RobotFacts) -> "Sequence[_Slopes]":
    """Return the regression for each tried delay of the force behind the place. A robot that is asked stands when it
    tells its place: there is no delay to look for.
    """
    if robot.pacing is Pacing.ASKED and robot.kind:
        rounding = (robot.position_step_m or 0.0) / math.sqrt(12.0)
        return [_slopes(contact, contact.press, 0.0, rounding, moves=False)]
    course = CubicSpline(*contact.course)  # straight lines would cut the peaks of a slow sensor
    noise = smooth_noise_of(contact.depth)
    return [_slopes(contact, course(contact.times + delay), float(delay), noise) for delay in _DELAYS_S]


def _best(slopes: "Sequence[_Slopes]", mask: Mask) -> "_Slopes":
    """Return the regression of the delay with the least rest of the samples that count.

    No surface has a damping below 0: a delay that needs one is none.
    """
    possible = [one for one in slopes if one.damping(mask) >= 0.0] or slopes
    return min(possible, key=lambda one: one.rest(mask))


class _Slopes(NamedTuple):
    """Input of a regression of the force on the depth."""

    depth: Floats
    press: Floats
    rate: Floats
    """Depth, m, force, N, and speed into the surface, m/s: each (n,), less what level and way explain."""
    blocks: Ints
    delay: float
    """Of the force behind the place, s."""
    noise_m: float
    """Noise of the depth, m. What it adds to the depth's own motion is taken off, or it would lower the stiffness."""

    def stiffness(self, mask: Mask) -> float:
        """N/m of the samples that count."""
        return float(self._fit(mask)[0])

    def damping(self, mask: Mask) -> float:
        """N·s/m of the samples that count."""
        return float(self._fit(mask)[1])

    def rest(self, mask: Mask) -> float:
        """Sum of the squares that depth and speed do not explain, N²."""
        rest = self.press[mask] - self._inputs(mask) @ self._fit(mask)
        return float(rest @ rest)

    def _inputs(self, mask: Mask) -> Floats:
        return np.column_stack([self.depth[mask], self.rate[mask]])

    def _fit(self, mask: Mask) -> Floats:
        inputs = self._inputs(mask)
        products = inputs.T @ inputs
        products[0, 0] -= min(self.noise_m**2 * int(mask.sum()), _NOISE_SHARE * float(products[0, 0]))
        if not products[1, 1] > 0.0:  # a robot that stands when it is asked has no speed
            return np.array([float(inputs[:, 0] @ self.press[mask]) / float(products[0, 0]), 0.0])
        return np.asarray(np.linalg.solve(products, inputs.T @ self.press[mask]), np.float64)


def _slopes(contact: Contact, press: Floats, delay: float, noise: float, moves: bool = True) -> _Slopes:
    """Fit the regression with forces that come later than the place by a delay, s.

    A robot `moves`, or stands when it tells its place.
    """
    way = _way_of(contact)
    windows = contact.stretch * 1e4 + np.floor(way / _WINDOW_M)
    rate = np.zeros(len(way))
    for stretch in np.unique(contact.stretch):
        inside = contact.stretch == stretch
        if moves and inside.sum() > _RATE_OVER:
            rate[inside] = _rate_of(contact.times[inside], contact.depth[inside])
    columns = np.column_stack([contact.depth, press, rate])
    rest = np.zeros_like(columns)
    for window in np.unique(windows):
        inside = windows == window
        about = way[inside] - way[inside].mean()
        most = 3 if float(np.ptp(about)) > _LEAST_WAY_M else 1
        explained = np.column_stack([about**power for power in range(most)])
        if inside.sum() > most:
            fit = np.linalg.lstsq(explained, columns[inside], rcond=None)[0]
            rest[inside] = columns[inside] - explained @ fit
    depth, force, speed = rest.T.copy()
    return _Slopes(depth, force, speed, blocks_of(depth**2), delay, noise)


def _rate_of(times: Floats, depth: Floats) -> Floats:
    """Speed into the surface, m/s, over some samples: over one the noise of the place would be most of it."""
    step = max(1, round(_RATE_S / max(float(np.median(np.diff(times))), 1e-6)))
    places = np.arange(len(times))
    low, high = np.maximum(places - step, 0), np.minimum(places + step, len(times) - 1)
    rate: Floats = (depth[high] - depth[low]) / (times[high] - times[low])
    return rate


def _way_of(contact: Contact) -> Floats:
    """Way across the surface since the begin, m; 0 where no place is told."""
    if not np.isfinite(contact.place).all():
        return np.zeros(len(contact.times))
    steps = np.diff(contact.place, axis=0)
    across = steps - np.outer(steps @ contact.approach, contact.approach)
    span = float(np.median(np.diff(contact.times)))
    every = max(1, round(2.0 * _HALF_WINDOW_S / max(span, 1e-6)))
    # noise of the place would add up over single samples
    knots = np.arange(0, len(contact.times), every)
    path = np.concatenate([np.zeros((1, 3)), np.cumsum(across, axis=0)])
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path[knots], axis=0), axis=1))])
    way: Floats = np.interp(np.arange(len(contact.times)), knots, lengths)
    return way


def _damping(contact: Contact, slopes: _Slopes, stiffness: float) -> Value:
    damping = jackknife(slopes.blocks, slopes.damping)
    hidden = _DELAY_S * stiffness
    if not damping.low > hidden:
        return DAMPING.unseen(Why.BEHIND_DELAY)
    return DAMPING.value(
        damping.wider(hidden, "and 20 ms of delay times the stiffness"),
        "part of the force that goes with the speed into the surface",
    )


def _exponent(contact: Contact) -> Value:
    """From the longest stretch that rises, or falls, and does not move across."""
    way = _way_of(contact)
    best: Mask | None = None
    for stretch in np.unique(contact.stretch):
        inside = contact.stretch == stretch
        press = contact.press[inside]
        rises: bool = press.max() > _RISE * press.min() and float(np.ptp(way[inside])) < _LEAST_WAY_M
        if rises and inside.sum() >= LEAST_SAMPLES // 2 and (best is None or inside.sum() > best.sum()):
            best = inside
    if best is None:
        return EXPONENT.unseen(Why.NO_RAMP)
    depth, press, times = contact.depth[best], contact.press[best], contact.times[best]

    def power(mask: Mask) -> float:
        return fit_law(Table(times[mask] - times[mask][0], {"depth": depth[mask], "press": press[mask]}))[0]

    exponent = jackknife(blocks_of(np.abs(np.gradient(depth))), power)
    if not math.isfinite(exponent.low + exponent.high):
        return EXPONENT.unseen(Why.NO_RAMP)
    return EXPONENT.value(
        exponent,
        "n of force = a · depth^n, with a, n and the place of the touch fitted where the force rises or falls",
    )


def _friction(contact: Contact, stiffness: float) -> Value:
    """Force against the way over the force along the normal."""
    known = np.isfinite(contact.place).all() and np.isfinite(contact.force).all()
    if not known:
        return FRICTION.unseen(Why.NO_TRAVEL)
    if len(np.unique(contact.stretch)) > _MOST_STRETCHES:
        return FRICTION.unseen(Why.BOUNCES)
    way, speed = _directions(contact, stiffness)
    moving = speed > _LEAST_SPEED_M_S
    if moving.any():  # where the way begins, the speed that tells it is still rising
        moving &= speed > _FULL_SPEED * float(np.median(speed[moving]))
    if not moving.any() or float(np.ptp(_way_of(contact)[moving])) < _LEAST_WAY_M:
        return FRICTION.unseen(Why.NO_TRAVEL)
    approach = contact.approach
    normal = -approach + np.outer(way @ approach, np.ones(3)) * way
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-9)[:, None]
    pressed = np.einsum("ij,ij->i", contact.force, normal)[moving]
    against = -np.einsum("ij,ij->i", contact.force, way)[moving]

    def ratio(mask: Mask) -> float:
        return float(pressed[mask] @ against[mask] / (pressed[mask] @ pressed[mask]))

    friction = jackknife(blocks_of(np.ones(len(pressed))), ratio)
    method = (
        "force against the way over force along the normal while the tool moves across; the path, less the depth that "
        "is pressed in, tells the normal"
    )
    return FRICTION.value(
        friction.wider(_SCALE_SHARE * abs(friction.value), "and 2 % for the sensor's axes"), method
    )


def _averaged(rows: Floats, count: int) -> Floats:
    """Means of so many rows about each, of fewer at both ends."""
    sums = np.concatenate([np.zeros((1, rows.shape[1])), np.cumsum(rows, axis=0)])
    places = np.arange(len(rows))
    low = np.maximum(places - count // 2, 0)
    high = np.minimum(places + (count - 1) // 2 + 1, len(rows))
    means: Floats = (sums[high] - sums[low]) / (high - low)[:, None]
    return means


def _directions(contact: Contact, stiffness: float) -> tuple[Floats, Floats]:
    """Return unit vectors along the surface below the path, (n, 3), and the speed of the tool across it, m/s."""
    times, approach = contact.times, contact.approach
    place = contact.place
    if stiffness > 0.0:  # the surface is where the tool would be if it did not press it in
        place = place - np.outer(contact.press / stiffness, approach)
    span = max(float(np.median(np.diff(times))), 1e-6)
    place = _averaged(place, max(1, round(_HALF_WINDOW_S / span)))
    low = np.searchsorted(times, times - _HALF_WINDOW_S)
    high = np.searchsorted(times, times + _HALF_WINDOW_S, side="right") - 1
    step = place[high] - place[low]
    length = np.linalg.norm(step, axis=1)
    across = step - np.outer(step @ approach, approach)
    took = np.maximum(times[high] - times[low], 1e-9)
    speed: Floats = np.linalg.norm(across, axis=1) / took
    return step / np.maximum(length, 1e-12)[:, None], speed
