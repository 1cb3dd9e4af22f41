"""Faults of the emulated controller, of what it tells, and of its cable: one table a target."""

from collections.abc import Mapping

from emulators.arm.own_force import WITNESS_FAULTS
from emulators.arm.reported_pose import pose_faults
from emulators.devices.rtde.packages import MESSAGES, PACKAGES
from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.packets import WIRE

ROBOT_FAULTS: Mapping[str, Fault] = {
    "protective-stop": Fault("a protective stop; it is not unlocked by itself"),
    "emergency-stop": Fault("the emergency stop is pressed, and released at the end", {}, FOREVER),
    "safeguard-stop": Fault("a safeguard opens, and closes at the end", {}, FOREVER),
    "local-control": Fault("it is switched to local control, and back at the end", {}, FOREVER),
    "program-stopped": Fault("the program is stopped"),
    "program-paused": Fault("the program is paused"),
    "motors-off": Fault("the arm's power is switched off"),
    "slider": Fault(
        "the speed slider is put down, and back up at the end",
        {"percent": Parameter(40.0, "where it stands", 0.0, 100.0, "%")},
        FOREVER,
    ),
    "primary-silent": Fault("the primary and the secondary interface say nothing", {}, FOREVER),
    "in-use": Fault("another client holds the registers of our program", {}, FOREVER),
}
POSE_FAULTS: Mapping[str, Fault] = pose_faults(without=("missing",))
"""An output package has all fields of its recipe."""
DROPPED = "dropped"
PROGRAM_WIRE = "program-wire"
"""Target of the faults of the connections that a program opens, as of external control's."""
_DROPPED = Fault("all connections to the RTDE port are closed")
_HUNG_UP = Fault("all connections that a program has opened are closed")

RTDE_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "robot": ROBOT_FAULTS,
    "pose": POSE_FAULTS,
    WIRE: {**PACKAGES.faults, DROPPED: _DROPPED},
    PROGRAM_WIRE: {**MESSAGES.faults, DROPPED: _HUNG_UP},
    "witness": WITNESS_FAULTS,
}
"""Faults by target."""
