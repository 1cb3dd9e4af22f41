"""Client settings for the gateway or receiver of a JR3 sensor."""

from dataclasses import dataclass, field

from protocol.devices.jr3 import GatewayClientProfile, UartGatewayClientProfile
from protocol.devices.jr3.registers import BoardClientProfile


@dataclass(frozen=True, slots=True)
class Jr3Settings:
    """Settings in the section `[sensor.jr3]`, for any gateway or receiver."""

    gateway: GatewayClientProfile = field(default_factory=GatewayClientProfile)
    """Settings of the client's requests to a CAN gateway."""
    board: BoardClientProfile = field(default_factory=BoardClientProfile)
    """Settings of the client's requests to a receiver board."""
    uart: UartGatewayClientProfile = field(default_factory=UartGatewayClientProfile)
    """Settings of the client's requests to a UART gateway."""
