"""What an emulated cell knows of each cycle, put beside what its devices told; for the record alone."""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import replace

from emulators.cell import Cell
from hil_bridge.recording import CycleRecord, TruthRecord


class Truths:
    """Asks the cell once a cycle, and puts a record once it is known when the cycle's motion began.

    `sensor` says whether the run's sensor is the cell's too.
    """

    def __init__(self, cell: Cell, sensor: bool, put: Callable[[TruthRecord], object]) -> None:
        self._cell = cell
        self._sensor = sensor
        self._put = put
        self._waiting: deque[tuple[int, TruthRecord]] = deque()
        """With the number that the robot gave to the point of the cycle."""

    def cycle(self, record: CycleRecord) -> None:
        """A cycle has just ended, and no further order is under way."""
        cell = self._cell
        self._tell()
        truth = cell.true_state(record.answered_at)
        sampled_at = cell.gateway.sampled_at(record.sensor_counter) if self._sensor else None
        joints = tuple(math.degrees(angle) for angle in truth.joints)
        self._waiting.append(
            (
                cell.robot.motion.accepted,
                TruthRecord(
                    cycle=record.cycle,
                    at=record.answered_at,
                    sampled_at=math.nan if sampled_at is None else sampled_at,
                    motion_at=math.nan,
                    position=truth.position,
                    force=truth.contact_force,
                    joints_deg=joints,
                ),
            )
        )

    def close(self) -> None:
        """The run is over: put what is still waiting, as far as it is known."""
        self._tell()
        while self._waiting:
            self._put(self._waiting.popleft()[1])

    def _tell(self) -> None:
        motion = self._cell.robot.motion
        while self._waiting and (begun := motion.begun_at(self._waiting[0][0])) is not None:
            self._put(replace(self._waiting.popleft()[1], motion_at=begun))
