"""Faults of a guided robot, its reported pose and force, and its wire: one table for each target."""

from collections.abc import Mapping

from emulators.arm.own_force import WITNESS_FAULTS
from emulators.arm.reported_pose import POSE_FAULTS
from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.packets import DATAGRAMS, WIRE

ROBOT_FAULTS: Mapping[str, Fault] = {
    "emergency-stop": Fault("the emergency stop is pressed, and released at the end", {}, FOREVER),
    "motors-off": Fault("the motors are switched off at once, and on again at the end", {}, FOREVER),
    "program-stopped": Fault("the RAPID program is stopped, and started again at the end", {}, FOREVER),
    "program-restarted": Fault("the RAPID program is started from its first line: a new session begins"),
    "guidance-ended": Fault("the RAPID program ends the guidance by EGMStop"),
    "out-of-limits": Fault("EGM ends with an error, as for a reference outside a joint's range"),
    "cannot-send": Fault("EGM ends with event 41830: the controller cannot send"),
}
_SEQNO = Fault(
    "datagrams have a wrong number",
    {
        "by": Parameter(-100, "number that is added", -1_000_000, 1_000_000),
        "count": Parameter(1, "number in a row", 1, 10000),
    },
    amounts=("by",),
)

EGM_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "robot": ROBOT_FAULTS,
    "pose": POSE_FAULTS,
    WIRE: {**DATAGRAMS.faults, "wrong-seqno": _SEQNO},
    "witness": {
        **WITNESS_FAULTS,
        "missing": Fault("datagrams do not contain the measured force", {}, FOREVER),
    },
}
"""Faults of the robot, by target."""
