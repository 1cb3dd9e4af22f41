"""The hops of a cycle between the force's sample and the motion that answers it, as one table.

A hop lies between two moments of a cycle. Moments are stamps of the cycle (`CycleRecord`), truths of an emulated cell
(`TruthRecord`), or derived:

- `replied_at`: the controller began to answer the move order, that is the answer's arrival less the time of its
  characters on the line; likewise `status_replied_at`;
- `earliest_at`: when the sensor frame would have arrived with the smallest delay of the run, see
  `latency.earliest_arrivals`.
"""

from dataclasses import dataclass
from enum import StrEnum


class Owner(StrEnum):
    """Whose time a hop is."""

    DEVICE = "device"
    """The sensor's electronics."""
    BUS = "bus"
    """The sensor's wire and whatever converts it."""
    SOFTWARE = "software"
    LINE = "line"
    ROBOT = "robot"


@dataclass(frozen=True, slots=True)
class Hop:
    """A stretch of a cycle between two moments."""

    name: str
    begin: str
    end: str
    owner: Owner
    words: str
    """What takes the time, for a sentence."""


SENSOR = Hop(
    "sensor", "sampled_at", "sensor_at", Owner.BUS, "way of the sample from the sensor to its arrival"
)
JITTER = Hop(
    "sensor_jitter",
    "earliest_at",
    "sensor_at",
    Owner.BUS,
    "sensor frame's delay above the smallest one",
)
INTERPOLATION = Hop(
    "interpolation",
    "replied_at",
    "motion_at",
    Owner.ROBOT,
    "robot's queue, interpolator and way to the position loops",
)
ANSWER = Hop("answer", "replied_at", "answered_at", Owner.LINE, "line time of the move's answer")
TURNAROUND = Hop("turnaround", "transmitted_at", "replied_at", Owner.ROBOT, "robot's turnaround of the move")
MOVING = Hop(
    "robot",
    "transmitted_at",
    "motion_at",
    Owner.ROBOT,
    "robot's turnaround, interpolator and way to the position loops",
)
MIDDLE = (
    Hop("decoding", "sensor_at", "decoded_at", Owner.SOFTWARE, "decoding of the sensor frame"),
    Hop(
        "waiting",
        "decoded_at",
        "status_at",
        Owner.DEVICE,
        "wait of the newest sensor frame for the robot's status",
    ),
    Hop("controller", "status_at", "proposed_at", Owner.SOFTWARE, "controller"),
    Hop("supervisor", "proposed_at", "controlled_at", Owner.SOFTWARE, "supervisor"),
    Hop("hand_over", "controlled_at", "sent_at", Owner.SOFTWARE, "hand-over of the move to the link"),
    Hop("line", "sent_at", "transmitted_at", Owner.LINE, "line time of the move"),
)
STATUS = (
    Hop("status_line", "started_at", "status_transmitted_at", Owner.LINE, "line time of the status order"),
    Hop(
        "status_turnaround",
        "status_transmitted_at",
        "status_replied_at",
        Owner.ROBOT,
        "robot's turnaround of the status order",
    ),
    Hop(
        "status_answer",
        "status_replied_at",
        "status_at",
        Owner.LINE,
        "line time of the status answer",
    ),
)
HOPS = (SENSOR, JITTER, *MIDDLE, TURNAROUND, INTERPOLATION, MOVING, ANSWER, *STATUS)
"""All that can be told of a cycle; which of them make up its way from sample to motion depends on what is known."""
