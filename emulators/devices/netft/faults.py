"""Faults of a Net F/T, by target: signal, page, network and the box itself."""

from collections.abc import Mapping

from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.packets import DATAGRAMS, SENSOR_WIRE
from emulators.sensing.faults import SIGNAL_FAULTS, WRONG_SCALES
from protocol.devices.netft.records import FAMILIES

_BITS = {bit for family in FAMILIES.values() for bit in family.bits}

SENSOR_FAULTS: Mapping[str, Fault] = {
    **WRONG_SCALES,
    "unplugged": Fault("the transducer is unplugged: its status reports it, and its counts freeze", {}, 2.0),
    "slow": Fault(
        "records are sent less often",
        {"factor": Parameter(10.0, "factor of their period", 1.0, 1000.0)},
        FOREVER,
    ),
    "frozen-counter": Fault("records continue with the sample number of the first", {}, FOREVER),
    "power-cycle": Fault("it loses power, and reboots", {}),
    "status": Fault(
        "its status reports an error",
        {"bit": Parameter(8, "bit number", min(_BITS), max(_BITS))},
        FOREVER,
    ),
    "threshold": Fault("a threshold was exceeded: it warns until its latch is reset", {}),
    "saturated": Fault("its status reports saturation while its counts continue", {}, 0.05),
    "biased": Fault("another program biases it", {}),
    "taken": Fault(
        "another program takes over its stream: nothing is received until it is requested again", {}
    ),
}

NETFT_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "signal": SIGNAL_FAULTS,
    SENSOR_WIRE: DATAGRAMS.faults,
    "sensor": SENSOR_FAULTS,
}
"""Faults of the box, by target."""
