"""What an emulated cell knows of each cycle, put beside what its devices told; for the record alone."""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from emulators.cell import Cell, TrueState
from hil_bridge.settings.configuration import SensorConfig
from hil_bridge.recording import CycleRecord, TruthRecord

_AT_ONCE = 8
"""Cycles that are asked for together, unless the material would have forgotten. Chosen: a third of the cost of one
each, and less than a millisecond at a time.
"""
_PATIENCE_S = 5.0
"""After which they are asked for anyway. Chosen: half of what the cell's motion keeps of its past."""


@dataclass(frozen=True, slots=True)
class _Cycle:
    """A cycle of which the truth is to be told."""

    number: int
    at: float
    sampled_at: float
    point: int
    """The number that the robot gave to the point that the cycle ordered."""


def _sample_times(cell: Cell, sensor: SensorConfig) -> Callable[[int], float | None]:
    """When the cell's sensor measured the sample with a device's counter, s; None where nobody knows."""
    if sensor.url:
        return lambda counter: None
    match sensor.emulated:
        case "gateway":
            return cell.gateway.sampled_at
        case "uart":
            return cell.uart_gateway.sampled_at
        case "board":
            return partial(cell.board.sampled_at, sensor.board.filter)


class Truths:
    """Asks the cell for some cycles at a time, once it is known when the motion of the last of them began.

    `sensor` is the run's, which may be another than the cell's.
    """

    def __init__(self, cell: Cell, sensor: SensorConfig, put: Callable[[TruthRecord], object]) -> None:
        self._cell = cell
        self._sampled_at = _sample_times(cell, sensor)
        self._put = put
        self._cycles: list[_Cycle] = []
        self._waiting: deque[tuple[_Cycle, TrueState]] = deque()

    def cycle(self, record: CycleRecord) -> None:
        """A cycle has just ended, and no further order is under way."""
        cell, cycles = self._cell, self._cycles
        cell.robot.motion.path.advance(record.answered_at)
        sampled_at = self._sampled_at(record.sensor_counter)
        cycles.append(
            _Cycle(
                record.cycle,
                cell.tellable_from(record.answered_at),
                math.nan if sampled_at is None else sampled_at,
                cell.robot.motion.path.accepted,
            )
        )
        late = cycles[-1].at - cycles[0].at > _PATIENCE_S
        if late or cell.remembers or len(cycles) >= _AT_ONCE:
            self._ask()
            self._tell()

    def close(self) -> None:
        """The run is over: put what is still waiting, as far as it is known."""
        self._ask()
        self._tell(everything=True)

    def _ask(self) -> None:
        cycles, self._cycles = self._cycles, []
        if not cycles:
            return
        for cycle, state in zip(cycles, self._cell.true_states([cycle.at for cycle in cycles]), strict=True):
            self._waiting.append((cycle, state))

    def _tell(self, everything: bool = False) -> None:
        motion, waiting = self._cell.robot.motion.path, self._waiting
        while waiting:
            cycle, state = waiting[0]
            begun = motion.begun_at(cycle.point)
            if begun is None and not everything:
                return
            waiting.popleft()
            motion_at = math.nan if begun is None else begun
            self._put(
                TruthRecord(
                    cycle=cycle.number,
                    at=cycle.at,
                    sampled_at=cycle.sampled_at,
                    motion_at=motion_at,
                    position=state.position,
                    force=state.contact_force,
                    joints_deg=tuple(map(math.degrees, state.joints)),
                    faults=self._cell.ledger.active(cycle.at),
                )
            )
