"""Sampling of a run's true force, and the recovery time after a fault."""

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from hil_bridge.api import Simulation
from hil_bridge.lab.invariants import Trace
from hil_bridge.record import Recording
from hil_bridge.record.analysis.strokes import TRACK
from hil_bridge.record.analysis.summary import phases

WATCH_S = 0.01
"""Sampling period of the true force, s. Chosen."""
WATCH_AT_ONCE = 20
"""Maximum number of samples computed in one call. Chosen: many samples cost little more than one."""
RECOVERED_SHARE = 0.2
"""Tolerance of the true force after a recovery, as a share of the target force. Chosen: larger than the overshoot
of a rise.
"""

_Floats = npt.NDArray[np.float64]


class Watch:
    """Sampler of the true force of an emulated cell."""

    def __init__(self, running: Simulation, every_s: float = WATCH_S) -> None:
        """Create a sampler. `every_s` is the sampling period, s."""
        assert running.cell is not None  # the plan has neither a real robot nor a real sensor
        self._cell = running.cell
        self._clock = running.clock
        self._every_s = every_s
        self._until = self._clock.now()
        self._times: list[_Floats] = []
        self._forces: list[_Floats] = []
        self._positions: list[_Floats] = []

    async def watch(self) -> None:
        """Sample until cancelled."""
        wait_s = self._every_s * (1 if self._cell.has_memory else WATCH_AT_ONCE)
        while True:
            await self._clock.sleep_until(self._clock.now() + wait_s)
            self.sample()

    def sample(self) -> None:
        """Add samples for the time from the last call until now, at most WATCH_AT_ONCE of them."""
        end = self._clock.now()
        if self._cell.has_memory:  # the cell cannot compute past states
            times = np.array([self._cell.truth_available_from(end)])
        else:
            moments = min(max(round((end - self._until) / self._every_s), 1), WATCH_AT_ONCE)
            times = end - self._every_s * np.arange(moments - 1, -1, -1)
        self._until = end
        self._times.append(times)
        self._forces.append(self._cell.contact_forces(times))
        self._positions.append(self._cell.path.trajectory(times)[0])

    def truth(self) -> tuple[_Floats, _Floats]:
        """Return the sample times, s, and the magnitudes of the true contact force, N, both (n,)."""
        return np.concatenate(self._times), np.linalg.norm(np.concatenate(self._forces), axis=1)

    def trace(self) -> Trace:
        """Return the samples with positions and force vectors, for the invariant checkers."""
        return Trace(*self.truth(), np.concatenate(self._positions), np.concatenate(self._forces))

    def fault_ends(self) -> list[float]:
        """Return the time at which each fault ended, s; infinity for a fault that lasted to the end of the run."""
        ends: list[float] = []
        for fault in self._cell.faults:
            if fault.target == "computer":  # reported in advance, since the process is frozen
                ends.append(fault.injected_at + fault.number("seconds"))
            else:
                end = fault.ends_at if fault.ended_at is None else fault.ended_at
                ends.append(math.inf if end is None else end)
        return ends


def recovery_s(recording: Recording, ends: Sequence[float], times: _Floats, forces: _Floats) -> float | None:
    """Return the time that the true force takes to settle after the last fault has ended, s.

    The force has settled once it stays within RECOVERED_SHARE of the target force for the rest of the tracking.
    Infinity if it does not settle; None if no fault ended while tracking.
    """
    end = max(ends, default=math.inf)
    last = next(
        (span.end for span in phases(recording) if span.name == TRACK and span.begin <= end < span.end), None
    )
    cycles = [cycle for cycle in recording.cycles if cycle.phase == TRACK]
    if last is None or not cycles:
        return None
    chosen = (times > end) & (times <= last)
    if not chosen.any():
        return None
    moments = times[chosen]
    newest = np.searchsorted([cycle.started_at for cycle in cycles], moments, side="right") - 1
    target = np.array([cycle.force_reference for cycle in cycles])[np.maximum(newest, 0)]
    (outside,) = np.nonzero(np.abs(forces[chosen] - target) > RECOVERED_SHARE * np.abs(target))
    if len(outside) == 0:
        return 0.0
    after = int(outside[-1]) + 1
    return float(moments[after]) - end if after < len(moments) else math.inf
