"""Latency from a force to the motion in response, hop by hop, computed only from a recording."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hil_bridge.devices.facts import Devices, Hop, RobotHops
from hil_bridge.record.analysis.hops import JITTER, MIDDLE, SENSOR
from hil_bridge.record.analysis.times import Times, in_ms, times_of
from hil_bridge.record.device_facts import devices_of
from hil_bridge.record.reader import Recording
from hil_bridge.record.records import CycleRecord, SensorRecord, TruthRecord

Floats: TypeAlias = NDArray[np.float64]

STAMPS: Mapping[str, Callable[[CycleRecord], float]] = {
    **{name: attrgetter(name) for name in CycleRecord.__struct_fields__ if name.endswith("_at")},
    "status_at": attrgetter("sample.now"),
    "sensor_at": attrgetter("sample.sensor_at"),
}
"""Time stamps of a cycle, by the names that the facts in a recording may use."""


@dataclass(frozen=True, slots=True)
class Part:
    """Hop with its distribution of durations."""

    hop: Hop
    times: Times


@dataclass(frozen=True, slots=True)
class Constant:
    """Delay for which the recording has no time stamp."""

    words: str
    seconds: float
    """Delay, s."""
    source: str
    """Description of the origin of the value."""


@dataclass(frozen=True, slots=True)
class Latency:
    """Latency of a run, from the force sample to the motion in response."""

    chain: tuple[Part, ...]
    """Hops in order; each hop begins where the previous hop ends."""
    beside: tuple[Part, ...]
    """Hops of the cycle that the sample does not wait for."""
    name: str
    """Description of the start and the end of the chain."""
    total: Times
    """Time from the start of the chain to its end, s."""
    to_motion: bool
    """Whether the chain ends with the robot's motion. If not, it ends with the robot's response."""
    constants: tuple[Constant, ...] = ()

    @property
    def largest(self) -> Part:
        """Hop with the largest median."""
        return max(self.chain, key=lambda part: part.times.p50_s)

    @property
    def largest_text(self) -> str:
        """Description of the hop with the largest median, with its share of the median total."""
        part = self.largest
        total_s = self.total.p50_s
        share = f", {100.0 * part.times.p50_s / total_s:.0f} %" if total_s > 0.0 else ""
        return f"{part.hop.words} ({in_ms(part.times.p50_s)} ms{share})"

    @property
    def sentence(self) -> str:
        """One-line description of the latency."""
        total = self.total
        p50, p99 = in_ms(total.p50_s), in_ms(total.p99_s)
        return f"{self.name} {p50} ms p50, {p99} ms p99; largest: {self.largest_text}"

    def as_ms(self) -> dict[str, Mapping[str, float]]:
        """Return the distribution of every hop by name, and of `total`, in ms, for a summary."""
        parts = {part.hop.name: part.times.as_ms() for part in (*self.chain, *self.beside)}
        return {**parts, "total": self.total.as_ms()}


def latency_of(recording: Recording) -> Latency | None:
    """Return the latency of a recorded run; None if its cycles have no time stamps or the robot's hops are unknown."""
    devices = devices_of(recording)
    if devices.robot.hops is None:
        return None
    known = any(math.isfinite(truth.sampled_at) for truth in recording.truths)
    earliest = {} if known else earliest_arrivals(recording.sensors)
    latency = latency_budget(recording.cycles, devices.robot.hops, recording.truths, earliest)
    return None if latency is None else replace(latency, constants=_constants(devices, latency))


def latency_budget(
    cycles: Sequence[CycleRecord],
    robot: RobotHops,
    truths: Sequence[TruthRecord] = (),
    earliest: Mapping[int, float] | None = None,
) -> Latency | None:
    """Return the latency of these cycles, excluding constant delays; None if they have no time stamps.

    `robot` holds the hops after the hand-over. `earliest` holds the earliest arrivals by the sequence number of the
    frame.
    """
    moment = timestamps(cycles, robot, truths, earliest)

    def took(hop: Hop) -> Times | None:
        return times_of((moment(hop.end) - moment(hop.begin)).tolist())

    def known(name: str) -> bool:
        return bool(np.isfinite(moment(name)).any())

    first, begin = next(
        (
            (hop, text)
            for hop, text in ((SENSOR, "sample"), (JITTER, "sample's earliest arrival"))
            if known(hop.begin)
        ),
        (None, "sample's arrival"),
    )
    last = robot.to_answer
    if moving := bool(robot.to_motion) and known("motion_at"):
        last = next(
            (hops_to_motion for hops_to_motion in robot.to_motion if not _ends_early(hops_to_motion, moment)),
            robot.to_motion[-1],
        )
    hops = (*((first,) if first else ()), *MIDDLE, *last)
    chain = tuple(Part(hop, times) for hop in hops if (times := took(hop)) is not None)
    total = times_of((moment(hops[-1].end) - moment(hops[0].begin)).tolist())
    if len(chain) < len(hops) or total is None:
        return None
    parallel = tuple(
        Part(hop, times)
        for hop in (*robot.beside, *robot.to_answer)
        if hop not in hops and (times := took(hop)) is not None
    )
    return Latency(chain, parallel, f"{begin} to {'motion' if moving else 'answer'}", total, moving)


