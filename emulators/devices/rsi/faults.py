"""Faults of an emulated controller with RSI, its reported pose, and its wire: one table for each target."""

from collections.abc import Mapping

from emulators.arm.reported_pose import POSE_FAULTS
from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.packets import DATAGRAMS, WIRE

RSI_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "robot": {
        "emergency-stop": Fault(
            "the emergency stop is pressed; at the end it is released, and the program continues", {}, FOREVER
        ),
        "stands": Fault("the arm stops, and the program reports that it is running", {}, FOREVER),
        "guidance-ended": Fault("the program ends with RSI_OFF: no more telegrams are sent"),
        "program-restarted": Fault("the program is reset and restarted at the robot's present pose"),
        "drives-stop": Fault("the drives refuse the correction: stop by $CORRECTION"),
        "limit": Fault(
            "POSCORR or AXISCORR clamps the correction without a message",
            {"mm": Parameter(0.5, "distance of the limit beyond the present correction", 0.0, 1000.0, "mm")},
            FOREVER,
        ),
        "out-of-limits": Fault("POSCORRMON considers the correction too large, and ends RSI"),
        "clock-jump": Fault(
            "the controller's clock jumps", {"ms": Parameter(5000, "size of the jump", -100000, 100000, "ms")}
        ),
    },
    "pose": POSE_FAULTS,
    WIRE: DATAGRAMS.faults,
}
"""Faults by target: the robot and its program, the reported pose, the wire."""
