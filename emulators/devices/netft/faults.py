"""Faults of a Net F/T: of its signal, its page, its network and itself."""

from collections.abc import Mapping

from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.packets import DATAGRAMS, SENSOR_WIRE
from emulators.sensing.faults import SIGNAL_FAULTS, WRONG_SCALES
from protocol.devices.netft.records import FAMILIES

_BITS = {bit for family in FAMILIES.values() for bit in family.bits}

SENSOR_FAULTS: Mapping[str, Fault] = {
    **WRONG_SCALES,
    "unplugged": Fault("the transducer's plug is pulled: its status says so, its counts freeze", {}, 2.0),
    "slow": Fault(
        "records are sent less often", {"factor": Parameter(10.0, "of their period", 1.0, 1000.0)}, FOREVER
    ),
    "frozen-counter": Fault("records continue with the sample number of the first", {}, FOREVER),
    "power-cycle": Fault("it loses its supply, and boots", {}),
    "status": Fault(
        "it tells an error in its status",
        {"bit": Parameter(8, "number of the bit", min(_BITS), max(_BITS))},
        FOREVER,
    ),
    "threshold": Fault("a threshold was passed: it warns until its latch is reset", {}),
    "saturated": Fault("its status tells of saturation while its counts continue", {}, 0.05),
    "biased": Fault("another program biases it", {}),
    "taken": Fault("another program takes its stream: nothing comes until it is asked for again", {}),
}

NETFT_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "signal": SIGNAL_FAULTS,
    SENSOR_WIRE: DATAGRAMS.faults,
    "sensor": SENSOR_FAULTS,
}
"""Faults by target."""
