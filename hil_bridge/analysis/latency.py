"""Where the time between a force and the motion that answers it goes, hop by hop, from a record alone."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hil_bridge.analysis.hops import (
    ANSWER,
    INTERPOLATION,
    JITTER,
    MIDDLE,
    MOVING,
    SENSOR,
    STATUS,
    TURNAROUND,
    Hop,
)
from hil_bridge.analysis.times import Times, times_of
from hil_bridge.recording.device_facts import Devices, devices_of
from hil_bridge.recording.reader import Recording
from hil_bridge.recording.records import CycleRecord, SensorRecord, TruthRecord
from protocol.s3.adlp import LinkProfile
from protocol.s3.timing import answer_time, move_answer_time

Floats: TypeAlias = NDArray[np.float64]

_WAIT_TICKS = 0.5
"""Ticks of the interpolator that a point waits on the mean for its first set point."""


@dataclass(frozen=True, slots=True)
class Part:
    """A hop and how long it took."""

    hop: Hop
    times: Times


@dataclass(frozen=True, slots=True)
class Constant:
    """A delay that nothing stamps."""

    words: str
    seconds: float
    source: str


@dataclass(frozen=True, slots=True)
class AnswerTimes:
    """What the characters of the answers take on the line, s."""

    status: float
    move: float

    @classmethod
    def on(cls, profile: LinkProfile) -> "AnswerTimes":
        """On a link with this profile."""
        return cls(answer_time(profile), move_answer_time(profile))


@dataclass(frozen=True, slots=True)
class Latency:
    """A run's time from the force's sample to the motion that answers it."""

    chain: tuple[Part, ...]
    """The hops in their order; the next begins where one ends."""
    beside: tuple[Part, ...]
    """Hops of the cycle that the sample does not wait for."""
    name: str
    """From where to where the chain leads, in words."""
    total: Times
    constants: tuple[Constant, ...] = ()

    @property
    def largest(self) -> Part:
        """The hop with the largest median."""
        return max(self.chain, key=lambda part: part.times.p50_s)

    @property
    def largest_words(self) -> str:
        """The largest hop with its share of the whole, by the medians."""
        part = self.largest
        whole = self.total.p50_s
        share = f", {100.0 * part.times.p50_s / whole:.0f} %" if whole > 0.0 else ""
        return f"{part.hop.words} ({part.times.p50_s * 1e3:.0f} ms{share})"

    @property
    def sentence(self) -> str:
        """The whole in one line."""
        total = self.total
        p50, p99 = total.p50_s * 1e3, total.p99_s * 1e3
        return f"{self.name} {p50:.0f} ms p50, {p99:.0f} ms p99; largest: {self.largest_words}"

    def as_ms(self) -> dict[str, Mapping[str, float]]:
        """Every distribution by the name of its hop, and `total`; for a summary."""
        parts = {part.hop.name: part.times.as_ms() for part in (*self.chain, *self.beside)}
        return {**parts, "total": self.total.as_ms()}


def latency_of(recording: Recording) -> Latency | None:
    """The latency of a recorded run; None where its cycles were not stamped or its link is not known."""
    answers = answer_times(recording)
    if answers is None:
        return None
    known = any(math.isfinite(truth.sampled_at) for truth in recording.truths)
    earliest = {} if known else earliest_arrivals(recording.sensors)
    found = budget(recording.cycles, answers, recording.truths, earliest)
    return None if found is None else replace(found, constants=_constants(devices_of(recording), found))


def budget(
    cycles: Sequence[CycleRecord],
    answers: AnswerTimes,
    truths: Sequence[TruthRecord] = (),
    earliest: Mapping[int, float] | None = None,
) -> Latency | None:
    """The latency of these cycles, without its constants; None where they were not stamped.

    `earliest` are the earliest arrivals by the frame's sequence.
    """
    moment = moments(cycles, answers, truths, earliest)

    def took(begin: str, end: str) -> Times | None:
        return times_of((moment(end) - moment(begin)).tolist())

    def known(name: str) -> bool:
        return bool(np.isfinite(moment(name)).any())

    first, begin = next(
        (
            (hop, words)
            for hop, words in ((SENSOR, "sample"), (JITTER, "sample's earliest arrival"))
            if known(hop.begin)
        ),
        (None, "sample's arrival"),
    )
    last: tuple[Hop, ...] = (TURNAROUND, ANSWER)
    if moving := known("motion_at"):
        # Where a point is answered only once it is reached, the answer comes after the motion.
        behind = np.nanmin(moment("motion_at") - moment("replied_at")) < 0.0
        last = (MOVING,) if behind else (TURNAROUND, INTERPOLATION)
    hops = (*((first,) if first else ()), *MIDDLE, *last)
    chain = tuple(Part(hop, times) for hop in hops if (times := took(hop.begin, hop.end)) is not None)
    total = took(hops[0].begin, hops[-1].end)
    if len(chain) < len(hops) or total is None:
        return None
    others = (*STATUS, *((TURNAROUND, ANSWER) if moving else ()))
    beside = tuple(
        Part(hop, times)
        for hop in others
        if hop not in hops and (times := took(hop.begin, hop.end)) is not None
    )
    return Latency(chain, beside, f"{begin} to {'motion' if moving else 'answer'}", total)


def answer_times(recording: Recording) -> AnswerTimes | None:
    """On the line of the recorded run; None when the record does not say enough."""
    robot = devices_of(recording).robot
    if robot.status_answer_s is None or robot.move_answer_s is None:
        return None
    return AnswerTimes(robot.status_answer_s, robot.move_answer_s)


def earliest_arrivals(frames: Sequence[SensorRecord]) -> dict[int, float]:
    """By the frame's sequence, when it would have arrived with the smallest delay, s; empty for too few frames.

    The straight line that lies nowhere above the arrivals and nearest to them on the mean; it carries an edge of
    their lower convex hull, so drift between the two clocks does not count as delay. What an arrival is later is
    jitter alone: without the cell's truth nobody can tell the smallest delay itself.
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
    """Whether b lies on or above the line from a to c."""
    return (b[1] - a[1]) * (c[0] - a[0]) >= (c[1] - a[1]) * (b[0] - a[0])


