"""Response times to a robot that drives the cycle, and the number of late responses."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from hil_bridge.devices.facts import LATE, PACKETS, RobotFacts
from hil_bridge.record.analysis.times import Times, times_of
from hil_bridge.record.records import CycleRecord


@dataclass(frozen=True, slots=True)
class Answers:
    """Response times of a run, with the cycle time and the reaction of the robot."""

    times: Times
    """Time from the arrival of a packet to the response to it, s; one packet per control cycle."""
    cycle_s: float
    """Cycle time of the robot, s; a response that takes longer is late."""
    late: int
    packets: int
    consequence: str
    """Description of how the robot reacts to late responses."""

    @property
    def sentence(self) -> str:
        """One-line description of the response times."""
        p50, p99, longest = (s * 1e3 for s in (self.times.p50_s, self.times.p99_s, self.times.max_s))
        return (
            f"{p50:.2f} ms p50, {p99:.2f} ms p99, {longest:.2f} ms max; {self.late} of {self.packets} later than "
            f"the robot's cycle of {self.cycle_s * 1e3:g} ms"
        )


def answers_of(cycles: Sequence[CycleRecord], robot: RobotFacts, link: Mapping[str, float]) -> Answers | None:
    """Return the response times of these cycles with the counters of the link; None for a polled robot."""
    times = times_of(cycle.answer_s for cycle in cycles)
    if times is None or robot.cycle_s is None:
        return None
    return Answers(times, robot.cycle_s, int(link.get(LATE, 0)), int(link.get(PACKETS, 0)), robot.late)
