"""Faults of the emulated control box, its arm, its force sensor and its cables: one table for each target."""

from collections.abc import Mapping

from emulators.arm.reported_pose import pose_faults
from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.packets import SENSOR_WIRE, WIRE
from emulators.sensing.faults import SIGNAL_FAULTS
from hil_xarm.cable import CABLE_FAULTS

ROBOT_FAULTS: Mapping[str, Fault] = {
    "emergency-stop": Fault(
        "the emergency stop is pressed, error 1, and released at the end; the error remains until it is cleared",
        {},
        FOREVER,
    ),
    "servo-error": Fault("the servo of a joint stops the arm with error 11 until it is cleared"),
    "speed-error": Fault("the arm stops with the error of a tool that is too fast in servo mode, 60 or 24"),
    "collision": Fault("the collision detection stops the arm with error 31 until it is cleared"),
    "stopped": Fault("another program sets the state to stop"),
    "paused": Fault("another program pauses the arm, and lets it move again at the end", {}, FOREVER),
    "mode-changed": Fault("another program sets the mode to position"),
    "power-cycle": Fault("the box loses power: motors off, mode position; its connections stay open"),
    "stands": Fault("the arm stops, and the box reports that it is ready", {}, FOREVER),
    "stalls": Fault(
        "now and then a command takes long, those behind it wait, and the arm stands: observed with about 190 ms",
        {
            "probability": Parameter(0.01, "probability for each command", 0.0, 1.0),
            "ms": Parameter(190.0, "duration of a stall", 0.0, 10_000.0, "ms"),
        },
        FOREVER,
    ),
    "lags": Fault(
        "the arm follows its set points later",
        {"ms": Parameter(50.0, "additional delay", 0.0, 1000.0, "ms")},
        FOREVER,
    ),
    "mute": Fault("no port sends reports; commands are answered", {}, FOREVER),
}
SENSOR_FAULTS: Mapping[str, Fault] = {
    "lost": Fault(
        "the sensor is unplugged: its values are zero, and the arm stops with error 18", {}, FOREVER
    ),
    "unreadable": Fault("the sensor cannot be read: the arm stops with error 50", {}, FOREVER),
    "saturated": Fault("all values are at the end of their range", {}, 0.05),
    "switched-off": Fault("another program switches the sensor off: its values are zero"),
    "zeroed": Fault("another program sets the zero: the external values jump"),
}

XARM_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "robot": ROBOT_FAULTS,
    "pose": pose_faults(("missing",)),
    WIRE: CABLE_FAULTS,
}
"""Faults of the robot, by target."""
FORCE_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "signal": SIGNAL_FAULTS,
    SENSOR_WIRE: CABLE_FAULTS,
    "sensor": SENSOR_FAULTS,
}
"""Faults of the force sensor, by target. Those of the wire affect the connections of the sensor's client."""
