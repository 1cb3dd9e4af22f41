"""Robot parameters identified from a recording: turnaround time, cycle time, lag behind the orders, and noise and
resolution of the reported positions.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from hil_bridge.devices.facts import Owner, Pacing, ServoFacts
from hil_bridge.lab.fidelity.measures import PARTS, Floats, grid_of, shift_of, smooth_noise_of
from hil_bridge.lab.fidelity.tables import Table
from hil_bridge.lab.fidelity.units import FAMILIES
from hil_bridge.lab.identification.blocks import (
    LEAST_BLOCKS,
    Estimate,
    Ints,
    deviation_of,
    jackknife,
    mean_of,
)
from hil_bridge.lab.identification.gaps import gap_values, step_value
from hil_bridge.lab.identification.observations import Observations
from hil_bridge.lab.identification.steps import servo_of_steps
from hil_bridge.lab.identification.values import Part, Quantity, Value, Why
from hil_bridge.record.analysis.latency import timestamps

_PAUSE_CYCLES = 50.0
"""Longest gap within which the number of missing packets is known, in cycles. Chosen."""
_LEAST_CYCLES = 20
"""Smallest number of cycles from which a time is identified. Chosen."""
_PARTS = 8
"""Number of parts of a recording that have separate lags. Chosen."""
_ABOVE_ORDERS = 2.0
"""Smallest ratio of position noise to order noise at which the position noise is identified. Chosen: below it, the
noise may come from the orders, which the robot follows.
"""
_NEAR = 0.05
"""Tolerance within which a difference counts as a multiple of the step, in steps. Chosen."""
_NEARLY_ALL = 0.98
"""Share of the differences that must be multiples of a step. Chosen."""
_ONE_SPEED = 0.9
"""Share of differences with one common multiple above which they indicate a constant speed, not a step. Chosen."""
_DECIMALS_M = tuple(10.0**-places for places in range(3, 10))
"""Decimal resolutions to try, m."""
_FLOATS = 1e-14
"""Relative step of a position below which the step is the rounding of 64-bit numbers. Derived."""

CYCLE = Quantity("robot.cycle", Part.ROBOT, "time of a cycle", "s")
JITTER = Quantity("robot.jitter", Part.ROBOT, "deviation of the cycle time", "s")
MOVE_TURNAROUND = Quantity("robot.turnaround.move", Part.ROBOT, "turnaround of moves", "s")
MOVE_SPREAD = Quantity("robot.turnaround.spread", Part.ROBOT, "deviation of the turnaround", "s")
STATUS_TURNAROUND = Quantity("robot.turnaround.status", Part.ROBOT, "turnaround of status orders", "s")
LAG = Quantity("robot.lag", Part.ROBOT, "lag of the position behind the orders", "s")
SERVO = Quantity("robot.servo", Part.ROBOT, "delay and response of the servo", "s")
NOISE = tuple(Quantity(f"robot.noise.{axis}", Part.ROBOT, f"noise of {axis}", "m") for axis in "xyz")
NOISE_RATIO = Quantity("robot.noise.ratio", Part.ROBOT, "noise, relative to the emulated robot", "")
STEP = Quantity("robot.step", Part.ROBOT, "step of the position", "m")
_HOPS = {"turnaround": MOVE_TURNAROUND, "status_turnaround": STATUS_TURNAROUND}


def motion_values(
    observations: Observations, usual: ServoFacts | None, twin: Callable[[Table], Table | None]
) -> Iterator[Value]:
    """Yield all values identified for the robot.

    `usual` is the servo of the emulated robot. `twin` returns the table that the emulated robot reports when it
    replays orders, or None if it cannot replay them.
    """
    yield from _cycles(observations)
    yield from _turnarounds(observations)
    emulated: Table | None = None
    if observations.robot.pacing is Pacing.ASKED and observations.cycles:
        yield LAG.unseen(Why.STANDS)
        yield _servo_of_steps(observations, usual)
    else:
        emulated = (
            None
            if observations.orders is None or _orders_of(observations.orders) is None
            else twin(observations.orders)
        )
        yield from _lags(observations.orders, usual, emulated)
    yield from _position_values(observations, emulated)


def _servo_of_steps(observations: Observations, usual: ServoFacts | None) -> Value:
    estimate = None if usual is None else servo_of_steps(observations, usual)
    if estimate is None:
        return SERVO.unseen(Why.NO_STEPS)
    if not estimate.half < estimate.value:
        return SERVO.unseen(Why.TOO_OPEN)
    return SERVO.value(
        estimate,
        "shift and smoothing of the ordered depth that best explain the force, from the robot's answer on",
    )


# --- times


def _cycles(observations: Observations) -> Iterator[Value]:
    if observations.cycles and observations.robot.pacing is Pacing.ASKED:
        times = np.array([cycle.started_at for cycle in observations.cycles])
        method = "mean time between the starts of control cycles"
    elif observations.motion is not None:
        times, method = observations.motion.times, "mean time between the robot's packets, without lost ones"
    else:
        times, method = np.empty(0), ""
    gaps = np.diff(times)
    if nominal := observations.robot.cycle_s:  # a control cycle may span several packets
        packets = np.maximum(np.round(gaps / nominal), 1.0)
        gaps = (gaps / packets)[gaps < _PAUSE_CYCLES * nominal]
    yield from gap_values(gaps, _LEAST_CYCLES, (CYCLE, JITTER), method)


def _turnarounds(observations: Observations) -> Iterator[Value]:
    hops = observations.robot.hops
    known = () if hops is None else (*hops.beside, *hops.to_answer)
    robot_hops = {hop.name: hop for hop in known if hop.owner is Owner.ROBOT}
    if hops is None or not robot_hops:
        why = Why.DRIVES if observations.robot.pacing is Pacing.STREAMED else Why.NO_STAMPS
        why = why if observations.cycles else Why.OF_TABLE
        yield from (quantity.unseen(why) for quantity in (MOVE_TURNAROUND, MOVE_SPREAD, STATUS_TURNAROUND))
        return
    moment = timestamps(observations.cycles, hops)
    for name, quantity in _HOPS.items():
        hop = robot_hops.get(name)
        took = np.empty(0) if hop is None else moment(hop.end) - moment(hop.begin)
        took = took[np.isfinite(took)]
        quantities = (MOVE_TURNAROUND, MOVE_SPREAD) if quantity is MOVE_TURNAROUND else (quantity,)
        if len(took) < _LEAST_CYCLES:
            yield from (one.unseen(Why.NO_STAMPS) for one in quantities)
            continue
        yield quantity.value(
            mean_of(took), "from the last character of an order to the first of its answer, mean"
        )
        if quantity is MOVE_TURNAROUND:
            yield MOVE_SPREAD.value(deviation_of(took), "standard deviation of the turnaround")


# --- lag


def _lags(motion: Table | None, servo: ServoFacts | None, emulated: Table | None) -> Iterator[Value]:
    orders = None if motion is None else _orders_of(motion)
    if motion is None or orders is None:
        why = Why.NO_MOTION if motion is None else Why.NO_ORDERS
        yield LAG.unseen(why)
        yield SERVO.unseen(why)
        return
    lags = _lag_parts(motion, orders)
    if _count_parts(lags) < LEAST_BLOCKS:
        yield LAG.unseen(Why.QUIET_ORDERS)
        yield SERVO.unseen(Why.QUIET_ORDERS)
        return
    yield LAG.value(
        _mean_lag(lags),
        "shift of the orders with the smallest residual to the reported positions, over eight parts, "
        "weighted by the motion",
    )
    if emulated is None or servo is None:
        yield SERVO.unseen(Why.NOT_PLAYED)
        return
    others = _lag_parts(emulated, orders)
    later = {
        key: _Lag(lag.seconds - others[key].seconds, lag.weight) for key, lag in lags.items() if key in others
    }
    if _count_parts(later) < LEAST_BLOCKS:
        yield SERVO.unseen(Why.QUIET_ORDERS)
        return
    default = servo.transport_delay_s + 2.0 * servo.damping_ratio / servo.natural_frequency_rad_s
    quarter = 0.25 * servo.interpolation_s
    more = _mean_lag(later).wider(
        quarter, "and a quarter of a cycle for the time at which the robot reads an order"
    )
    yield SERVO.value(
        Estimate(default + more.value, default + more.low, default + more.high, more.interval),
        "value of the emulated robot, plus the additional lag of the real one with the same orders",
    )


def _count_parts(lags: "_Lags") -> int:
    return len({part for part, _ in lags})


def _orders_of(table: Table) -> str | None:
    return next((name for name in ("order_position", "target_position") if table.has(name)), None)


class _Lag(NamedTuple):
    """Lag of one axis in one part of the recording."""

    seconds: float
    weight: float
    """Variance of the orders in the part, m². A larger motion determines the lag better."""


_Lags: TypeAlias = dict[tuple[int, int], _Lag]
"""Lags by part and axis. Lags that cannot be determined are left out."""


def _lag_parts(table: Table, source_family: str) -> _Lags:
    lags = {}
    edges = np.linspace(table.times[0], table.times[-1] + 1e-9, _PARTS + 1)
    for part in range(_PARTS):
        inside = (table.times >= edges[part]) & (table.times < edges[part + 1])
        for axis, (source, output) in enumerate(
            zip(FAMILIES[source_family], FAMILIES["position"], strict=True)
        ):
            if inside.sum() > PARTS * _LEAST_CYCLES and source in table.columns:
                orders, places = table.columns[source][inside], table.columns[output][inside]
                lag = shift_of(table.times[inside], orders, places)
                if math.isfinite(lag.seconds):
                    lags[part, axis] = _Lag(lag.seconds, float(np.var(orders)))
    return lags


def _mean_lag(lags: _Lags) -> Estimate:
    """Estimate the weighted mean lag, s, with each part of the recording as one block."""
    values = np.array([lag.seconds for lag in lags.values()])
    weights = np.array([lag.weight for lag in lags.values()])
    parts: Ints = np.array([part for part, _ in lags], np.int64)
    return jackknife(parts, lambda mask: float(values[mask] @ weights[mask] / weights[mask].sum()))


# --- place


def _position_values(observations: Observations, emulated: Table | None) -> Iterator[Value]:
    motion = observations.motion
    if motion is None or not motion.has("position"):
        yield from (quantity.unseen(Why.NO_MOTION) for quantity in (*NOISE, NOISE_RATIO, STEP))
        return
    places = motion.rows("position")
    order_family = _orders_of(motion)
    orders = None if order_family is None else motion.rows(order_family)
    step = _step_of(places)
    noises = [
        _noise(quantity, places[:, axis], None if orders is None else orders[:, axis], step)
        for axis, quantity in enumerate(NOISE)
    ]
    yield from noises
    yield _noise_ratio(noises, emulated, motion)
    yield step_value(STEP, step)


def _noise_ratio(noises: Sequence[Value], emulated: Table | None, motion: Table) -> Value:
    """Return the ratio of the noise of the real robot to the noise of the emulated one, over all three axes.

    The samples of the emulated robot are reduced to the sample rate of the recording.
    """
    if not all(noise.seen for noise in noises) or emulated is None:
        why = next((noise.why for noise in noises if noise.why), Why.NOT_PLAYED)
        return NOISE_RATIO.unseen(why)
    every = max(1, round(float(np.median(np.diff(motion.times)) / np.median(np.diff(emulated.times)))))
    usual = math.sqrt(sum(smooth_noise_of(row[::every]) ** 2 for row in emulated.rows("position").T))
    if not usual > 0.0:
        return NOISE_RATIO.unseen(Why.NOT_PLAYED)
    value = math.sqrt(sum(noise.value**2 for noise in noises)) / usual
    half = math.sqrt(sum((noise.value * 0.5 * (noise.high - noise.low)) ** 2 for noise in noises))
    half /= value * usual**2
    return NOISE_RATIO.value(
        Estimate(value, value - half, value + half, "combined over the three axes"),
        "ratio of the root sum of squares over all three axes",
    )


def _step_of(places: Floats) -> float:
    """Return the smallest quantisation step of the axes, or else their common decimal resolution, m; NaN if there
    is none.
    """
    steps = [size for axis in places.T if math.isfinite(size := grid_of(axis)) and _lie_on(axis, size)]
    if steps:
        return min(steps)
    largest = float(np.max(np.abs(places)))
    for decimal in _DECIMALS_M:
        if decimal < _FLOATS * largest:
            break
        if np.abs(places / decimal - np.round(places / decimal)).max() < _NEAR:
            return decimal
    return math.nan


def _lie_on(places: Floats, step: float) -> bool:
    """Return whether nearly all differences are multiples of a step, and are not due to one constant speed."""
    multiples = np.abs(np.diff(places)) / step
    nearest = np.round(multiples)
    near = np.abs(multiples - nearest) < _NEAR
    steps = nearest[near & (nearest > 0.0)]
    if not len(steps):
        return False
    _, counts = np.unique(steps, return_counts=True)
    return float(near.mean()) > _NEARLY_ALL and float(counts.max()) < _ONE_SPEED * len(steps)


def _noise(quantity: Quantity, place: Floats, orders: Floats | None, step: float) -> Value:
    noise = smooth_noise_of(place)
    rounding = 0.0 if math.isnan(step) else step / math.sqrt(12.0)
    if noise < 1.5 * rounding:
        return quantity.unseen(Why.BELOW_STEP)
    if orders is not None and noise < _ABOVE_ORDERS * smooth_noise_of(orders):
        return quantity.unseen(Why.BELOW_MOTION)
    parts = np.array_split(place, 12)
    variances = [smooth_noise_of(part) ** 2 - rounding**2 for part in parts if len(part) > 8]
    if len(variances) < LEAST_BLOCKS:
        return quantity.unseen(Why.NO_SAMPLES)
    estimate = mean_of(np.sqrt(np.maximum(variances, 0.0)))
    return quantity.value(estimate, "third differences of the reported position, unaffected by smooth motion")
