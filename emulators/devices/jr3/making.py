"""Factories of JR3 sensors, with each of their receivers, for a cell."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeAlias

from emulators.devices.jr3.board import Board, BoardProfile
from emulators.devices.jr3.can_gateway import Gateway, GatewayProfile
from emulators.devices.jr3.sensor import Jr3Sensor, SensorProfile
from emulators.devices.jr3.uart_gateway import UartGateway, UartGatewayProfile
from emulators.seams import WrenchSource
from protocol.geometry import Vector


@dataclass(frozen=True)
class Jr3Profiles:
    """Settings of a JR3 sensor and its receivers: section `[cell.jr3]`."""

    sensor: SensorProfile = field(default_factory=SensorProfile)
    gateway: GatewayProfile = field(default_factory=GatewayProfile)
    uart: UartGatewayProfile = field(default_factory=UartGatewayProfile)
    board: BoardProfile = field(default_factory=BoardProfile)

    @property
    def stiffness_n_m(self) -> Vector:
        """Stiffness of the sensor; see `emulators.seams.SensorStiffness`."""
        return self.sensor.stiffness_n_m

    @property
    def stiffness_nm_rad(self) -> Vector:
        """Stiffness of the sensor; see `emulators.seams.SensorStiffness`."""
        return self.sensor.stiffness_nm_rad


GatewayFactory: TypeAlias = Callable[[WrenchSource, float, int], Gateway]
UartFactory: TypeAlias = Callable[[WrenchSource, float, int], UartGateway]
BoardFactory: TypeAlias = Callable[[WrenchSource, float, int], Board]


def make_gateway(sensor: SensorProfile, gateway: GatewayProfile) -> GatewayFactory:
    """Return a factory of sensors behind a CAN gateway: `emulators.seams.SensorFactory`."""
    return lambda source, now, seed: Gateway(gateway, Jr3Sensor(sensor, source, seed, now), now, seed)


def make_uart(sensor: SensorProfile, gateway: UartGatewayProfile) -> UartFactory:
    """Return a factory of sensors behind a UART gateway."""
    return lambda source, now, seed: UartGateway(gateway, Jr3Sensor(sensor, source, seed, now), now, seed)


def make_board(sensor: SensorProfile, board: BoardProfile, filter_number: int = 0) -> BoardFactory:
    """Return a factory of sensors behind a receiver board. A client reads the filter with this number, 0 … 6."""
    return lambda source, now, seed: Board(board, Jr3Sensor(sensor, source, seed, now), now, filter_number)
