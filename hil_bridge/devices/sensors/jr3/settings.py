"""Settings of the gateway or receiver of a JR3 sensor, for the client."""

from dataclasses import dataclass, field

from protocol.devices.jr3 import GatewayClientProfile, UartGatewayClientProfile
from protocol.devices.jr3.registers import BoardClientProfile


@dataclass(frozen=True, slots=True)
class Jr3Settings:
    """Settings in `[sensor.jr3]`, for any gateway or receiver."""

    gateway: GatewayClientProfile = field(default_factory=GatewayClientProfile)
    """Requests of the client to a CAN gateway."""
    board: BoardClientProfile = field(default_factory=BoardClientProfile)
    """Requests of the client to a receiver board."""
    uart: UartGatewayClientProfile = field(default_factory=UartGatewayClientProfile)
    """Requests of the client to a UART gateway."""