def _ends_early(hops: Sequence[Hop], moment: Callable[[str], Floats]) -> bool:
    """Return whether the last hop ends before its start in any cycle."""
    if not hops:
        return True
    took = moment(hops[-1].end) - moment(hops[-1].begin)
    return bool((took < 0.0).any())


def earliest_arrivals(frames: Sequence[SensorRecord]) -> dict[int, float]:
    """Return the arrival times that frames with the smallest delay would have, s, by sequence number.

    The result is empty if there are too few frames. It is the straight line that is never above the arrivals and is
    nearest to them on average. The line contains an edge of their lower convex hull, so drift between the two
    clocks does not count as delay. The lateness of an arrival is therefore jitter only: the smallest delay itself
    is known only from the ground truth of the cell.
    """
    points = sorted((frame.sequence, frame.at) for frame in frames if math.isfinite(frame.at))
    if len(points) < 2 or points[0][0] == points[-1][0]:
        return {}
    hull: list[tuple[int, float]] = []
    for x, y in points:
        if hull and hull[-1][0] == x:
            continue
        while len(hull) > 1 and _falls_below(hull[-2], hull[-1], (x, y)):
            hull.pop()
        hull.append((x, y))
    middle = sum(x for x, _ in points) / len(points)
    k = next(k for k in range(1, len(hull)) if hull[k][0] >= middle)
    (x0, y0), (x1, y1) = hull[k - 1], hull[k]
    step = (y1 - y0) / (x1 - x0)
    return {x: y0 + (x - x0) * step for x, _ in points}


def _falls_below(a: tuple[int, float], b: tuple[int, float], c: tuple[int, float]) -> bool:
    """Return whether b is on or above the line from a to c."""
    return (b[1] - a[1]) * (c[0] - a[0]) >= (c[1] - a[1]) * (b[0] - a[0])


def timestamps(
    cycles: Sequence[CycleRecord],
    robot: RobotHops,
    truths: Sequence[TruthRecord] = (),
    earliest: Mapping[int, float] | None = None,
) -> Callable[[str], Floats]:
    """Return a function that maps the name of a time stamp to its value in every cycle, s.

    The value is NaN if it is unknown. `hil_bridge.devices.facts` defines the names. `earliest` holds the earliest
    arrivals by the sequence number of the frame.
    """
    arrivals = earliest or {}
    of_cycle = {truth.cycle: truth for truth in truths}
    derived = {moment.name: moment for moment in robot.moments}
    made: dict[str, Floats] = {}

    def stamp(name: str) -> Floats:
        match name:
            case "sampled_at" | "motion_at":
                values = [getattr(of_cycle.get(cycle.cycle), name, math.nan) for cycle in cycles]
            case "earliest_at":
                values = [arrivals.get(cycle.sample.sensor_sequence, math.nan) for cycle in cycles]
            case _ if name in STAMPS:
                values = [STAMPS[name](cycle) for cycle in cycles]
            case _:
                values = [math.nan] * len(cycles)
        return np.array(values, dtype=np.float64)

    def moment(name: str) -> Floats:
        if name not in made:
            known = derived.get(name)
            made[name] = stamp(name) if known is None else stamp(known.stamp) - known.earlier_s
        return made[name]

    return moment


def _constants(devices: Devices, latency: Latency) -> tuple[Constant, ...]:
    """Return the constant delays before the sample and after the motion."""
    constants = []
    if delay := devices.sensor.delay_s:
        constants.append(Constant("the sensor's filter", delay, "from its cut-off frequency"))
    if (servo := devices.robot.servo) is None:
        return tuple(constants)
    source = devices.robot.servo_source
    response = 2.0 * servo.damping_ratio / servo.natural_frequency_rad_s
    if not latency.to_motion:
        wait_source = f"half a tick, {source('interpolation_s')}"
        constants.append(Constant("the wait for the robot's interpolator", servo.wait_s, wait_source))
        wait_source = source("transport_delay_s")
        constants.append(Constant("the servo's transport delay", servo.transport_delay_s, wait_source))
    wait_source = f"2ζ/ω, {source('natural_frequency_rad_s', 'damping_ratio')}"
    constants.append(Constant("the servo's response", response, wait_source))
    return tuple(constants)
