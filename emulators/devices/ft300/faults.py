"""Faults of an FT 300, by target: signal, line and the sensor itself."""

from collections.abc import Mapping

from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.packets import BYTES, SENSOR_WIRE, packages
from emulators.sensing.faults import SIGNAL_FAULTS
from protocol.devices.ft300.urcap import split_texts

TEXTS = packages("texts", split_texts)
"""Texts of a URCap on its wire, as the units to which faults apply."""

FT300_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "signal": SIGNAL_FAULTS,
    SENSOR_WIRE: BYTES.faults,
    "sensor": {
        "unplugged": Fault(
            "the sensor is unplugged: it is silent, and reboots when it is plugged in again", {}, 2.0
        ),
        "slow": Fault(
            "messages are sent less often",
            {"factor": Parameter(10.0, "factor of their period", 1.0, 1000.0)},
            FOREVER,
        ),
        "power-cycle": Fault("it loses power, and reboots", {}),
        "refuses": Fault(
            "it answers each request with an exception",
            {"code": Parameter(4, "exception code", 1, 11)},
            FOREVER,
        ),
    },
}
"""Faults of a directly connected FT 300, by target."""

URCAP_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "signal": SIGNAL_FAULTS,
    SENSOR_WIRE: TEXTS.faults,
    "sensor": {
        "unplugged": Fault(
            "the sensor is unplugged: its newest value is repeated, then no text is sent until it is found again",
            {},
            2.0,
        ),
        "slow": Fault(
            "the sensor measures less often, and its newest value is repeated",
            {"factor": Parameter(10.0, "factor of its period", 1.0, 1000.0)},
            FOREVER,
        ),
        "power-cycle": Fault("it loses power, reboots, and is found again", {}),
    },
}
"""Faults of an FT 300 behind its URCap, by target."""
