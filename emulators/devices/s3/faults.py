"""Faults of an S3 controller, its reported pose and its line: one table for each target."""

from collections.abc import Mapping

from emulators.arm.reported_pose import along_axes, pose_faults
from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.packets import BYTES, WIRE
from protocol.devices.s3.arap import RefusalCode, SpontaneousKind

_COUNT = Parameter(1, "number in a row", 1, 1000)
_JUMP = along_axes(100.0, "mm")


def _word(default: int, meaning: str) -> Parameter:
    return Parameter(default, meaning, 0, 0xFFFF)


ROBOT_FAULTS: Mapping[str, Fault] = {
    # --- acts of people at the panel
    "emergency-stop": Fault("the emergency stop is pressed, and released at the end", {}, FOREVER),
    "safeguard-stop": Fault("the work stop is switched on, and off at the end", {}, FOREVER),
    "key-manual": Fault("the key is turned to MANUAL, and back at the end", {}, FOREVER),
    "local-control": Fault("the link loses control, and regains it at the end", {}, FOREVER),
    "motors-off": Fault("the controller enters standby; operation must be ordered again"),
    # --- in the controller
    "false-standby": Fault("the status reports standby, whatever the mode is", {}, FOREVER),
    "late-answer": Fault(
        "the next order is acknowledged in time, and answered late",
        {"seconds": Parameter(3.0, "delay", 0.0, 3600.0, "s")},
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
        "the controller sends an unsolicited status or error",
        {
            "kind": _word(SpontaneousKind.OPERATIONAL_ERROR.value, "function suffix: 7, 9, 10, 17"),
            "x": _word(13, 'first half of "x.y"'),
            "y": _word(0, 'second half of "x.y"'),
        },
    ),
    "power-cycle": Fault(
        "the controller restarts, and loses its orders, queue and mode",
        {"after_bytes": Parameter(0, "number of bytes that it still sends, even in mid-message", 0, 4096)},
    ),
    # --- in the arm
    "stands": Fault("the interpolator stops, points are queued", {}, 5.0),
}

REPORTED_POSE_FAULTS: Mapping[str, Fault] = pose_faults(without=("nan", "missing"))
"""Faults of the reported pose. They cannot remove it, because a status has a word for each coordinate, and each
word is a number.
"""

POSE_FAULTS: Mapping[str, Fault] = {
    "encoder-offset": Fault(
        "the measured position jumps, and the controller drives the arm as far in the opposite direction",
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
            "of": Parameter("block", "acknowledged item", choices=("block", "bid")),
            "count": _COUNT,
        },
    ),
    "nak-block": Fault(
        "the next block arrives damaged at the controller, which answers NAK", {"count": _COUNT}
    ),
    "corrupt-block": Fault("the controller's next block has a wrong check character", {"count": _COUNT}),
    "lose-eot": Fault("the controller's next EOT is lost", {"count": _COUNT}),
    "babble": Fault(
        "the controller sends random bytes", {"count": Parameter(20, "number of bytes", 1, 4096)}
    ),
    "line-break": Fault(
        "the line is held in break: one 00 byte, then nothing gets through in either direction", {}, 2.0
    ),
}

S3_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "robot": ROBOT_FAULTS,
    "pose": POSE_FAULTS,
    WIRE: LINE_FAULTS,
}
"""Faults of the robot, by target."""
