"""Observations of a recording as arrays, either from a run, or from a table with its mapping.

The truth of an emulated cell, its settings and its faults are never used.
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
from hil_bridge.lab.identification.orders import setpoints_at_packets
from hil_bridge.record import Recording
from hil_bridge.record.analysis.summary import end_of
from hil_bridge.record.device_facts import devices_of, recorded_configuration
from hil_bridge.record.records import CycleRecord
from protocol.geometry import Vector, inverse, rotate
from protocol.wrench import SensorFacts, wrench_of

Span: TypeAlias = tuple[float, float]
"""Start and end time of an interval, s."""
DOWN: Vector = (0.0, 0.0, -1.0)
"""Direction in which the tool of a table presses, base frame. Assumed: downwards along the z axis."""
_SETTLED_S = 0.5
"""Margin between free space and a contact, before and after the contact, s. Chosen."""
_PRESSING = 0.1
"""Share of the force's 90th percentile above which samples count as contact. Chosen."""
LEAST_PRESSING = 20
"""Smallest number of samples of a contact. Chosen."""
LEAST_FREE = 10
"""Smallest number of samples of free space at each end from which the drift of the zero is determined. Chosen."""
_PLATEAU = 0.9
"""Quantile of the tangential force that represents the force in a cycle. Chosen."""


@dataclass(frozen=True, slots=True)
class Stream:
    """Frames of the sensor, as arrays."""

    times: Floats
    """Arrival times, s, ascending."""
    wrench: Floats
    """Wrenches (n, 6), N and N·m, sensor frame, relative to the zero that the device or the client has set."""
    step: Floats
    """Size of one count (6,), N and N·m; NaN for a table."""
    standing: Span
    """Interval in which the tool is stationary in free space, s."""
    free: tuple[Span, ...]
    """Intervals in free space with a common zero, before the first contact and after the last one, s."""
    facts: SensorFacts | None = None
    approach: Vector = DOWN
    """Unit vector into the surface at the start of the run, sensor frame."""


@dataclass(frozen=True, slots=True)
class Contact:
    """Samples in contact, in time order."""

    times: Floats
    """Times of the positions, s."""
    depth: Floats
    """Depth along the approach, m."""
    press: Floats
    """Force against the approach at these times, N."""
    place: Floats
    """Positions (n, 3) of the tool, base frame, m."""
    force: Floats
    """Forces (n, 3) of the surface on the tool, base frame, N."""
    stretch: Floats
    """Number of the contact to which each sample belongs. It increases when the tool starts to press, and when it
    starts to retract.
    """
    approach: Floats
    """Unit vector (3,) into the surface, base frame."""


@dataclass(frozen=True, slots=True)
class Observations:
    """All observations of a recording. A part that the recording does not contain is None."""

    motion: Table | None
    """Reported positions, and the targets."""
    orders: Table | None
    """Setpoints as sent, and the reported positions. Identical to `motion` if the setpoints are the targets."""
    contact: Contact | None
    stream: Stream | None
    robot: RobotFacts
    """Facts about the robot that the client reported, without its assumed servo."""
    cycles: tuple[CycleRecord, ...] = ()
    packets: Mapping[str, float] | None = None
    """Counters of the robot's link; None without a link."""


def observe_run(run: Recording, alignment: Floats, pace: tuple[float, float]) -> Observations:
    """Extract the observations of a recorded run.

    `alignment` (3, 3) rotates sensor forces to the axes of the tool. `pace` contains the speed, m/s, and the
    acceleration, m/s², of the client's setpoints. Raises ConfigError for a run without cycles.
    """
    if not run.cycles:
        raise ConfigError(
            "the recording has no control cycle, so nothing can be identified; record a run with motion"
        )
    devices, end = devices_of(run), end_of(run)
    try:
        cycle = devices.robot.cycle_s
        motion: Table | None = places_of(run)
        orders = None if cycle is None else setpoints_at_packets(run, cycle, *pace)
    except ConfigError:  # too few cycles before the first retraction
        motion = orders = None
    return Observations(
        motion,
        orders or motion,
        _contact_of(run, approach_of(run), alignment),
        _stream_of(run, devices.sensor.facts, alignment),
        devices.robot,
        run.cycles,
        end.link or None,
    )


