"""Words for the faults of a CAN bus; the bus in memory carries them out."""

from collections.abc import Mapping

from emulators.faults.kinds import FOREVER, Fault, Parameter

BUS_FAULTS: Mapping[str, Fault] = {
    "off": Fault("every frame is destroyed, until its sender leaves the bus", {}, 0.2),
    "errors": Fault(
        "bits are read wrong: frames are destroyed and sent again",
        {"rate": Parameter(0.001, "probability of each bit", 1e-9, 0.5)},
        FOREVER,
    ),
    "babble": Fault(
        "another node sends frames that win every arbitration",
        {"period_ms": Parameter(0.13, "from one to the next", 0.01, 1000.0, "ms")},
        0.2,
    ),
}
