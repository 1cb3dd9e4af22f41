"""Faults of a NETCANOEM board, by target: signal, calibration, bus and the board itself."""

from collections.abc import Mapping

from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.packets import FRAMES, SENSOR_WIRE
from emulators.sensing.faults import SIGNAL_FAULTS, WRONG_SCALES

ATI_CAN_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "signal": SIGNAL_FAULTS,
    SENSOR_WIRE: FRAMES.faults,
    "sensor": {
        **WRONG_SCALES,
        "unplugged": Fault("the transducer is unplugged: its gages saturate, without a status", {}, 2.0),
        "power-cycle": Fault("it loses power, and reboots", {}),
        "watchdog": Fault(
            "its watchdog resets it: it boots, selects slot 0, and reports the reset in its status", {}
        ),
        "status": Fault(
            "its status reports an error, and it continues",
            {"bit": Parameter(5, "bit number", 0, 15)},
            FOREVER,
        ),
        "other-host": Fault(
            "another host selects another calibration", {"slot": Parameter(1, "slot number", 0, 15)}
        ),
    },
}
"""Faults of the board, by target."""