def approach_of(run: Recording) -> Vector:
    """Return the unit vector into the surface of a recorded run, base frame."""
    frame = recorded_configuration(run).get("frame")
    approach = frame.get("approach") if isinstance(frame, dict) else None
    try:
        x, y, z = map(float, approach or DOWN)
    except (TypeError, ValueError):
        return DOWN
    length = math.hypot(x, y, z)
    return (x / length, y / length, z / length) if 0.0 < length < math.inf else DOWN


def observe_table(table: Table) -> Observations:
    """Extract the observations of a table: positions, and forces in the base frame, with contact along one axis."""
    stream = None
    if table.has("force"):
        moments = table.rows("moment") if table.has("moment") else np.full((len(table.times), 3), math.nan)
        wrench = np.hstack([table.rows("force"), moments])
        stream = Stream(table.times, wrench, np.full(6, math.nan), _free_of(table), ())
    motion = table if table.has("position") else None
    return Observations(motion, motion, _contact_of_table(table), stream, RobotFacts())


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
    """Return simultaneous positions and forces of the cycles in contact, with the drift of the zero removed."""
    rows: list[tuple[float, ...]] = []
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
    if len(rows) < LEAST_PRESSING:
        return None
    table = np.array(rows)
    if devices_of(run).robot.pacing is Pacing.ASKED:
        table[:, 6:9] = _forces_in_motion(run, table, approach, alignment)
    drift = _drift_of(table)
    table[:, 6:9] -= drift
    table[:, 2] += drift @ np.array(approach)
    return _select_contact(table, approach)


def _drift_of(table: Floats) -> Floats:
    """Return the drift of the zero at each row, (n, 3), base frame, N.

    The drift is a line between the mean of free space before the first contact, and the mean after the last
    contact. It is zero if one of the two intervals is too short.
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


def _forces_in_motion(run: Recording, table: Floats, approach: Vector, alignment: Floats) -> Floats:
    """Return the force of each cycle of a polled robot, (n, 3), base frame, N.

    A polled robot moves step by step, and is stationary when it is polled. The force of a cycle is therefore the
    frame at the 90th percentile of the tangential force among all frames of the cycle.
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
    if free.sum() >= LEAST_FREE:  # the table was not zeroed
        press, force = press - press[free].mean(), force - force[free].mean(axis=0)
    columns = (table.times, depth, press, place, force, np.ones(len(depth)))
    return _select_contact(np.column_stack(columns), DOWN)


def _select_contact(table: Floats, approach: Vector) -> Contact | None:
    """Return the rows in contact; None if there are too few."""
    press, stretch = table[:, 2], table[:, 9]
    if not (stretch > 0).any():
        return None
    pressed = (stretch > 0) & (press > _PRESSING * float(np.quantile(press[stretch > 0], 0.9)))
    if pressed.sum() < LEAST_PRESSING:
        return None
    at, depth, force, *rest = table[pressed].T
    places, forces = np.array(rest[:3]).T, np.array(rest[3:6]).T
    return Contact(at, depth, force, places, forces, rest[6], np.array(approach))


def _free_of(table: Table) -> Span:
    """Return the first interval of a table without contact, s; the complete table if there is no contact."""
    times = table.times
    if not table.has("press"):
        return float(times[0]), float(times[-1])
    press = table.columns["press"]
    touched = np.flatnonzero(press > _PRESSING * float(np.quantile(press, 0.9)))
    end = times[touched[0]] - _SETTLED_S if len(touched) else times[-1]
    return float(times[0]), float(end)
