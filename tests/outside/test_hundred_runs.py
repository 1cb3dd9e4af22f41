"""Study as a user writes it: a hundred runs in one process, whose memory does not grow."""

from pathlib import Path

import pytest

import hil_bridge

pytestmark = pytest.mark.full

NEAR = {"start_position_mm": [900.0, -100.0, 590.5]}  # just above the surface
SHORT = {"run": {"duration_s": 0.3}, "task": {"retract_speed_mm_s": 20.0, "retract_mm": 2.0}, "cell": NEAR}


def resident_bytes() -> int:
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * 4096


def test_hundred_runs_do_not_leak_memory() -> None:
    largest, resident = [], []
    for seed in range(100):
        result = hil_bridge.simulate(SHORT, seed=seed)
        assert result.outcome == "completed"
        largest.append(result.arrays.force.max())
        resident.append(resident_bytes())
    assert 1.0 < max(largest) < 20.0
    assert max(resident[50:]) - max(resident[10:50]) < 8_000_000, resident
