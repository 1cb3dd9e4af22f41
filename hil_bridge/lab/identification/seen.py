"""The samples of a recording as arrays: of a run, or of a table with a mapping.

Nothing here reads the truth of an emulated cell, its settings or its faults.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from hil_bridge.control.course.intent import Phase
from hil_bridge.devices.facts import Pacing, RobotFacts
from hil_bridge.errors import ConfigError
from hil_bridge.lab.fidelity.measures import LEAST_SAMPLES, Floats
from hil_bridge.lab.fidelity.runs import places_of
from hil_bridge.lab.fidelity.tables import Table
from hil_bridge.lab.identification.orders import given_orders
from hil_bridge.record import Recording
from hil_bridge.record.analysis.summary import end_of
from hil_bridge.record.device_facts import devices_of, recorded_configuration
from hil_bridge.record.records import CycleRecord
from protocol.geometry import Vector, inverse, rotate
from protocol.wrench import SensorFacts, wrench_of

Span: TypeAlias = tuple[float, float]
"""Begin and end, s."""
DOWN: Vector = (0.0, 0.0, -1.0)
"""Assumed of a table: the tool presses along the base frame's z axis, downwards."""
_SETTLED_S = 0.5
"""Chosen: frames of free space end so long before a contact, and begin so long behind it."""
_PRESSING = 0.1
"""Chosen: samples count as pressing above this share of the force that nine of ten stay below."""
LEAST_PRESSING = 20
"""Chosen: samples of a contact at least."""
LEAST_FREE = 10
"""Chosen: samples of free space at each end from which the drift of the zero is told."""
_PLATEAU = 0.9
"""Chosen: share of the frames of a cycle whose force across is smaller than the one that counts."""


@dataclass(frozen=True, slots=True)
class Stream:
    """The sensor's frames."""

    times: Floats
    """Arrival, s, ascending."""
    wrench: Floats
    """(n, 6), N and N·m, in the sensor frame, from the zero of the device or the client."""
    step: Floats
    """(6,): N and N·m of one count; NaN for values that a table tells."""
    standing: Span
    """Time in which the tool stands in free space, s."""
    free: tuple[Span, ...]
    """Times of free space with one zero, before the first contact and behind the last, s."""
    facts: SensorFacts | None = None
    approach: Vector = DOWN
    """The direction into the surface as the sensor sees it at the start."""


@dataclass(frozen=True, slots=True)
class Contact:
    """Samples while the tool presses, in their order of time."""

    times: Floats
    """When the place was true, s."""
    depth: Floats
    """Along the approach, m."""
    press: Floats
    """Force against the approach at that time, N."""
    place: Floats
    """(n, 3), base frame, m."""
    force: Floats
    """(n, 3), of the surface on the tool, base frame, N."""
    stretch: Floats
    """Number of the stretch of each sample: it goes up where the tool begins to press, and where it is lifted."""
    approach: Floats
    """(3,), unit vector into the surface, base frame."""
    course: tuple[Floats, Floats]
    """Arrival, s, and force against the approach, N, of all forces, those that do not press too."""


@dataclass(frozen=True, slots=True)
class Seen:
    """All of it. None for a part that the recording does not tell."""

    motion: Table | None
    """Places as reported, with the targets."""
    orders: Table | None
    """Set points as they were given, with the places; the same as `motion` where nothing lies between."""
    contact: Contact | None
    stream: Stream | None
    robot: RobotFacts
    """As the client told them; its servo, which is assumed, is not looked at."""
    cycles: tuple[CycleRecord, ...] = ()
    packets: Mapping[str, float] | None = None
    """Counters of the robot's link."""


def see_run(run: Recording, alignment: Floats, pace: tuple[float, float]) -> Seen:
    """Samples of a recorded run. `alignment` (3, 3) takes forces as the sensor counts them to the tool's axes. `pace`
    is speed, m/s, and acceleration, m/s², of the client's set points. Raises ConfigError for a run without cycles.
    """
    if not run.cycles:
        raise ConfigError(
            "the recording has no control cycle: nothing moved, so it tells nothing of the cell"
        )
    devices, end = devices_of(run), end_of(run)
    try:
        cycle = devices.robot.cycle_s
        motion: Table | None = places_of(run)
        orders = None if cycle is None else given_orders(run, cycle, *pace)
    except ConfigError:  # too few before the first retraction
        motion = orders = None
    return Seen(
        motion,
        orders or motion,
        _contact_of(run, approach_of(run), alignment),
        _stream_of(run, devices.sensor.facts, alignment),
        devices.robot,
        run.cycles,
        end.link or None,
    )


