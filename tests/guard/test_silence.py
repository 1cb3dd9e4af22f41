"""A bridge that dies during a run: how far an EGM robot continues without answers, and how hard it then presses.

The program on this side cannot prevent it. The page on safety lists the figures, so that an operator can choose.
"""

import math
from collections.abc import Callable
from typing import Any

import pytest

from hil_bridge.clock import Clock
from hil_bridge.record import EventKind
from hil_bridge.settings.configuration import Config
from tests.near_surface import awake_config

pytestmark = pytest.mark.sweep

Guarded = Any
Run = Callable[..., Guarded]

LONGEST_S = 1.5
"""Time after the last answer until the robot is stationary, s; its time-out is 1 s."""


def silenced(period_ms: int, phase: str, after_s: float, **robot: Any) -> Config:
    """A run on a hard surface whose answers do not reach the robot from a moment on."""
    lost = {"on": "wire", "fault": "deaf", "phase": phase, "after_s": after_s, "for_s": 3.0}
    return awake_config(
        {
            "run": {"duration_s": 1.0, "period_ms": period_ms},
            "controller": {"sample_ms": period_ms},
            "robot": {"emulated": "egm", **robot},
            "sensor": {"emulated": "netft"},
            "cell": {"start_position_mm": (900.0, -100.0, 591.5), "surface": {"stiffness_n_m": 5e4}},
            "task": {"retract_mm": 3.0},
            "limits": {"retract_patience_s": 0.5},
            "faults": [lost],
        }
    )


TrueSample = tuple[tuple[float, float, float], float]
"""True position of the tool, base frame, m, and magnitude of the true force, N."""


def watch_tool(run: Guarded) -> list[TrueSample]:
    """Record the true state of the tool every 10 ms, from the last answer until it is stationary."""
    samples: list[TrueSample] = []

    def sample(clock: Clock) -> None:
        now, struck = clock.now(), run.cell.faults[0].injected_at if run.cell.faults else math.nan
        if struck <= now <= struck + LONGEST_S:
            state = run.cell.true_state(now)
            samples.append((state.position, math.hypot(*state.contact_force)))
        clock.call_at(now + 0.01, lambda: sample(clock))

    event = run.event

    def begin(record: Any) -> None:
        if record.kind == EventKind.PHASE and record.text == "approach":
            sample(run.clock)
        event(record)

    run.event = begin
    return samples


def measure_overrun(guarded: Run, config: Config) -> tuple[float, float, float]:
    """Return the motion deeper and along the surface, mm, and the largest true force after the last answer, N."""
    watched: list[list[TrueSample]] = []
    guarded(config, prepare=lambda run: watched.append(watch_tool(run)))
    positions = [position for position, _ in watched[0]]
    deepest, farthest = min(z for _, _, z in positions), max(y for _, y, _ in positions)
    largest = max(force for _, force in watched[0])
    return (positions[0][2] - deepest) * 1e3, (farthest - positions[0][1]) * 1e3, largest


@pytest.mark.parametrize(
    ("period_ms", "after_s", "deeper_mm", "most_n"),
    [(4, 0.45, 0.7, 1.0), (20, 0.4638, 1.75, 50.0), (180, 0.5571, 6.5, 305.0)],
)
def test_silent_link_approach_continues_as_ordered(
    guarded: Run, period_ms: int, after_s: float, deeper_mm: float, most_n: float
) -> None:
    """At the worst of twelve moments, which lies where the set point moves between two decisions."""
    deeper, _, largest = measure_overrun(guarded, silenced(period_ms, "approach", after_s))
    assert 0.5 < deeper <= deeper_mm
    assert largest <= most_n


@pytest.mark.parametrize(
    ("period_ms", "after_s", "along_mm"), [(4, 0.12, 1.45), (20, 0.1269, 3.05), (180, 0.1965, 6.7)]
)
def test_silent_link_tracking_continues_as_ordered(
    guarded: Run, period_ms: int, after_s: float, along_mm: float
) -> None:
    """The tool stays as deep as it was: it continues along the surface."""
    deeper, along, largest = measure_overrun(guarded, silenced(period_ms, "track", after_s))
    assert deeper <= 0.26
    assert 1.0 < along <= along_mm
    assert largest <= 24.0


@pytest.mark.parametrize(("period_ms", "after_s", "deeper_mm"), [(20, 0.4638, 0.65), (180, 0.5571, 0.75)])
def test_silent_link_without_feed_forward_hardly_moves(
    guarded: Run, period_ms: int, after_s: float, deeper_mm: float
) -> None:
    deeper, _, largest = measure_overrun(
        guarded, silenced(period_ms, "approach", after_s, egm={"feed_forward": False})
    )
    assert deeper <= deeper_mm
    assert largest == 0.0
