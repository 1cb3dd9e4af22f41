"""Faults of an emulated controller with RSI: one table a target."""

from collections.abc import Mapping

from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.wire import WIRE_FAULTS

_AXES = ("x", "y", "z")


def _count(default: int) -> Parameter:
    return Parameter(default, "how many in a row", 1, 100000)


def _along(axis: str, limit: float, unit: str) -> Parameter:
    return Parameter(0.0, f"by how much along base {axis}", -limit, limit, unit)


RSI_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "robot": {
        "emergency-stop": Fault(
            "the emergency stop is pressed; at the end released, and the program goes on", {}, FOREVER
        ),
        "stand": Fault("the arm stands, and the program says that it runs", {}, FOREVER),
        "program-end": Fault("the program ends with RSI_OFF: nothing is sent any more"),
        "program-reset": Fault("the program is reset and begun anew where the robot stands"),
        "drives-stop": Fault("the drives refuse the correction: stop by $CORRECTION"),
        "limit": Fault(
            "POSCORR cuts the correction without a word",
            {"mm": Parameter(0.5, "beyond where it is", 0.0, 1000.0, "mm")},
            FOREVER,
        ),
        "monitor": Fault("POSCORRMON takes the correction for too large, and ends RSI"),
    },
    "pose": {
        "offset": Fault(
            "the actual position is told off; the arm stays where it is",
            {f"{axis}_mm": _along(axis, 2000.0, "mm") for axis in _AXES},
            FOREVER,
            amounts=tuple(f"{axis}_mm" for axis in _AXES),
        ),
        "drift": Fault(
            "the actual position as it is told goes astray; the arm stays where it is",
            {f"{axis}_mm_s": _along(axis, 100.0, "mm/s") for axis in _AXES},
            FOREVER,
            amounts=tuple(f"{axis}_mm_s" for axis in _AXES),
        ),
        "turned": Fault(
            "the actual orientation is told as turned about an axis of the base frame",
            {
                "degrees": Parameter(30.0, "by how much", -180.0, 180.0, "°"),
                "axis": Parameter("x", "axis of the base frame", choices=_AXES),
            },
            FOREVER,
        ),
        "frozen": Fault("the actual pose is told as it was", {}, FOREVER),
    },
    "link": WIRE_FAULTS,
    "packets": {
        "mute": Fault("no telegram leaves the controller, and it goes on counting", {}, FOREVER),
        "lost": Fault("the next telegrams are lost", {"count": _count(3)}),
        "late": Fault(
            "telegrams come late, and so their answers",
            {"ms": Parameter(6.0, "by how much", 0.0, 10000.0, "ms")},
            FOREVER,
        ),
        "duplicated": Fault("each telegram comes twice", {}, FOREVER),
        "reordered": Fault("of two telegrams the second comes first", {}, FOREVER),
        "not-a-number": Fault("the position is told as NaN", {}, FOREVER),
        "malformed": Fault("telegrams end in the middle", {}, FOREVER),
        "clock-jump": Fault(
            "the controller's clock jumps", {"ms": Parameter(5000, "by how much", -100000, 100000, "ms")}
        ),
    },
    "answers": {
        "lost": Fault("the next answers are lost", {"count": _count(3)}),
        "refused": Fault("answers are discarded, and count as late", {}, FOREVER),
    },
}
"""Faults by target: the robot and its program, the pose that it tells, its wire, its telegrams, the answers to them."""