def approach_of(run: Recording) -> Vector:
    """The direction into the surface of a recorded run, base frame."""
    frame = recorded_configuration(run).get("frame")
    told = frame.get("approach") if isinstance(frame, dict) else None
    try:
        x, y, z = map(float, told or DOWN)
    except (TypeError, ValueError):
        return DOWN
    length = math.hypot(x, y, z)
    return (x / length, y / length, z / length) if 0.0 < length < math.inf else DOWN


def see_table(table: Table) -> Seen:
    """Samples of a table: places, and forces in the base frame. `press` and `depth` lie along one axis."""
    stream = None
    if table.has("force"):
        moments = table.rows("moment") if table.has("moment") else np.full((len(table.times), 3), math.nan)
        wrench = np.hstack([table.rows("force"), moments])
        stream = Stream(table.times, wrench, np.full(6, math.nan), _free_of(table), ())
    motion = table if table.has("position") else None
    return Seen(motion, motion, _contact_of_table(table), stream, RobotFacts())


# --- a run


def _stream_of(run: Recording, facts: SensorFacts | None, alignment: Floats) -> Stream | None:
    frames = run.sensors
    if facts is None or len(frames) < LEAST_SAMPLES:
        return None
    times = np.array([frame.at for frame in frames])
    wrench = np.array([wrench_of(frame.counts, facts.scales) for frame in frames])
    begin = run.cycles[0].started_at
    touched = [cycle.sample.sensor_at for cycle in run.cycles if cycle.in_contact]
    free: tuple[Span, ...] = ()
    if touched:
        free = (begin, touched[0] - _SETTLED_S), (touched[-1] + _SETTLED_S, run.cycles[-1].answered_at)
    in_tool = rotate(inverse(run.cycles[0].sample.quaternion), approach_of(run))
    x, y, z = (alignment.T @ np.array(in_tool)).tolist()
    return Stream(times, wrench, np.array(facts.scales), (float(times[0]), begin), free, facts, (x, y, z))


def _contact_of(run: Recording, approach: Vector, alignment: Floats) -> Contact | None:
    """Pairs of place and force at one time, of the cycles that press. The drift of the zero is taken off."""
    rows: list[tuple[float, ...]] = []
    arrivals: list[tuple[float, float]] = []
    stretch, before = 0, ""
    for cycle in run.cycles:
        sample = cycle.sample
        force = cycle.force if sample.paired_force is None else sample.paired_force
        at = cycle.sample.now if sample.position_at is None else sample.position_at
        pressing = cycle.in_contact or cycle.phase == Phase.RETRACT
        if not math.isfinite(force + at):
            continue
        if pressing and cycle.phase != before:
            stretch, before = stretch + 1, cycle.phase
        elif not pressing:
            before = ""
        x, y, z = rotate(cycle.sample.quaternion, cycle.sample.wrench[:3])
        number = stretch if pressing else 0
        rows.append((at, cycle.depth, force, *cycle.sample.position, x, y, z, number))
        arrivals.append((cycle.sample.sensor_at, cycle.force))
    if len(rows) < LEAST_PRESSING:
        return None
    table = np.array(rows)
    if devices_of(run).robot.pacing is Pacing.ASKED:
        table[:, 6:9] = _forces_on_the_way(run, table, approach, alignment)
    drift = _drift_of(table)
    table[:, 6:9] -= drift
    along = drift @ np.array(approach)
    table[:, 2] += along
    felt, force = np.array(arrivals).T
    fresh = np.diff(np.maximum.accumulate(felt), prepend=-math.inf) > 0.0
    return _pressing(table, approach, (felt[fresh], (force + along)[fresh]))


