"""Reasons why a guided robot cannot move, derived from its messages."""

from itertools import product

from protocol.devices.egm.messages import Guidance, Motors, Rapid, RobotMessage
from protocol.endpoint import NO_TROUBLE, Trouble

_FAULTS: tuple[tuple[str, frozenset[int], Trouble], ...] = (
    (
        "motors",
        frozenset({Motors.ON}),
        Trouble(
            "the motors are off",
            "release a pressed emergency stop, switch the motors on and start the RAPID program",
        ),
    ),
    (
        "rapid",
        frozenset({Rapid.RUNNING, Rapid.UNDEFINED}),  # it may stay undefined after a restart [O:lib]
        Trouble("the RAPID program is stopped", "start the program"),
    ),
    (
        "guidance",
        frozenset({Guidance.RUNNING}),
        Trouble(
            "it is not guided (mciState STOPPED): EGMRunPose has not started or has ended",
            "start the RAPID program, and give EGMRunPose a CondTime that does not end it",
        ),
    ),
)
"""Field of a robot's message, the values with which the robot can move, and the trouble for any other value [O:lib]."""
_ERROR = Trouble(
    "EGM has ended with an error (mciState ERROR)",
    "read the controller's event log, then start the RAPID program",
)
NO_POSE = Trouble("it reports no pose", "guide it by EGMActPose")
RENUMBERED = Trouble("its datagrams restarted their numbering", "check which program sends to this port")


_HEALTHY = frozenset(product(*(good for _, good, _ in _FAULTS)))
"""Values of the fields in `_FAULTS`, in order, for a robot that can move."""


def find_trouble(message: RobotMessage) -> Trouble:
    """Return the reason why the robot that sent this message cannot move."""
    if (message.motors, message.rapid, message.guidance) in _HEALTHY:
        return NO_TROUBLE
    if message.guidance == Guidance.ERROR:
        return _ERROR
    return next(
        (trouble for field, good, trouble in _FAULTS if getattr(message, field) not in good), NO_TROUBLE
    )
