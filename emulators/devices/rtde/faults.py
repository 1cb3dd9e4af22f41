"""Faults of the emulated controller, its reports, and its cable: one table for each target."""

from collections.abc import Mapping

from emulators.arm.own_force import WITNESS_FAULTS
from emulators.arm.reported_pose import pose_faults
from emulators.devices.rtde.packages import MESSAGES, PACKAGES
from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.packets import WIRE

ROBOT_FAULTS: Mapping[str, Fault] = {
    "protective-stop": Fault("a protective stop, which is not unlocked automatically"),
    "emergency-stop": Fault("the emergency stop is pressed, and released at the end", {}, FOREVER),
    "safeguard-stop": Fault("a safeguard opens, and closes at the end", {}, FOREVER),
    "local-control": Fault("it is switched to local control, and back at the end", {}, FOREVER),
    "program-stopped": Fault("the program is stopped"),
    "program-paused": Fault("the program is paused"),
    "motors-off": Fault("the arm's power is switched off"),
    "slider": Fault(
        "the speed slider is lowered, and restored at the end",
        {"percent": Parameter(40.0, "slider position", 0.0, 100.0, "%")},
        FOREVER,
    ),
    "primary-silent": Fault("the primary and secondary interfaces are silent", {}, FOREVER),
    "in-use": Fault("another client holds the registers that our program uses", {}, FOREVER),
}
POSE_FAULTS: Mapping[str, Fault] = pose_faults(without=("missing",))
"""Faults of the reported pose. They cannot remove it, because an output package has all fields of its recipe."""
DROPPED = "dropped"
PROGRAM_WIRE = "program-wire"
"""Fault target for connections that a program opens, such as those of external control."""
_DROPPED = Fault("all connections to the RTDE port are closed")
_HUNG_UP = Fault("all connections that a program has opened are closed")

RTDE_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "robot": ROBOT_FAULTS,
    "pose": POSE_FAULTS,
    WIRE: {**PACKAGES.faults, DROPPED: _DROPPED},
    PROGRAM_WIRE: {**MESSAGES.faults, DROPPED: _HUNG_UP},
    "witness": WITNESS_FAULTS,
}
"""Faults of the robot, by target."""
