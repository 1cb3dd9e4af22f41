"""Recovery time of the true force after a fault."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from emulators.faults import Injection
from hil_bridge.api import Config
from hil_bridge.lab.campaign.judging import run
from hil_bridge.lab.campaign.watching import Watch, recovery_s
from hil_bridge.record import Recording
from hil_bridge.settings.configuration import read_config


@pytest.fixture(scope="module")
def tracked() -> Recording:
    """Return an emulated run with phases and target forces, around forces drawn by a test."""
    result = run(settings()).result
    assert result is not None
    return result.recording


def settings(*faults: dict[str, object], force_n: float = 10.0) -> Config:
    return read_config(
        {
            "run": {"duration_s": 1.6, "period_ms": 20},
            "controller": {"sample_ms": 20},
            "robot": {"emulated": "egm"},
            "sensor": {"emulated": "ft300"},
            "task": {"force_n": force_n, "retract_mm": 2.0},
            "cell": {"start_position_mm": [900.0, -100.0, 591.5]},
            "faults": list(faults),
        }
    )


def test_recovery_ends_within_tolerance_of_target(tracked: Recording) -> None:
    (start,) = (event.at for event in tracked.events if event.text == "track")
    (last,) = (event.at for event in tracked.events if event.text == "retract")
    times = np.arange(start - 1.0, last + 1.0, 0.01)
    since = times - start
    fault = start + 0.5

    def recovery(forces: np.ndarray) -> float | None:
        return recovery_s(tracked, [fault], times, forces)

    steady = np.where(times <= last, 11.9, 0.0)
    assert recovery(steady) == 0.0
    assert recovery(np.where(since < 0.8, 20.0, steady)) == pytest.approx(0.3, abs=0.011)
    assert recovery(np.where((since > 1.0) & (since < 1.1), 7.9, steady)) == pytest.approx(0.6, abs=0.011)
    assert recovery(np.where(times > last - 0.05, 12.1, steady)) == math.inf
    # The last of several faults counts; one that lasts, or that ended outside the tracking, gives no recovery.
    later = start + 0.6
    assert recovery_s(tracked, [fault, later], times, np.where(since < 0.8, 20.0, steady)) == pytest.approx(
        0.2, abs=0.011
    )
    for end in (math.inf, start - 0.1, last + 0.1):
        assert recovery_s(tracked, [end], times, steady) is None
    assert recovery_s(tracked, [fault, math.inf], times, steady) is None
    assert recovery_s(tracked, [], times, steady) is None


def test_fault_ends_are_returned() -> None:
    faults = [
        Injection("surface", "step", {}, 0.0, ends_at=2.0),
        Injection("surface", "step", {}, 0.0, ends_at=2.0, ended_at=1.5),
        Injection("robot", "refuses", {}, 0.0, ends_at=None),
        Injection("computer", "pause", {"seconds": 0.5}, 3.0, None, ended_at=3.0),
    ]
    running: Any = SimpleNamespace(cell=SimpleNamespace(faults=faults), clock=SimpleNamespace(now=float))
    assert Watch(running).fault_ends() == [2.0, 1.5, math.inf, 3.5]


def test_recovery_follows_return_of_surface() -> None:
    step = {
        "on": "surface",
        "fault": "step",
        "phase": "track",
        "after_s": 0.6,
        "for_s": 0.3,
        "with": {"mm": 1.0},
    }
    figures = run(settings(step)).figures
    assert figures["outcome"] == "completed"
    recovery_s = figures["recovery_s"]
    assert isinstance(recovery_s, float)
    assert 0.05 < recovery_s < 0.6
    assert run(settings()).figures.get("recovery_s") is None
