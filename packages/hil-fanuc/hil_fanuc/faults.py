"""Faults of the emulated controller, its reported pose, its force, and its wire: one table for each target."""

from collections.abc import Mapping

from emulators.arm.own_force import WITNESS_FAULTS
from emulators.arm.reported_pose import POSE_FAULTS
from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.packets import DATAGRAMS, WIRE

ROBOT_FAULTS: Mapping[str, Fault] = {
    "emergency-stop": Fault(
        "the emergency stop is pressed, and released at the end; its alarms remain until a reset", {}, FOREVER
    ),
    "pendant-on": Fault("the teach pendant is switched on, and off at the end", {}, FOREVER),
    "servo-alarm": Fault("an alarm stops the arm until a reset"),
    "program-aborted": Fault("the TP program of Stream Motion is aborted: reports continue"),
    "tasks-aborted": Fault(
        "all tasks are aborted at the teach pendant: the server of Stream Motion hangs until the power is cycled"
    ),
    "contact-stop": Fault("the contact stop trips, as in a jerky motion, until a reset"),
    "stands": Fault("the arm stops, and the controller reports that it is ready", {}, FOREVER),
    "starves": Fault("the controller is not ready, without an alarm, as after missing set points"),
    "stranger-stop": Fault("a stop packet arrives from another computer: it ends the session"),
    "stranger-start": Fault("a start packet arrives from another computer: alarm HOST-380"),
    "lags": Fault(
        "the arm follows its set points later; after motions, 180 ms were observed, and 84 ms after rest",
        {"ms": Parameter(96.0, "additional delay", 0.0, 1000.0, "ms")},
        FOREVER,
    ),
    "clock-jump": Fault(
        "the clock of the time stamps jumps",
        {"ms": Parameter(5000, "size of the jump", -100000, 100000, "ms")},
    ),
    "rmi-silent": Fault("the Remote Motion Interface does not answer", {}, FOREVER),
}
_NUMBERS = Fault(
    "reports have a wrong number",
    {
        "by": Parameter(-100, "number that is added", -1_000_000, 1_000_000),
        "count": Parameter(1, "number in a row", 1, 10000),
    },
    amounts=("by",),
)

FANUC_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "robot": ROBOT_FAULTS,
    "pose": POSE_FAULTS,
    WIRE: {**DATAGRAMS.faults, "wrong-number": _NUMBERS},
    "witness": {**WITNESS_FAULTS, "missing": Fault("reports contain no force", {}, FOREVER)},
}
"""Faults of the robot, by target."""
