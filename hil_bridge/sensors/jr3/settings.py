"""Settings of what stands before a JR3 sensor, as the bridge sees it."""

from pydantic import BaseModel

from protocol.jr3 import GatewayClientProfile, UartGatewayClientProfile
from protocol.jr3.registers import BoardClientProfile


class Jr3Settings(BaseModel):
    """What stands in `[sensor]` for a JR3."""

    gateway: GatewayClientProfile = GatewayClientProfile()
    """What the client asks of a CAN gateway."""
    board: BoardClientProfile = BoardClientProfile()
    """What the client asks of a receiver board."""
    uart: UartGatewayClientProfile = UartGatewayClientProfile()
    """What the client asks of a UART gateway."""
