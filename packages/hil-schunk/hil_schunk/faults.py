"""Faults of a SCHUNK FTS, by target: signal, network and the sensor itself."""

from collections.abc import Mapping

from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.packets import DATAGRAMS, SENSOR_WIRE
from emulators.sensing.faults import SIGNAL_FAULTS

SENSOR_FAULTS: Mapping[str, Fault] = {
    "unplugged": Fault(
        "the sensor is unplugged from its box: the status reports a hardware fault, and the values freeze",
        {},
        2.0,
    ),
    "slow": Fault(
        "packets are sent less often",
        {"factor": Parameter(10.0, "factor of their period", 1.0, 1000.0)},
        FOREVER,
    ),
    "frozen-counter": Fault("packets continue with the counter of the first", {}, FOREVER),
    "power-cycle": Fault("it loses power, and reboots: its connections stay open and are not answered", {}),
    "status": Fault(
        "its status reports a fault, or with bit 0 that it is not ready",
        {"bit": Parameter(3, "bit number", 0, 5)},
        FOREVER,
    ),
    "saturated": Fault("its status reports an overload while its values continue", {}, 0.05),
    "tared": Fault("another program tares it", {}),
    "taken": Fault("another program takes over its stream: nothing arrives until it is requested again", {}),
    "refusing": Fault(
        "it answers every command with an error",
        {"error": Parameter(3, "error code", 1, 255)},
        FOREVER,
    ),
    "short-answers": Fault("its answers are cut off, as while it boots", {}, 2.0),
}

FTS_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "signal": SIGNAL_FAULTS,
    SENSOR_WIRE: DATAGRAMS.faults,
    "sensor": SENSOR_FAULTS,
}
"""Faults of the sensor, by target. Faults of the wire affect the packets. A cut cable, and a device that is mute or
deaf, affect the commands too; TCP repairs everything else.
"""
