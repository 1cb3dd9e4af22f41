"""Hops into which the stamps of an S3's exchanges divide a cycle. `replied_at` is the time at which the robot began
to answer.

A message is sent as ENQ, ACK, block, ACK, EOT. The start of an answer is the time of its arrival minus the time of
its characters.
"""

from hil_bridge.devices.facts import ACCEPTED, Hop, Moment, Owner, RobotHops
from protocol.devices.s3.adlp import LinkProfile
from protocol.devices.s3.timing import answer_time, move_answer_time

_STATUS_REPLIED = "status_replied_at"

_LINE = Hop("line", "sent_at", "transmitted_at", Owner.LINE, "line time of the move")
_TURNAROUND = Hop("turnaround", "transmitted_at", ACCEPTED, Owner.ROBOT, "robot's turnaround of the move")
_ANSWER = Hop("answer", ACCEPTED, "answered_at", Owner.LINE, "line time of the move's answer")
_INTERPOLATION = Hop(
    "interpolation",
    ACCEPTED,
    "motion_at",
    Owner.ROBOT,
    "robot's queue, interpolator and path to the position loops",
)
_MOVING = Hop(
    "robot",
    "transmitted_at",
    "motion_at",
    Owner.ROBOT,
    "robot's turnaround, interpolator and path to the position loops",
)
_STATUS = (
    Hop("status_line", "started_at", "status_transmitted_at", Owner.LINE, "line time of the status order"),
    Hop(
        "status_turnaround",
        "status_transmitted_at",
        _STATUS_REPLIED,
        Owner.ROBOT,
        "robot's turnaround of the status order",
    ),
    Hop("status_answer", _STATUS_REPLIED, "status_at", Owner.LINE, "line time of the status answer"),
)


def robot_hops(profile: LinkProfile) -> RobotHops:
    """Return the hops on a computer link with this profile. If the robot answers a point only after reaching it,
    its answer comes after the motion, and turnaround and interpolator cannot be separated.
    """
    return RobotHops(
        to_answer=(_LINE, _TURNAROUND, _ANSWER),
        to_motion=((_LINE, _TURNAROUND, _INTERPOLATION), (_LINE, _MOVING)),
        beside=_STATUS,
        moments=(
            Moment(ACCEPTED, "answered_at", move_answer_time(profile)),
            Moment(_STATUS_REPLIED, "status_at", answer_time(profile)),
        ),
    )
