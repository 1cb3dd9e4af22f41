"""Faults of an S3 controller, of the pose that it tells and of its line: one table a target."""

from collections.abc import Mapping

from emulators.arm.reported_pose import along_axes, pose_faults
from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.packets import BYTES, WIRE
from protocol.devices.s3.arap import RefusalCode, SpontaneousKind

_COUNT = Parameter(1, "how many in a row", 1, 1000)
_JUMP = along_axes(100.0, "mm")


def _word(default: int, meaning: str) -> Parameter:
    return Parameter(default, meaning, 0, 0xFFFF)


ROBOT_FAULTS: Mapping[str, Fault] = {
    # --- acts of people at the panel
    "emergency-stop": Fault("the emergency stop is pressed, and released at the end", {}, FOREVER),
    "safeguard-stop": Fault("the work stop is on, and off at the end", {}, FOREVER),
    "key-manual": Fault("the key is turned to MANUAL, and back at the end", {}, FOREVER),
    "local-control": Fault("the link control is taken back, and given at the end", {}, FOREVER),
    "motors-off": Fault("the controller falls into standby; operation has to be ordered again"),
    # --- in the controller
    "false-standby": Fault("the status tells standby, whatever the mode is", {}, FOREVER),
    "late-answer": Fault(
        "the next order is acknowledged in time, and answered late",
        {"seconds": Parameter(3.0, "by how much", 0.0, 3600.0, "s")},
    ),
    "refuses": Fault(
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
        "the controller starts again and has forgotten orders, queue and mode",
        {"after_bytes": Parameter(0, "when it has said so many more bytes, in mid-message", 0, 4096)},
    ),
    # --- in the arm
    "stands": Fault("the interpolator stands still, points are queued", {}, 5.0),
}

REPORTED_POSE_FAULTS: Mapping[str, Fault] = pose_faults(without=("nan", "missing"))
"""A status has a word for each coordinate, and each word is a number."""

POSE_FAULTS: Mapping[str, Fault] = {
    "encoder-offset": Fault(
        "the position that the controller measures jumps, and it drives the arm as far the other way",
        _JUMP,
        FOREVER,
        amounts=tuple(_JUMP),
    ),
    **REPORTED_POSE_FAULTS,
}

LINE_FAULTS: Mapping[str, Fault] = {
    **BYTES.faults,
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
    WIRE: LINE_FAULTS,
}
"""Faults by target."""
