"""Faults of a guided robot, of its datagrams, and of the pose that it tells: one table a target."""

from collections.abc import Mapping

from emulators.arm.own_force import WITNESS_FAULTS
from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.wire import WIRE_FAULTS

_COUNT = Parameter(1, "how many in a row", 1, 10000)
_AXIS = ("x", "y", "z")

ROBOT_FAULTS: Mapping[str, Fault] = {
    "motors-off": Fault("the motors go off at once, and on again at the end", {}, FOREVER),
    "rapid-stop": Fault("the RAPID program is stopped, and started again at the end", {}, FOREVER),
    "egm-stop": Fault("the RAPID program ends the guidance by EGMStop"),
    "out-of-limits": Fault("EGM ends with an error, as for a reference out of the range of a joint"),
    "cannot-send": Fault("EGM ends with event 41830: the controller cannot send"),
    "restart": Fault("the RAPID program is started from its first line: another session"),
}
LINK_FAULTS: Mapping[str, Fault] = {
    **WIRE_FAULTS,
    "mute": Fault("the controller guides and sends nothing", {}, FOREVER),
    "deaf": Fault("no answer comes to the controller, which ends with its time-out", {}, FOREVER),
    "wrong-seqno": Fault(
        "datagrams have a wrong number",
        {"by": Parameter(-100, "how much is added", -1_000_000, 1_000_000), "count": _COUNT},
        amounts=("by",),
    ),
    "malformed": Fault("datagrams come cut off", {"count": _COUNT}),
    "no-force": Fault("datagrams come without the measured force", {}, FOREVER),
}
POSE_FAULTS: Mapping[str, Fault] = {
    "nan": Fault("the measured pose is no number", {"count": _COUNT}),
    "missing": Fault("the measured pose is not told", {"count": _COUNT}),
    "offset": Fault(
        "the measured position is off; the arm stays where it is",
        {
            f"{axis}_mm": Parameter(0.0, f"by how much along base {axis}", -2000.0, 2000.0, "mm")
            for axis in _AXIS
        },
        FOREVER,
        amounts=tuple(f"{axis}_mm" for axis in _AXIS),
    ),
    "frozen": Fault("the measured pose stays as it is", {}, FOREVER),
}

EGM_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "robot": ROBOT_FAULTS,
    "pose": POSE_FAULTS,
    "link": LINK_FAULTS,
    "witness": WITNESS_FAULTS,
}
"""Faults by target."""
