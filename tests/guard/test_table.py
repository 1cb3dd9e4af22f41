"""The cases in which a guard that believes what it is told does damage, each on a soft and on a hard surface.

The bound of the true force: the limit, and what was already ordered and cannot be taken back. A command may be ahead
of the newest force by the steps of so many cycles as a force takes to be seen, so

    bound = limit + stiffness · step · cycles
"""

from collections.abc import Callable
from typing import Any

import pytest

from hil_bridge.config import Config
from hil_bridge.recording import Outcome

LIMIT_N = 50.0
LATENCY_CYCLES = 3
"""From an order to the force that shows its effect: answer, motion, filter, and the cycle that sees it."""
STEP_M = 0.5e-3
"""Approach step, which is that of a retraction where the tool has not been."""
SURFACES = pytest.mark.parametrize("stiffness", [5e3, 5e4])
Guarded = Any
Run = Callable[..., Guarded]
Configured = Callable[..., Config]


def bound(stiffness: float, step: float = STEP_M) -> float:
    """The largest true force that may occur, N."""
    return LIMIT_N + stiffness * step * LATENCY_CYCLES


def interrupt_after(seconds: float, phase: str) -> Callable[[Guarded, Any], None]:
    """Ctrl-C so long after the first cycle of a phase."""
    begun: list[float] = []

    def meddle(run: Guarded, record: Any) -> None:
        if record.phase == phase:
            begun.append(record.started_at)
            if record.started_at - begun[0] >= seconds:
                run.run.interrupt()

    return meddle


@SURFACES
def test_an_approach_with_the_wrong_sign_stands_still(
    guarded: Run, configured: Configured, stiffness: float
) -> None:
    """3 mm off the surface, Ctrl-C after a second: the retraction goes into the surface."""
    config = configured(
        stiffness,
        {"frame": {"approach": (0.0, 0.0, 1.0)}, "cell": {"start_position_mm": (900.0, -100.0, 593.0)}},
    )
    run = guarded(config, interrupt_after(1.0, "approach"))
    assert run.largest <= bound(stiffness)
    assert run.result.outcome is Outcome.STOPPED
    assert "while the tool retracted" in run.cause
    assert run.result.left.startswith("NOT retracted")


@SURFACES
def test_an_obstacle_above_the_start_is_no_completed_run(
    guarded: Run, configured: Configured, stiffness: float
) -> None:
    config = configured(stiffness, {"cell": {"obstacle": {"height_mm": 5.0, "stiffness_n_m": stiffness}}})
    run = guarded(config)
    assert run.largest <= bound(stiffness)
    assert run.result.outcome is Outcome.STOPPED
    assert "while the tool retracted" in run.cause
    assert run.result.left.startswith("NOT retracted")


@SURFACES
def test_after_a_killed_run_every_other_is_refused(
    in_one_cell: Callable[..., Any], configured: Configured, stiffness: float
) -> None:
    def kill(run: Guarded, record: Any) -> None:
        if sum(cycle.phase == "track" for cycle in run.cycles) == 8:
            run.kill()

    first, *others = in_one_cell([configured(stiffness)] * 8, kill)
    assert first.last > 5.0, "the killed run left the tool pressing"
    assert len(others) == 7
    for run in others:
        assert run.cycles == []
        assert "Fz reads" in str(run.error)
        assert "the tool touches something" in str(run.error)
        assert run.largest <= 12.0
