"""Faults of the emulated controller and of its connections: one table a target."""

from collections.abc import Mapping

from emulators.arm.own_force import WITNESS_FAULTS
from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.wire import WIRE_FAULTS

ROBOT_FAULTS: Mapping[str, Fault] = {
    "protective-stop": Fault("a protective stop; it is not unlocked by itself"),
    "emergency-stop": Fault("the emergency stop is pressed, and released at the end", {}, FOREVER),
    "safeguard-stop": Fault("a safeguard opens, and closes at the end", {}, FOREVER),
    "local-control": Fault("it is switched to local control, and back at the end", {}, FOREVER),
    "program-stopped": Fault("the program is stopped"),
    "program-paused": Fault("the program is paused"),
    "power-off": Fault("the arm's power is switched off"),
    "slider": Fault(
        "the speed slider is put down, and back up at the end",
        {"percent": Parameter(40.0, "where it stands", 0.0, 100.0, "%")},
        FOREVER,
    ),
}

CONNECTION_FAULTS: Mapping[str, Fault] = {
    "dropped": Fault("all connections to the RTDE port are closed"),
    "mute": Fault("no data packet is sent", {}, FOREVER),
    "deaf": Fault("input packages are lost", {}, FOREVER),
    "late": Fault("data packets come late", {"ms": Parameter(20.0, "how late", 0.0, 5000.0, "ms")}, 5.0),
    "lost": Fault("the next data packets are lost", {"count": Parameter(1, "how many in a row", 1, 1000)}),
    "in-use": Fault("another client holds the registers of our program", {}, FOREVER),
}

POSE_FAULTS: Mapping[str, Fault] = {
    "nan": Fault("the reported pose is no number", {}, FOREVER),
    "frozen": Fault("the reported pose stays as it is", {}, FOREVER),
    "offset": Fault(
        "the reported place is off; the arm stays where it is",
        {
            f"{axis}_mm": Parameter(0.0, f"by how much along base {axis}", -2000.0, 2000.0, "mm")
            for axis in "xyz"
        },
        FOREVER,
        amounts=("x_mm", "y_mm", "z_mm"),
    ),
}

RTDE_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "robot": ROBOT_FAULTS,
    "link": WIRE_FAULTS,
    "connection": CONNECTION_FAULTS,
    "pose": POSE_FAULTS,
    "witness": WITNESS_FAULTS,
}
"""Faults by target."""
