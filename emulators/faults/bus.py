"""Definitions of the faults of a CAN bus, which the in-memory bus carries out."""

from collections.abc import Mapping

from emulators.faults.kinds import FOREVER, Fault, Parameter

BUS_FAULTS: Mapping[str, Fault] = {
    "off": Fault("every frame is destroyed, until its sender goes bus-off", {}, 0.2),
    "errors": Fault(
        "bits are read incorrectly: frames are destroyed and sent again",
        {"rate": Parameter(0.001, "probability of each bit", 1e-9, 0.5)},
        FOREVER,
    ),
    "babble": Fault(
        "another node sends frames that win every arbitration",
        {"period_ms": Parameter(0.13, "time between two frames", 0.01, 1000.0, "ms")},
        0.2,
    ),
}
