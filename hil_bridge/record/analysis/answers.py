"""Answers to a robot that drives the cycle: how soon they were given, and how many came late."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from hil_bridge.devices.facts import LATE, PACKETS, RobotFacts
from hil_bridge.record.analysis.times import Times, times_of
from hil_bridge.record.records import CycleRecord


@dataclass(frozen=True, slots=True)
class Answers:
    """Answers of a run."""

    times: Times
    """From the arrival of a packet to its answer, of one packet a control cycle."""
    cycle_s: float
    """Cycle of the robot; an answer that takes longer is late."""
    late: int
    packets: int
    consequence: str
    """Reaction of the robot to late answers, in words."""

    @property
    def sentence(self) -> str:
        """The whole in one line."""
        p50, p99, longest = (s * 1e3 for s in (self.times.p50_s, self.times.p99_s, self.times.max_s))
        return (
            f"{p50:.2f} ms p50, {p99:.2f} ms p99, {longest:.2f} ms max; {self.late} of {self.packets} later than "
            f"the robot's cycle of {self.cycle_s * 1e3:g} ms"
        )


def answers_of(cycles: Sequence[CycleRecord], robot: RobotFacts, link: Mapping[str, float]) -> Answers | None:
    """Return the answers of these cycles, with the counters of the link; None for a robot that is polled."""
    times = times_of(cycle.answer_s for cycle in cycles)
    if times is None or robot.cycle_s is None:
        return None
    return Answers(times, robot.cycle_s, int(link.get(LATE, 0)), int(link.get(PACKETS, 0)), robot.late)
