"""A bridge that dies on its way: how far an EGM robot continues without answers, and how hard it presses by then.

The program on this side cannot prevent it. The page on safety tells the figures, so that an operator can choose.
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
"""The robot is at rest so long after the last answer: its time-out is 1 s."""


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


Seen = tuple[tuple[float, float, float], float]
"""Place of the true tool, base frame, m, and length of the true force, N."""


def watch_way(run: Guarded) -> list[Seen]:
    """The true tool every 10 ms, from the last answer on until it rests."""
    seen: list[Seen] = []

    def look(clock: Clock) -> None:
        now, struck = clock.now(), run.cell.faults[0].injected_at if run.cell.faults else math.nan
        if struck <= now <= struck + LONGEST_S:
            state = run.cell.true_state(now)
            seen.append((state.position, math.hypot(*state.contact_force)))
        clock.call_at(now + 0.01, lambda: look(clock))

    event = run.event

    def begin(record: Any) -> None:
        if record.kind == EventKind.PHASE and record.text == "approach":
            look(run.clock)
        event(record)

    run.event = begin
    return seen


def ways(guarded: Run, config: Config) -> tuple[float, float, float]:
    """How far the tool went deeper and along the surface, mm, and the largest true force from then on, N."""
    watched: list[list[Seen]] = []
    guarded(config, prepare=lambda run: watched.append(watch_way(run)))
    places = [place for place, _ in watched[0]]
    deepest, farthest = min(z for _, _, z in places), max(y for _, y, _ in places)
    largest = max(force for _, force in watched[0])
    return (places[0][2] - deepest) * 1e3, (farthest - places[0][1]) * 1e3, largest


@pytest.mark.parametrize(
    ("period_ms", "after_s", "deeper_mm", "most_n"),
    [(4, 0.45, 0.7, 1.0), (20, 0.4638, 1.75, 50.0), (180, 0.5571, 6.5, 305.0)],
)
def test_an_approach_without_answers_goes_on_as_told(
    guarded: Run, period_ms: int, after_s: float, deeper_mm: float, most_n: float
) -> None:
    """At the worst of twelve moments, which lies where the set point moves between two decisions."""
    deeper, _, largest = ways(guarded, silenced(period_ms, "approach", after_s))
    assert 0.5 < deeper <= deeper_mm
    assert largest <= most_n


@pytest.mark.parametrize(
    ("period_ms", "after_s", "along_mm"), [(4, 0.12, 1.4), (20, 0.1269, 3.05), (180, 0.1965, 6.7)]
)
def test_tracking_without_answers_goes_on_as_told(
    guarded: Run, period_ms: int, after_s: float, along_mm: float
) -> None:
    """The tool stays as deep as it was: it continues along the surface."""
    deeper, along, largest = ways(guarded, silenced(period_ms, "track", after_s))
    assert deeper <= 0.26
    assert 1.0 < along <= along_mm
    assert largest <= 22.0


@pytest.mark.parametrize(("period_ms", "after_s", "deeper_mm"), [(20, 0.4638, 0.65), (180, 0.5571, 0.75)])
def test_without_feed_forward_it_hardly_goes_on(
    guarded: Run, period_ms: int, after_s: float, deeper_mm: float
) -> None:
    deeper, _, largest = ways(guarded, silenced(period_ms, "approach", after_s, egm={"feed_forward": False}))
    assert deeper <= deeper_mm
    assert largest == 0.0
