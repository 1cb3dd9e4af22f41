"""Emulated JR3 force/torque sensor and its receivers."""

from emulators.devices.jr3.board import Board, BoardProfile
from emulators.devices.jr3.can_gateway import Gateway, GatewayProfile
from emulators.devices.jr3.making import Jr3Profiles, make_board, make_gateway, make_uart
from emulators.devices.jr3.sensor import Jr3Sensor, SensorProfile
from emulators.devices.jr3.uart_gateway import UartGateway, UartGatewayProfile

__all__ = [
    "Board",
    "BoardProfile",
    "Gateway",
    "GatewayProfile",
    "Jr3Profiles",
    "Jr3Sensor",
    "SensorProfile",
    "UartGateway",
    "UartGatewayProfile",
    "make_board",
    "make_gateway",
    "make_uart",
]
