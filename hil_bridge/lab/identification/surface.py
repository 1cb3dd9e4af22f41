"""Surface parameters identified from a recording: stiffness, damping, exponent of the depth, and friction.

Encoders on the motors do not measure the deflection of arm, sensor and tool. The stiffness over reported depths is
therefore that of surface, tool, sensor and arm in series: 1/k = 1/k_surface + 1/k_tool + 1/k_sensor + 1/k_arm.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hil_bridge.devices.facts import Pacing, RobotFacts
from hil_bridge.lab.fidelity.contact import fit_law
from hil_bridge.lab.fidelity.measures import LEAST_SAMPLES, Floats, smooth_noise_of
from hil_bridge.lab.fidelity.tables import Table
from hil_bridge.lab.identification.blocks import Ints, Mask, blocks_of, jackknife
from hil_bridge.lab.identification.observations import LEAST_PRESSING, Contact, Observations
from hil_bridge.lab.identification.values import Part, Quantity, Value, Why

_SCALE_SHARE = 0.02
"""Relative error of a sensor's scale, and twice the share of a fast load that the creep of the sensor hides. Chosen."""
_DELAY_S = 0.02
"""Uncertainty of the delay between position and force, s. Chosen."""
_RATE_S = 0.01
"""Half of the window over which a speed is measured, s. Chosen."""
_RATE_OVER = 2
"""Largest number of samples with which a segment yields no speed. Chosen."""
_NOISE_SHARE = 0.5
"""Largest share of the depth's variance that is attributed to noise. Chosen."""
_WINDOW_M = 0.02
"""Window across the surface in which its height is approximated by a parabola, m. Chosen."""
_LEAST_WAY_M = 0.003
"""Lateral distance that friction requires, and above which the exponent of the depth is not identified, m. Chosen."""
_HALF_WINDOW_S = 0.3
"""Half of the window over which the direction of the path is measured, s. Chosen."""
_LEAST_SPEED_M_S = 0.001
"""Speed below which the tool counts as stationary, m/s. Chosen."""
_MOST_STRETCHES = 6
"""Maximum number of contacts for which friction is identified. Chosen: with more contacts, the tool bounces."""
_FULL_SPEED = 0.9
"""Share of the usual speed below which a sample belongs to the start or the end of the path. Chosen."""
_SLOW_S = 0.2
"""Window over which depth and force are averaged, s. Chosen: longer than the period of an arm's first mode, 0.05 to
0.13 s. An arm that oscillates in contact has another stiffness than at rest, and looks like a damper.
"""
_RISE = 3.0
"""Smallest ratio of the largest to the smallest force at which a segment determines the exponent of the depth.
Chosen.
"""

STIFFNESS = Quantity("surface.stiffness", Part.SURFACE, "stiffness of the contact", "N/m")
ALONE = Quantity("surface.alone", Part.SURFACE, "stiffness of the surface alone", "N/m")
DAMPING = Quantity("surface.damping", Part.SURFACE, "damping of the contact", "N·s/m")
EXPONENT = Quantity("surface.exponent", Part.SURFACE, "exponent of the depth in the force", "")
FRICTION = Quantity("surface.friction", Part.SURFACE, "friction coefficient", "")


def surface_values(observations: Observations) -> Iterator[Value]:
    """Yield all values identified for the surface."""
    contact = observations.contact
    if contact is None:
        why = Why.NO_CONTACT if observations.stream is not None or observations.cycles else Why.NO_FORCE
        yield from (quantity.unseen(why) for quantity in (STIFFNESS, ALONE, DAMPING, EXPONENT, FRICTION))
        return
    slopes = _slopes_of(contact, observations.robot)
    stiffness = jackknife(slopes.blocks, slopes.stiffness)
    if not stiffness.half < stiffness.value:
        yield from (quantity.unseen(Why.TOO_OPEN) for quantity in (STIFFNESS, ALONE, DAMPING))
        yield _exponent(contact)
        yield _friction(contact, 0.0)
        return
    yield STIFFNESS.value(
        stiffness.wider(_SCALE_SHARE * abs(stiffness.value), "and 2 % for the sensor's creep and scale"),
        "slope of the force over the reported depth in contact, without level, slope and curvature of the "
        "surface in every 20 mm; surface, tool, sensor and arm in series",
    )
    yield ALONE.unseen(Why.IN_SERIES)
    yield _damping(slopes, stiffness.value)
    yield _exponent(contact)
    yield _friction(contact, stiffness.value)


