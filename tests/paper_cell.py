"""The cell of the paper: an S3 robot and a JR3 sensor. A configuration's section [cell] is its profile."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

from emulators.cell import Cell, CellProfile, Parts
from emulators.cell_faults import CELL_FAULTS
from emulators.devices.jr3 import (
    Board,
    Gateway,
    Jr3Profiles,
    UartGateway,
    make_board,
    make_gateway,
    make_uart,
)
from emulators.devices.s3 import EMPTY_SITE, S3Controller, S3Profiles, S3Site, make_robot
from emulators.seams import WrenchSource

Jr3Receiver: TypeAlias = Gateway | UartGateway | Board
"""A JR3 sensor with the device that reads it out."""
PaperCell: TypeAlias = Cell[S3Controller, Jr3Receiver]


@dataclass(frozen=True)
class PaperCellProfile(CellProfile, S3Profiles, Jr3Profiles):
    """Everything that the cell is made of."""


class Receiver(NamedTuple):
    """Which device reads the sensor out."""

    kind: Literal["gateway", "uart", "board"] = "gateway"
    filter_number: int = 0
    """Filter of a receiver board, 0 … 6, that the client reads."""


GATEWAY, UART, BOARD = Receiver("gateway"), Receiver("uart"), Receiver("board")

_SENSORS: Mapping[
    str, Callable[[PaperCellProfile, Receiver], Callable[[WrenchSource, float, int], Jr3Receiver]]
] = {
    "gateway": lambda profile, receiver: make_gateway(profile.sensor, profile.gateway),
    "uart": lambda profile, receiver: make_uart(profile.sensor, profile.uart_gateway),
    "board": lambda profile, receiver: make_board(profile.sensor, profile.board, receiver.filter_number),
}


def s3_jr3_cell(
    profile: PaperCellProfile,
    now: float,
    seed: int,
    site: S3Site = EMPTY_SITE,
    receiver: Receiver = GATEWAY,
) -> PaperCell:
    """A cell that is powered up at `now`, s. `site` is what the robot controller holds.

    Raises ValueError for a start outside the robot's work area, and for a program that has a wrong line.
    """
    robot = make_robot(profile, site)
    sensor = _SENSORS[receiver.kind](profile, receiver)
    return Cell(profile, now, seed, Parts(robot, sensor, faults=CELL_FAULTS))
