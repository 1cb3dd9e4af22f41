"""Faults of an FT 300: of its signal, its line and itself."""

from collections.abc import Mapping

from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.wire import WIRE_FAULTS
from emulators.sensing.faults import SIGNAL_FAULTS

FT300_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "signal": SIGNAL_FAULTS,
    "frames": {
        **WIRE_FAULTS,
        "unplugged": Fault(
            "the sensor's plug is pulled: it says nothing, and boots when it is back", {}, 2.0
        ),
        "slow": Fault(
            "messages are sent less often",
            {"factor": Parameter(10.0, "of their period", 1.0, 1000.0)},
            FOREVER,
        ),
    },
    "sensor": {
        "power-cycle": Fault("it loses its supply, and boots", {}),
        "refusal": Fault(
            "it answers each question with an exception",
            {"code": Parameter(4, "the exception", 1, 11)},
            FOREVER,
        ),
        "deaf": Fault("it does not hear: a stream goes on, questions are not answered", {}, FOREVER),
    },
}
"""Faults by target."""
