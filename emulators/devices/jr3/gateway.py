"""Parts of a JR3 gateway that do not depend on its wire: sensor, firmware and faults."""

from collections.abc import Mapping
from typing import Generic

from emulators.devices.jr3.firmware import RESET, START, STOP, Firmware, Step
from emulators.devices.jr3.firmware_profile import FirmwareProfile
from emulators.devices.jr3.sensor import Jr3Sensor
from emulators.faults.ledger import Handler
from emulators.faults.packets import SENSOR_WIRE, Data, Packets
from emulators.unmodelled import Unmodelled


class AnyGateway(Generic[Data]):
    """Gateway without the protocol on its wire."""

    endpoint: Packets[Data]
    """Gateway's end of the wire."""

    def __init__(self, profile: FirmwareProfile, sensor: Jr3Sensor, seed: int) -> None:
        self.jr3 = sensor
        """Connected sensor."""
        self.unmodelled = Unmodelled("jr3")
        self._blocks = profile.blocks
        self._firmware = Firmware(sensor, profile, seed)

    @property
    def handlers(self) -> Mapping[str, Mapping[str, Handler]]:
        """Fault handlers of the receiver and the sensor, by target, for a ledger."""
        return {
            "signal": self.jr3.signal.handlers,
            SENSOR_WIRE: self.endpoint.handlers,
            "sensor": self._firmware.handlers,
        }

    def unplug(self, now: float) -> None:
        """Unplug the sensor. Idempotent."""
        self._firmware.unplug(now)

    def plug_in(self, now: float) -> None:
        """Plug the sensor in. Idempotent."""
        self._firmware.plug_in(now)

    def steps_of(self, order: str) -> tuple[Step, ...] | None:
        """Return the steps of the command with this name; None if an uninitialised gateway answers it at once."""
        if not (self._firmware.initialised or (self._blocks and order == "RESET")):
            return None
        before = self._firmware.before_stream
        steps = {"START": before, "START_ASYNC": before, "START_SYNC": START, "STOP": STOP, "RESET": RESET}
        return steps.get(order, ())

    def sampled_at(self, counter: int) -> float | None:
        """Return the time at which the sensor measured the newest sample sent with this counter, s; None if there
        is none.
        """
        return self._firmware.sampled_at(counter)

    def next_event(self) -> None:
        """Return None: a gateway has no events."""
