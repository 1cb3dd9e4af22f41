"""Reasons for which a guided robot cannot move, by its messages."""

from itertools import product

from protocol.devices.egm.messages import Guidance, Motors, Rapid, RobotMessage
from protocol.endpoint import NO_TROUBLE, Trouble

_FAULTS: tuple[tuple[str, frozenset[int], Trouble], ...] = (
    (
        "motors",
        frozenset({Motors.ON}),
        Trouble("the motors are off", "switch them on and start the RAPID program"),
    ),
    (
        "rapid",
        frozenset({Rapid.RUNNING, Rapid.UNDEFINED}),  # it may stay undefined after a restart [O:lib]
        Trouble("the RAPID program is stopped", "start it"),
    ),
    (
        "guidance",
        frozenset({Guidance.RUNNING}),
        Trouble(
            "it is not guided (mciState STOPPED): EGMRunPose has not begun or has ended",
            "start the RAPID program, and give EGMRunPose a CondTime that does not end it",
        ),
    ),
)
"""Field of a robot's message, values with which it moves, and the trouble of any other one [O:lib]."""
_ERROR = Trouble(
    "EGM has ended with an error (mciState ERROR)",
    "read the controller's event log, then start the RAPID program",
)
NO_POSE = Trouble("it tells no pose", "guide it by EGMActPose")
RENUMBERED = Trouble("its datagrams are numbered again", "see which program sends to this port")


_HEALTHY = frozenset(product(*(good for _, good, _ in _FAULTS)))
"""Values of these fields, in their order, of a robot that moves."""


def find_trouble(message: RobotMessage) -> Trouble:
    """Return the reason for which a robot with this message cannot move."""
    if (message.motors, message.rapid, message.guidance) in _HEALTHY:
        return NO_TROUBLE
    if message.guidance == Guidance.ERROR:
        return _ERROR
    return next(
        (trouble for field, good, trouble in _FAULTS if getattr(message, field) not in good), NO_TROUBLE
    )