def _slopes_of(contact: Contact, robot: RobotFacts) -> "_Slopes":
    """Return the regression for a contact.

    A streamed robot is averaged over time, unless its contacts are too short. A polled robot is stationary when it
    reports its position.
    """
    if robot.pacing is Pacing.ASKED and robot.kind:
        return _slopes(contact, (robot.position_step_m or 0.0) / math.sqrt(12.0), moves=False)
    slow = _slow_contact(contact)
    if len(slow.times) < LEAST_PRESSING:
        return _slopes(contact, smooth_noise_of(contact.depth))
    return _slopes(slow, 0.0)


class _Slopes(NamedTuple):
    """Inputs of a regression of force on depth and speed."""

    depth: Floats
    press: Floats
    rate: Floats
    """Depth, m, force, N, and speed into the surface, m/s, each (n,). The part that level and travel explain is
    removed.
    """
    blocks: Ints
    noise_m: float
    """Noise of the depth, m. Its variance is subtracted, because it would bias the stiffness towards lower values."""

    def stiffness(self, mask: Mask) -> float:
        """Return the stiffness over the selected samples, N/m."""
        return float(self._fit(mask)[0])

    def damping(self, mask: Mask) -> float:
        """Return the damping over the selected samples, N·s/m."""
        return float(self._fit(mask)[1])

    def _fit(self, mask: Mask) -> Floats:
        inputs = np.column_stack([self.depth[mask], self.rate[mask]])
        products = inputs.T @ inputs
        products[0, 0] -= min(self.noise_m**2 * int(mask.sum()), _NOISE_SHARE * float(products[0, 0]))
        if not products[1, 1] > 0.0:  # a robot that is stationary when polled has no speed
            return np.array([float(inputs[:, 0] @ self.press[mask]) / float(products[0, 0]), 0.0])
        return np.asarray(np.linalg.solve(products, inputs.T @ self.press[mask]), np.float64)


def _slopes(contact: Contact, noise: float, moves: bool = True) -> _Slopes:
    """Return the inputs of the regression. `noise` is that of the depth, m.

    `moves` is false for a robot that is stationary when it reports its position.
    """
    travel = _lateral_distance(contact)
    windows = contact.stretch * 1e4 + np.floor(travel / _WINDOW_M)
    rate = np.zeros(len(travel))
    for stretch in np.unique(contact.stretch):
        inside = contact.stretch == stretch
        if moves and inside.sum() > _RATE_OVER:
            rate[inside] = _rate_of(contact.times[inside], contact.depth[inside])
    columns = np.column_stack([contact.depth, contact.press, rate])
    rest = np.zeros_like(columns)
    for window in np.unique(windows):
        inside = windows == window
        about = travel[inside] - travel[inside].mean()
        most = 3 if float(np.ptp(about)) > _LEAST_WAY_M else 1
        explained = np.column_stack([about**power for power in range(most)])
        if inside.sum() > most:
            fit = np.linalg.lstsq(explained, columns[inside], rcond=None)[0]
            rest[inside] = columns[inside] - explained @ fit
    depth, force, speed = rest.T.copy()
    return _Slopes(depth, force, speed, blocks_of(depth**2), noise)


def _rate_of(times: Floats, depth: Floats) -> Floats:
    """Return the speed into the surface, m/s, measured over several samples, since noise would dominate over a
    single one.
    """
    step = max(1, round(_RATE_S / max(float(np.median(np.diff(times))), 1e-6)))
    places = np.arange(len(times))
    low, high = np.maximum(places - step, 0), np.minimum(places + step, len(times) - 1)
    rate: Floats = (depth[high] - depth[low]) / (times[high] - times[low])
    return rate


def _lateral_distance(contact: Contact) -> Floats:
    """Return the distance across the surface since the start of the contact, m; 0 if no position is recorded."""
    if not np.isfinite(contact.place).all():
        return np.zeros(len(contact.times))
    steps = np.diff(contact.place, axis=0)
    across = steps - np.outer(steps @ contact.approach, contact.approach)
    span = float(np.median(np.diff(contact.times)))
    every = max(1, round(2.0 * _HALF_WINDOW_S / max(span, 1e-6)))
    # position noise would accumulate over single samples
    knots = np.arange(0, len(contact.times), every)
    path = np.concatenate([np.zeros((1, 3)), np.cumsum(across, axis=0)])
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path[knots], axis=0), axis=1))])
    travel: Floats = np.interp(np.arange(len(contact.times)), knots, lengths)
    return travel


