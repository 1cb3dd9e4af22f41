"""Faults of an S3 controller, its encoders and its link: one table a target."""

from collections.abc import Mapping

from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.wire import WIRE_FAULTS
from protocol.devices.s3.arap import RefusalCode, SpontaneousKind

_COUNT = Parameter(1, "how many in a row", 1, 1000)
_AXIS = ("x", "y", "z")


def _word(default: int, meaning: str) -> Parameter:
    return Parameter(default, meaning, 0, 0xFFFF)


def _millimetres(axis: str, default: float, limit: float) -> Parameter:
    return Parameter(default, f"by how much along base {axis}", -limit, limit, "mm")


ROBOT_FAULTS: Mapping[str, Fault] = {
    # --- acts of people at the panel
    "emergency-stop": Fault("the emergency stop is pressed, and released at the end", {}, FOREVER),
    "work-stop": Fault("the work stop is on", {}, FOREVER),
    "key-manual": Fault("the key is turned to MANUAL, and back at the end", {}, FOREVER),
    "link-control-taken": Fault("the link control is taken back, and given at the end", {}, FOREVER),
    "standby": Fault("the controller falls into standby; operation has to be ordered anew"),
    # --- in the controller
    "silence": Fault("the controller neither hears nor says anything", {}, 5.0),
    "late-answer": Fault(
        "the next order is answered late", {"seconds": Parameter(3.0, "by how much", 0.0, 3600.0, "s")}
    ),
    "refuse": Fault(
        "the next orders are refused",
        {
            "code": _word(RefusalCode.NOT_POSSIBLE.value, "refusal code"),
            "function": Parameter(0, "only an order with this function code; 0 for any", 0, 255),
            "count": _COUNT,
        },
    ),
    "spontaneous": Fault(
        "the controller tells a status or error unasked",
        {
            "kind": _word(SpontaneousKind.OPERATIONAL_ERROR.value, "function suffix: 7, 9, 10, 17"),
            "x": _word(13, 'first half of "x.y"'),
            "y": _word(0, 'second half of "x.y"'),
        },
    ),
    "power-cycle": Fault(
        "the controller starts anew and has forgotten orders, queue and mode",
        {"after_bytes": Parameter(0, "when it has said so many more bytes, in mid-message", 0, 4096)},
    ),
    # --- in the arm
    "freeze": Fault("the interpolator stands still, points are queued", {}, 5.0),
}

POSE_FAULTS: Mapping[str, Fault] = {
    "encoder-offset": Fault(
        "the position that the controller measures jumps, and it drives the arm as far the other way",
        {f"{axis}_mm": _millimetres(axis, 0.0, 100.0) for axis in _AXIS},
        FOREVER,
        amounts=tuple(f"{axis}_mm" for axis in _AXIS),
    ),
    "offset": Fault(
        "the reported position is off; the arm stays where it is",
        {f"{axis}_mm": _millimetres(axis, 0.0, 2000.0) for axis in _AXIS},
        FOREVER,
        amounts=tuple(f"{axis}_mm" for axis in _AXIS),
    ),
    "drift": Fault(
        "the reported position goes astray; the arm stays where it is",
        {
            f"{axis}_mm_s": Parameter(0.0, f"how fast along base {axis}", -100.0, 100.0, "mm/s")
            for axis in _AXIS
        },
        FOREVER,
        amounts=tuple(f"{axis}_mm_s" for axis in _AXIS),
    ),
    "frozen": Fault("the reported pose stays as it is", {}, FOREVER),
    "late": Fault(
        "the reported position is an old one", {"ms": Parameter(200.0, "how old", 0.0, 5000.0, "ms")}, FOREVER
    ),
    "mirrored": Fault(
        "the reported position goes the other way, from where it is now",
        {"axis": Parameter("z", "axis of the base frame", choices=_AXIS)},
        FOREVER,
    ),
    "turned": Fault(
        "the reported orientation is turned about an axis of the base frame",
        {
            "degrees": Parameter(30.0, "by how much", -180.0, 180.0, "°"),
            "axis": Parameter("x", "axis of the base frame", choices=_AXIS),
        },
        FOREVER,
    ),
    "standby": Fault("the status tells standby, whatever the mode is", {}, FOREVER),
}

LINK_FAULTS: Mapping[str, Fault] = {
    **WIRE_FAULTS,
    "drop-ack": Fault(
        "the controller's next ACK is lost",
        {
            "of": Parameter("block", "what it acknowledges", choices=("block", "bid")),
            "count": _COUNT,
        },
    ),
    "nak-block": Fault(
        "the next block arrives damaged at the controller, which answers NAK", {"count": _COUNT}
    ),
    "corrupt-block": Fault("the controller's next block has a wrong check character", {"count": _COUNT}),
    "lose-eot": Fault("the controller's next EOT is lost", {"count": _COUNT}),
    "babble": Fault("random bytes come from the controller", {"count": Parameter(20, "how many", 1, 4096)}),
    "line-break": Fault(
        "the line is held in break: one 00 byte, then nothing gets through either way", {}, 2.0
    ),
}

S3_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "robot": ROBOT_FAULTS,
    "pose": POSE_FAULTS,
    "link": LINK_FAULTS,
}
"""Faults by target."""


def target_of(fault: str) -> str:
    """The target of a fault that is named alone, as panels did before there were targets. Raises ValueError."""
    for target, faults in S3_FAULTS.items():
        if fault in faults:
            return target
    known = ", ".join(name for faults in S3_FAULTS.values() for name in faults)
    raise ValueError(f"no fault is called {fault!r}; known: {known}")
