"""Faults of an OnRobot HEX, by target: signal, network and the sensor itself."""

from collections.abc import Mapping

from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.packets import DATAGRAMS, SENSOR_WIRE
from emulators.sensing.faults import SIGNAL_FAULTS

SENSOR_FAULTS: Mapping[str, Fault] = {
    "unplugged": Fault("the sensor is unplugged: its status reports it, and its counts freeze", {}, 2.0),
    "slow": Fault(
        "records are sent less often",
        {"factor": Parameter(10.0, "factor of their period", 1.0, 1000.0)},
        FOREVER,
    ),
    "frozen-counter": Fault("records continue with the sample number of the first", {}, FOREVER),
    "power-cycle": Fault("it loses power, and reboots with the default rate and filter", {}),
    "status": Fault("its status reports an error", {"bit": Parameter(0, "bit number", 0, 31)}, FOREVER),
    "saturated": Fault("its status reports saturation while its counts continue", {}, 0.05),
    "biased": Fault("another program switches the bias on", {}),
    "taken": Fault(
        "another program takes over its stream: nothing is received until it is requested again", {}
    ),
}

HEX_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "signal": SIGNAL_FAULTS,
    SENSOR_WIRE: DATAGRAMS.faults,
    "sensor": SENSOR_FAULTS,
}
"""Faults of the sensor, by target."""