def _slow_contact(contact: Contact) -> Contact:
    """Return the contact with averages of depth and force over `_SLOW_S`, without the start and end of each stretch."""
    times, slow = contact.times, np.column_stack([contact.depth, contact.press])
    count = max(1, round(_SLOW_S / max(float(np.median(np.diff(times))), 1e-6)))
    kept = np.zeros(len(times), bool)
    for stretch in np.unique(contact.stretch):
        inside = contact.stretch == stretch
        slow[inside] = _moving_average(slow[inside], count)
        first, last = times[inside][[0, -1]]
        kept |= inside & (times - first > _SLOW_S / 2.0) & (last - times > _SLOW_S / 2.0)
    return replace(
        contact,
        times=times[kept],
        depth=slow[kept, 0],
        press=slow[kept, 1],
        place=contact.place[kept],
        force=contact.force[kept],
        stretch=contact.stretch[kept],
    )


def _damping(slopes: _Slopes, stiffness: float) -> Value:
    damping = jackknife(slopes.blocks, slopes.damping)
    hidden = _DELAY_S * stiffness
    if not damping.low > hidden:
        return DAMPING.unseen(Why.BEHIND_DELAY)
    return DAMPING.value(
        damping.wider(hidden, "and the stiffness times a delay of 20 ms"),
        "part of the force proportional to the speed into the surface",
    )


def _exponent(contact: Contact) -> Value:
    """Identify the exponent of the depth from the longest segment with rising or falling force and without lateral
    motion.
    """
    travel = _lateral_distance(contact)
    best: Mask | None = None
    for stretch in np.unique(contact.stretch):
        inside = contact.stretch == stretch
        press = contact.press[inside]
        rises: bool = press.max() > _RISE * press.min() and float(np.ptp(travel[inside])) < _LEAST_WAY_M
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
        "n of force = a · depth^n, with a, n and the touch depth fitted where the force rises or falls",
    )


def _friction(contact: Contact, stiffness: float) -> Value:
    """Identify the friction: the ratio of the force against the motion to the normal force."""
    known = np.isfinite(contact.place).all() and np.isfinite(contact.force).all()
    if not known:
        return FRICTION.unseen(Why.NO_TRAVEL)
    if len(np.unique(contact.stretch)) > _MOST_STRETCHES:
        return FRICTION.unseen(Why.BOUNCES)
    direction, speed = _directions(contact, stiffness)
    moving = speed > _LEAST_SPEED_M_S
    if moving.any():  # at the start of the path, the measured speed is still increasing
        moving &= speed > _FULL_SPEED * float(np.median(speed[moving]))
    if not moving.any() or float(np.ptp(_lateral_distance(contact)[moving])) < _LEAST_WAY_M:
        return FRICTION.unseen(Why.NO_TRAVEL)
    approach = contact.approach
    normal = -approach + np.outer(direction @ approach, np.ones(3)) * direction
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-9)[:, None]
    pressed = np.einsum("ij,ij->i", contact.force, normal)[moving]
    against = -np.einsum("ij,ij->i", contact.force, direction)[moving]

    def ratio(mask: Mask) -> float:
        return float(pressed[mask] @ against[mask] / (pressed[mask] @ pressed[mask]))

    friction = jackknife(blocks_of(np.ones(len(pressed))), ratio)
    method = (
        "force against the motion over force along the normal during lateral motion; normal from the path minus "
        "the depth of penetration"
    )
    return FRICTION.value(
        friction.wider(_SCALE_SHARE * abs(friction.value), "and 2 % for the sensor's axes"), method
    )


def _moving_average(rows: Floats, count: int) -> Floats:
    """Return moving averages over `count` rows, or fewer at both ends."""
    sums = np.concatenate([np.zeros((1, rows.shape[1])), np.cumsum(rows, axis=0)])
    places = np.arange(len(rows))
    low = np.maximum(places - count // 2, 0)
    high = np.minimum(places + (count - 1) // 2 + 1, len(rows))
    means: Floats = (sums[high] - sums[low]) / (high - low)[:, None]
    return means


def _directions(contact: Contact, stiffness: float) -> tuple[Floats, Floats]:
    """Return unit vectors along the undeformed surface below the path, (n, 3), and the lateral speed of the tool,
    m/s.
    """
    times, approach = contact.times, contact.approach
    place = contact.place
    if stiffness > 0.0:  # position of the undeformed surface
        place = place - np.outer(contact.press / stiffness, approach)
    span = max(float(np.median(np.diff(times))), 1e-6)
    place = _moving_average(place, max(1, round(_HALF_WINDOW_S / span)))
    low = np.searchsorted(times, times - _HALF_WINDOW_S)
    high = np.searchsorted(times, times + _HALF_WINDOW_S, side="right") - 1
    step = place[high] - place[low]
    length = np.linalg.norm(step, axis=1)
    across = step - np.outer(step @ approach, approach)
    took = np.maximum(times[high] - times[low], 1e-9)
    speed: Floats = np.linalg.norm(across, axis=1) / took
    return step / np.maximum(length, 1e-12)[:, None], speed
