"""Faults of an emulated controller with RSI, of the pose that it tells, and of its wire: one table a target."""

from collections.abc import Mapping

from emulators.arm.reported_pose import POSE_FAULTS
from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.packets import DATAGRAMS, WIRE

RSI_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "robot": {
        "emergency-stop": Fault(
            "the emergency stop is pressed; at the end released, and the program continues", {}, FOREVER
        ),
        "stands": Fault("the arm stands, and the program says that it runs", {}, FOREVER),
        "guidance-ended": Fault("the program ends with RSI_OFF: nothing is sent any more"),
        "program-restarted": Fault("the program is reset and restarted where the robot stands"),
        "drives-stop": Fault("the drives refuse the correction: stop by $CORRECTION"),
        "limit": Fault(
            "POSCORR or AXISCORR cuts the correction without a word",
            {"mm": Parameter(0.5, "beyond where it is", 0.0, 1000.0, "mm")},
            FOREVER,
        ),
        "out-of-limits": Fault("POSCORRMON takes the correction for too large, and ends RSI"),
        "clock-jump": Fault(
            "the controller's clock jumps", {"ms": Parameter(5000, "by how much", -100000, 100000, "ms")}
        ),
    },
    "pose": POSE_FAULTS,
    WIRE: DATAGRAMS.faults,
}
"""Faults by target: the robot and its program, the pose that it tells, its wire."""
