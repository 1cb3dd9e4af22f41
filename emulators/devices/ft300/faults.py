"""Faults of an FT 300: of its signal, its line and itself."""

from collections.abc import Mapping

from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.packets import BYTES, SENSOR_WIRE, packages
from emulators.sensing.faults import SIGNAL_FAULTS
from protocol.devices.ft300.urcap import split_texts

TEXTS = packages("texts", split_texts)
"""The texts of a URCap, on its wire."""

FT300_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "signal": SIGNAL_FAULTS,
    SENSOR_WIRE: BYTES.faults,
    "sensor": {
        "unplugged": Fault(
            "the sensor's plug is pulled: it says nothing, and boots when it is back", {}, 2.0
        ),
        "slow": Fault(
            "messages are sent less often",
            {"factor": Parameter(10.0, "of their period", 1.0, 1000.0)},
            FOREVER,
        ),
        "power-cycle": Fault("it loses its supply, and boots", {}),
        "refuses": Fault(
            "it answers each question with an exception",
            {"code": Parameter(4, "the exception", 1, 11)},
            FOREVER,
        ),
    },
}
"""Faults by target."""

URCAP_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "signal": SIGNAL_FAULTS,
    SENSOR_WIRE: TEXTS.faults,
    "sensor": {
        "unplugged": Fault(
            "the sensor's plug is pulled: its newest value is repeated, then no text comes until it is found again",
            {},
            2.0,
        ),
        "slow": Fault(
            "the sensor measures less often, and its newest value is repeated",
            {"factor": Parameter(10.0, "of its period", 1.0, 1000.0)},
            FOREVER,
        ),
        "power-cycle": Fault("it loses its supply, boots, and is found again", {}),
    },
}
"""Faults of an FT 300 behind its URCap, by target."""
