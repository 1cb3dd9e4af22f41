"""Faults of a JR3 sensor and its receivers: one table a target."""

from collections.abc import Mapping

from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.wire import WIRE_FAULTS
from emulators.sensing.faults import SCALES_FAULTS, SIGNAL_FAULTS

FIRST, SECOND = "first", "second"
"""The sensors that can be plugged in."""

PLUG_FAULTS: Mapping[str, Fault] = {
    "unplugged": Fault(
        "the sensor's plug is pulled off its receiver",
        {
            "sensor": Parameter(
                FIRST, "which is plugged in then; the second at a board alone", choices=(FIRST, SECOND)
            )
        },
        2.0,
    )
}
"""Of every receiver; a board, which is read and streams nothing, has no other faults of its frames."""

FRAMES_FAULTS: Mapping[str, Fault] = {
    **WIRE_FAULTS,
    **PLUG_FAULTS,
    "slow": Fault(
        "samples are sent less often", {"factor": Parameter(10.0, "of their period", 1.0, 1000.0)}, FOREVER
    ),
    "frozen-counter": Fault("samples go on with the counter of the first", {}, FOREVER),
}

JR3_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "signal": SIGNAL_FAULTS,
    "scales": SCALES_FAULTS,
    "frames": FRAMES_FAULTS,
}
"""Faults by target."""