def _drift_of(table: Floats) -> Floats:
    """Force of the zero's drift at each row, (n, 3), base frame, N: a line between the means of free space before the
    first contact and behind the last; nothing where one of the two is too short.
    """
    nothing: Floats = np.zeros((len(table), 3))
    times, press, touching = table[:, 0], table[:, 2], table[:, 9] > 0
    if not touching.any():
        return nothing
    least = _PRESSING * float(np.quantile(press[touching], 0.9))
    pressed = np.flatnonzero(touching & (press > least))
    if not len(pressed):
        return nothing
    first, last = times[pressed[0]] - _SETTLED_S, times[pressed[-1]] + _SETTLED_S
    ends = [times < first, times > last]
    if min(int(end.sum()) for end in ends) < LEAST_FREE:
        return nothing
    (begin, end), (low, high) = zip(
        *((times[part].mean(), table[part, 6:9].mean(axis=0)) for part in ends), strict=True
    )
    drift: Floats = low + np.outer((times - begin) / (end - begin), high - low)
    return drift


def _forces_on_the_way(run: Recording, table: Floats, approach: Vector, alignment: Floats) -> Floats:
    """Forces (n, 3), base frame, N, of a robot that is asked: it goes step by step, and stands when it is asked. Of the
    frames up to the next cycle that counts whose force across is larger than that of nine in ten.
    """
    facts = devices_of(run).sensor.facts
    forces = table[:, 6:9].copy()
    if facts is None or not run.sensors:
        return forces
    times = np.array([frame.at for frame in run.sensors])
    wrench = np.array([wrench_of(frame.counts, facts.scales)[:3] for frame in run.sensors]) @ alignment.T
    starts = np.array([cycle.started_at for cycle in run.cycles] + [math.inf])
    for row, cycle in enumerate(run.cycles[: len(forces)]):
        low, high = np.searchsorted(times, starts[row : row + 2])
        if high - low < 3:
            continue
        base = np.array([rotate(cycle.sample.quaternion, force) for force in wrench[low:high].tolist()])
        across = base - np.outer(base @ np.array(approach), approach)
        sizes = np.linalg.norm(across, axis=1)
        order = np.argsort(sizes)
        forces[row] = base[order[int(_PLATEAU * (len(order) - 1))]]
    return forces


def _contact_of_table(table: Table) -> Contact | None:
    if not (table.has("depth") and table.has("press")):
        return None
    unknown = np.full((len(table.times), 3), math.nan)
    depth, press = table.columns["depth"], table.columns["press"]
    place = table.rows("position") if table.has("position") else unknown
    force = table.rows("force") if table.has("force") else unknown
    begin, end = _free_of(table)
    free = (table.times >= begin) & (table.times < end)
    if free.sum() >= LEAST_FREE:  # nothing has taken a zero
        press, force = press - press[free].mean(), force - force[free].mean(axis=0)
    columns = (table.times, depth, press, place, force, np.ones(len(depth)))
    return _pressing(np.column_stack(columns), DOWN, (table.times, press))


def _pressing(table: Floats, approach: Vector, course: tuple[Floats, Floats]) -> Contact | None:
    """The rows whose force is away from zero."""
    press, stretch = table[:, 2], table[:, 9]
    if not (stretch > 0).any():
        return None
    pressed = (stretch > 0) & (press > _PRESSING * float(np.quantile(press[stretch > 0], 0.9)))
    if pressed.sum() < LEAST_PRESSING:
        return None
    at, depth, force, *rest = table[pressed].T
    places, forces = np.array(rest[:3]).T, np.array(rest[3:6]).T
    return Contact(at, depth, force, places, forces, rest[6], np.array(approach), course)


def _free_of(table: Table) -> Span:
    """The first stretch of a table whose force is near its least: there the tool presses nothing. A table without a
    contact is free as a whole.
    """
    times = table.times
    if not table.has("press"):
        return float(times[0]), float(times[-1])
    press = table.columns["press"]
    touched = np.flatnonzero(press > _PRESSING * float(np.quantile(press, 0.9)))
    end = times[touched[0]] - _SETTLED_S if len(touched) else times[-1]
    return float(times[0]), float(end)
