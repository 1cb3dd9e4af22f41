"""Faults of a guided robot, of the pose and the force that it tells, and of its wire: one table a target."""

from collections.abc import Mapping

from emulators.arm.own_force import WITNESS_FAULTS
from emulators.arm.reported_pose import POSE_FAULTS
from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.packets import DATAGRAMS, WIRE

ROBOT_FAULTS: Mapping[str, Fault] = {
    "emergency-stop": Fault("the emergency stop is pressed, and released at the end", {}, FOREVER),
    "motors-off": Fault("the motors go off at once, and on again at the end", {}, FOREVER),
    "program-stopped": Fault("the RAPID program is stopped, and started again at the end", {}, FOREVER),
    "program-restarted": Fault("the RAPID program is started from its first line: another session"),
    "guidance-ended": Fault("the RAPID program ends the guidance by EGMStop"),
    "out-of-limits": Fault("EGM ends with an error, as for a reference out of the range of a joint"),
    "cannot-send": Fault("EGM ends with event 41830: the controller cannot send"),
}
_SEQNO = Fault(
    "datagrams have a wrong number",
    {
        "by": Parameter(-100, "how much is added", -1_000_000, 1_000_000),
        "count": Parameter(1, "how many in a row", 1, 10000),
    },
    amounts=("by",),
)

EGM_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "robot": ROBOT_FAULTS,
    "pose": POSE_FAULTS,
    WIRE: {**DATAGRAMS.faults, "wrong-seqno": _SEQNO},
    "witness": {
        **WITNESS_FAULTS,
        "missing": Fault("datagrams come without the measured force", {}, FOREVER),
    },
}
"""Faults by target."""
