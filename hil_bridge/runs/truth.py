"""Ground truth of each cycle, which an emulated cell knows but its devices do not report; only for the recording."""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from emulators.cell import Cell, TrueState
from hil_bridge.record import CycleRecord, TruthRecord
from hil_bridge.record.removed_map import RemovedMap, pack_map

_AT_ONCE = 16
"""Number of cycles that are queried together, unless the surface would discard their state first. Chosen: a fifth
of the cost of single queries, and about a millisecond at a time.
"""
_PATIENCE_S = 1.0
"""Time after which cycles are queried even if there are fewer, s. Chosen: a viewer of the run hardly notices it, and it
is a tenth of the history that the cell's motion keeps.
"""
_IN_TRANSIT = 0.25
"""Part of a packet's period after which the answer to the previous packet has reached the robot. Chosen: many times the
latency of a local network at 500 Hz, and the rest of the period is left to decide in.
"""


@dataclass(frozen=True, slots=True)
class _Cycle:
    """Cycle whose ground truth is yet to be queried."""

    number: int
    at: float
    sampled_at: float
    ordered_by: float
    """Time by which the target of the cycle has arrived, s; with a streaming robot, the target before it."""


_NO_JOINTS = (math.nan,) * 6
"""Joints of a robot that reports no joints."""
_NO_NORMAL = _NO_VECTOR = (math.nan, math.nan, math.nan)
"""Normal of a surface that reports no normal."""
_NO_STATE = TrueState(_NO_VECTOR, _NO_VECTOR, (math.nan,) * 4, _NO_VECTOR, None, deflection=_NO_VECTOR)
"""State that is not queried."""


class GroundTruth:
    """Queries of the cell for several cycles at a time, once the start of the last cycle's motion is known.

    `sensor_is_emulated` is True if the sensor of the run belongs to the cell. `packet_s` is the time between two
    packets of a robot that sets the cycle, s, and 0 for another: the first target that carries the decision of a
    cycle is the target that answers the next packet. Without `with_states`, only the times are queried, and the
    states are NaN.
    """

    def __init__(
        self,
        cell: Cell[Any, Any],
        sensor_is_emulated: bool,
        put: Callable[[TruthRecord], object],
        packet_s: float = 0.0,
        with_states: bool = True,
    ) -> None:
        self._cell = cell
        self._packet_s = packet_s
        self._sensor_is_emulated = sensor_is_emulated
        self._with_states = with_states
        self._put = put
        self._cycles: list[_Cycle] = []
        self._waiting: deque[tuple[_Cycle, TrueState]] = deque()

    def cycle(self, record: CycleRecord) -> None:
        """Handle the end of a cycle, when no further order is pending."""
        cell, cycles = self._cell, self._cycles
        cell.robot.path.advance(record.answered_at)
        sampled_at = cell.sensor.sampled_at(record.sensor_counter) if self._sensor_is_emulated else None
        cycles.append(
            _Cycle(
                record.cycle,
                cell.truth_available_from(record.answered_at),
                math.nan if sampled_at is None else sampled_at,
                record.answered_at + _IN_TRANSIT * self._packet_s,
            )
        )
        late = cycles[-1].at - cycles[0].at > _PATIENCE_S
        if late or cell.has_memory or len(cycles) >= _AT_ONCE:
            self._ask()
            self._query()

    def removed_map(self) -> RemovedMap | None:
        """Return the map of depths that the tool has removed from the surface; None if it has removed nothing."""
        removed = self._cell.removed
        if removed is None or not removed.depths.any():
            return None
        return pack_map(*removed)

    def close(self) -> None:
        """Write the remaining cycles at the end of the run, as far as known."""
        self._ask()
        self._query(everything=True)

    def _ask(self) -> None:
        cycles, self._cycles = self._cycles, []
        if not cycles:
            return
        states = [_NO_STATE] * len(cycles)
        if self._with_states:
            states = self._cell.true_states([cycle.at for cycle in cycles])
        self._waiting.extend(zip(cycles, states, strict=True))

    def _query(self, everything: bool = False) -> None:
        robot, waiting = self._cell.robot, self._waiting
        while waiting:
            cycle, state = waiting[0]
            target = robot.targets.arrived_by(cycle.ordered_by) + bool(self._packet_s)
            begun = robot.targets.begun_at(target)
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
                    joints_deg=tuple(map(math.degrees, state.joints or _NO_JOINTS)),
                    faults=self._cell.ledger.active(cycle.at),
                    quaternion=state.quaternion,
                    normal=state.normal or _NO_NORMAL,
                    deflection=state.deflection,
                )
            )
