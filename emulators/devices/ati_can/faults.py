"""Faults of a NETCANOEM board: of its signal, its calibration, its bus and itself."""

from collections.abc import Mapping

from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.packets import FRAMES, SENSOR_WIRE
from emulators.sensing.faults import SIGNAL_FAULTS, WRONG_SCALES

ATI_CAN_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "signal": SIGNAL_FAULTS,
    SENSOR_WIRE: FRAMES.faults,
    "sensor": {
        **WRONG_SCALES,
        "unplugged": Fault(
            "the transducer's plug is pulled: its gages go to an end, without a status", {}, 2.0
        ),
        "power-cycle": Fault("it loses its supply, and boots", {}),
        "watchdog": Fault("its watchdog resets it: it boots, chooses slot 0, and tells it in its status", {}),
        "status": Fault(
            "it tells an error in its status, and continues",
            {"bit": Parameter(5, "number of the bit", 0, 15)},
            FOREVER,
        ),
        "other-host": Fault(
            "another host chooses another calibration", {"slot": Parameter(1, "which", 0, 15)}
        ),
    },
}
"""Faults by target."""
