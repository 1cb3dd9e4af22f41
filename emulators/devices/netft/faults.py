"""Faults of a Net F/T: of its signal, its page, its network and itself."""

from collections.abc import Mapping

from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.wire import WIRE_FAULTS
from emulators.sensing.faults import SCALES_FAULTS, SIGNAL_FAULTS
from protocol.devices.netft.records import STATUS_BITS

FRAMES_FAULTS: Mapping[str, Fault] = {
    **WIRE_FAULTS,
    "unplugged": Fault("the transducer's plug is pulled: its status says so, its counts freeze", {}, 2.0),
    "slow": Fault(
        "records are sent less often", {"factor": Parameter(10.0, "of their period", 1.0, 1000.0)}, FOREVER
    ),
    "frozen-counter": Fault("records go on with the sample number of the first", {}, FOREVER),
}

SENSOR_FAULTS: Mapping[str, Fault] = {
    "power-cycle": Fault("it loses its supply, and boots", {}),
    "status": Fault(
        "it tells an error in its status",
        {"bit": Parameter(8, "number of the bit", min(STATUS_BITS), max(STATUS_BITS))},
        FOREVER,
    ),
    "threshold": Fault("a threshold was passed: it warns until its latch is reset", {}),
    "saturated": Fault("its status tells of saturation while its counts go on", {}, 0.05),
    "biased": Fault("another program biases it", {}),
    "taken": Fault("another program takes its stream: nothing comes until it is asked for again", {}),
}

NETFT_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "signal": SIGNAL_FAULTS,
    "scales": SCALES_FAULTS,
    "frames": FRAMES_FAULTS,
    "sensor": SENSOR_FAULTS,
}
"""Faults by target."""
