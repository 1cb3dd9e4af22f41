"""Settings of what stands before a JR3 sensor, as the bridge sees it."""

from dataclasses import dataclass, field

from protocol.devices.jr3 import GatewayClientProfile, UartGatewayClientProfile
from protocol.devices.jr3.registers import BoardClientProfile


@dataclass(frozen=True, slots=True)
class Jr3Settings:
    """Settings in `[sensor.jr3]`, whatever stands before the sensor."""

    gateway: GatewayClientProfile = field(default_factory=GatewayClientProfile)
    """Requests of the client to a CAN gateway."""
    board: BoardClientProfile = field(default_factory=BoardClientProfile)
    """Requests of the client to a receiver board."""
    uart: UartGatewayClientProfile = field(default_factory=UartGatewayClientProfile)
    """Requests of the client to a UART gateway."""
