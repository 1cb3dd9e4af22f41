"""The cell of the paper, an S3 and a JR3, made from their kinds, for tests that need a cell without a run."""

from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

from emulators.arm.compliance import ArmProfile
from emulators.cell import Cell, CellProfile, Parts
from emulators.devices.jr3 import Board, Gateway, Jr3Profiles, UartGateway
from emulators.devices.s3 import EMPTY_SITE, S3Controller, S3Profiles, S3Site, make_robot
from hil_bridge.devices.kinds import SENSORS, EmulatedKinds, KindSettings
from hil_bridge.devices.sensors.jr3.settings import Jr3Settings
from protocol.devices.jr3.registers import BoardClientProfile

Jr3Receiver: TypeAlias = Gateway | UartGateway | Board
"""JR3 sensor with its read-out device."""
PaperCell: TypeAlias = Cell[S3Controller, Jr3Receiver]
CELL_FAULTS = EmulatedKinds.named("s3", "jr3").faults
"""Faults of a cell of S3 and JR3 behind its CAN gateway, by target."""

RIGID_ARM = ArmProfile(compliance="rigid")


@dataclass(frozen=True)
class PaperCellProfile(CellProfile, S3Profiles, Jr3Profiles):
    """Complete profile of the cell. The arm is rigid: the stiffness of the surface is the paper's, that of robot and
    environment together.
    """

    arm: ArmProfile = RIGID_ARM


class Receiver(NamedTuple):
    """Device that reads the sensor out."""

    kind: str = "jr3"
    filter_number: int = 0
    """Filter of a receiver board, 0 … 6, that the client reads."""


GATEWAY, UART, BOARD = Receiver("jr3"), Receiver("jr3-uart"), Receiver("jr3-board")


def s3_jr3_cell(
    profile: PaperCellProfile,
    now: float,
    seed: int,
    site: S3Site = EMPTY_SITE,
    receiver: Receiver = GATEWAY,
) -> PaperCell:
    """Return a cell that is powered up at `now`, s. `site` is the content of the robot controller.

    Raises ValueError for a start outside the robot's work area, and for a program with an invalid line.
    """
    emulation = SENSORS.kind(receiver.kind).emulation
    assert emulation is not None
    client = Jr3Settings(board=BoardClientProfile(filter=receiver.filter_number))
    sensor = emulation.make(KindSettings(client, profile))
    faults = EmulatedKinds.named("s3", receiver.kind).faults
    return Cell(profile, now, seed, Parts(make_robot(profile, site), sensor, faults=faults))  # type: ignore[arg-type]
