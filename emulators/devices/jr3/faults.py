"""Faults of a JR3 sensor and its receivers: one table for each receiver, by target."""

from collections.abc import Mapping
from typing import Any

from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.packets import BYTES, FRAMES, SENSOR_WIRE, Pieces
from emulators.sensing.faults import SIGNAL_FAULTS, WRONG_SCALES

FIRST, SECOND = "first", "second"
"""Sensors that can be plugged in."""


def _unplugging_fault(choices: tuple[str, ...], meaning: str) -> Fault:
    return Fault(
        "the sensor is unplugged from its receiver",
        {"sensor": Parameter(FIRST, meaning, choices=choices)},
        2.0,
    )


def _of_gateway(pieces: Pieces[Any]) -> Mapping[str, Mapping[str, Fault]]:
    return {
        "signal": SIGNAL_FAULTS,
        SENSOR_WIRE: pieces.faults,
        "sensor": {
            **WRONG_SCALES,
            "unplugged": _unplugging_fault((FIRST,), "sensor that is plugged in at the end"),
            "slow": Fault(
                "samples are sent less often",
                {"factor": Parameter(10.0, "factor of their period", 1.0, 1000.0)},
                FOREVER,
            ),
            "frozen-counter": Fault("samples continue with the counter of the first", {}, FOREVER),
        },
    }


CAN_GATEWAY_FAULTS, UART_GATEWAY_FAULTS = _of_gateway(FRAMES), _of_gateway(BYTES)
"""Faults of a sensor behind a gateway, by target."""

BOARD_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "signal": SIGNAL_FAULTS,
    "sensor": {
        **WRONG_SCALES,
        "unplugged": _unplugging_fault((FIRST, SECOND), "sensor that is plugged in at the end"),
    },
}
"""Faults of a sensor at a receiver board, by target. A host reads the board; there is no stream."""