def moments(
    cycles: Sequence[CycleRecord],
    answers: AnswerTimes,
    truths: Sequence[TruthRecord] = (),
    earliest: Mapping[int, float] | None = None,
) -> Callable[[str], Floats]:
    """Looks a moment (see `hops`) of every cycle up by its name, s; NaN where it is not known.

    `earliest` are the earliest arrivals by the frame's sequence.
    """
    earliest = earliest or {}
    of_cycle = {truth.cycle: truth for truth in truths}
    made: dict[str, Floats] = {}

    def column(values: Sequence[float]) -> Floats:
        return np.array(values, dtype=np.float64)

    def moment(name: str) -> Floats:
        if name not in made:
            match name:
                case "sampled_at" | "motion_at":
                    made[name] = column(
                        [getattr(of_cycle.get(cycle.cycle), name, math.nan) for cycle in cycles]
                    )
                case "earliest_at":
                    made[name] = column([earliest.get(cycle.sensor_sequence, math.nan) for cycle in cycles])
                case "replied_at":
                    made[name] = moment("answered_at") - answers.move
                case "status_replied_at":
                    made[name] = moment("status_at") - answers.status
                case _:
                    made[name] = column([getattr(cycle, name) for cycle in cycles])
        return made[name]

    return moment


def _constants(devices: Devices, found: Latency) -> tuple[Constant, ...]:
    """What lies before the sample and behind the motion."""
    constants = []
    if delay := devices.sensor.delay_s:
        constants.append(Constant("the sensor's filter", delay, "from its cut-off frequency"))
    if (servo := devices.robot.servo) is None:
        return tuple(constants)
    source = "as configured for the emulated robot" if devices.robot.emulated else "assumed"
    wait, transport = _WAIT_TICKS * servo.interpolation_s, servo.transport_delay_s
    response = 2.0 * servo.damping_ratio / servo.natural_frequency_rad_s
    if not found.name.endswith("motion"):
        constants.append(Constant("the wait for the robot's interpolator", wait, f"half a tick, {source}"))
        constants.append(Constant("the servo's transport delay", transport, source))
    constants.append(Constant("the servo's response", response, f"2ζ/ω, {source}"))
    return tuple(constants)
