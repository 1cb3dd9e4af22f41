"""Tests of a robot's own force estimate: delayed, with offset and noise, and falsified by its faults."""

import math
import statistics

import pytest

from emulators.arm.own_force import EVERY_S, WITNESS_FAULTS, Errors, OwnForce
from emulators.faults.ledger import Ledger
from protocol.geometry import Vector, Wrench, turn_about

T0 = 1000.25
EXACT = Errors(0.0, 0.0)
NOISE: Wrench = (0.2, 0.3, 0.1, 0.02, 0.03, 0.01)


def pressing(force: Vector = (0.0, 0.0, 40.0), errors: Errors = EXACT, seed: int = 1) -> OwnForce:
    own = OwnForce(errors, seed)
    own.feel(lambda time: force if time >= T0 else (0.0, 0.0, 0.0))
    return own


def test_contact_is_sampled_periodically_and_never_ahead() -> None:
    requested: list[float] = []
    own = OwnForce(EXACT, 1)

    def contact(time: float) -> Vector:
        requested.append(time)
        return 0.0, 0.0, 0.0

    own.feel(contact)
    times = [T0 + 0.002 * cycle for cycle in range(12)]
    for now in times:
        own.at(now)
    assert len(requested) == 3
    assert all(time < now for time, now in zip(requested, times[::4], strict=True))


def test_force_follows_contact_with_time_constant() -> None:
    own = pressing(errors=Errors(0.0, 0.01))
    assert own.at(T0 - 0.001) == (0.0,) * 6
    assert own.at(T0 - 0.001 + EVERY_S)[2] == pytest.approx(40.0 * (1.0 - math.exp(-0.8)))
    assert own.at(T0 + 0.2)[2] == pytest.approx(40.0, abs=1e-6)


def test_offset_and_noise_follow_seed() -> None:
    errors = Errors(4.5, 0.0, NOISE, tuple(2.0 * rms for rms in NOISE))  # type: ignore[arg-type]
    readings = [pressing(errors=errors, seed=seed).at(T0 - 1.0) for seed in (1, 1, 2)]
    assert readings[0] == readings[1] != readings[2]
    own = pressing(errors=errors)
    for moving, factor in ((False, 1.0), (True, 2.0)):
        readings = [own.at(T0 - 1.0, moving) for _ in range(2000)]
        for axis, rms in zip(zip(*readings, strict=True), NOISE, strict=True):
            assert statistics.stdev(axis) == pytest.approx(factor * rms, rel=0.1)
            assert abs(statistics.mean(axis)) < 4.5
    assert own.level[3:] == (0.0,) * 3, "its moments are noise alone"


def test_zero_drift_matches_errors() -> None:
    """Mean square of the drift in 10 s, over the axes of many robots, and the largest slope of all."""

    def drift_changes(errors: Errors, seed: int, seconds: int) -> Vector:
        own = OwnForce(errors, seed)
        levels = [own.at(T0 + EVERY_S * tick) and own.level for tick in range(round(seconds / EVERY_S) + 1)]
        x, y, z = (b - a for a, b in zip(levels[0][:3], levels[-1][:3], strict=True))
        return x, y, z

    changes = [
        change for seed in range(40) for change in drift_changes(Errors(4.5, 0.0, walk_n=0.05), seed, 10)
    ]
    assert math.sqrt(statistics.mean(change * change for change in changes)) == pytest.approx(0.05, rel=0.15)
    slopes = [
        abs(change)
        for seed in range(40)
        for change in drift_changes(Errors(4.5, 0.0, slope_n_min=0.08), seed, 6)
    ]
    assert 0.07 * 0.1 < max(slopes) <= 0.08 * 0.1


def test_offset_may_turn_with_flange() -> None:
    quarter = turn_about((0.0, 0.0, 1.0), math.pi / 2.0)
    fixed, turns = (OwnForce(Errors(4.5, 0.0, turns=turns), 3) for turns in (False, True))
    x, y, z = fixed.at(T0)[:3]
    assert turns.at(T0)[:3] == fixed.at(T0, flange=quarter)[:3] == (x, y, z)
    assert turns.at(T0, flange=quarter)[:3] == pytest.approx((-y, x, z))


@pytest.mark.parametrize(
    ("name", "how", "expected"),
    [
        ("dead", {}, 0.0),
        ("stuck", {}, 40.0),
        ("offset", {"z_n": -15.0}, 65.0),
        ("scale", {"factor": 0.1}, 8.0),
        ("nan", {}, math.nan),
    ],
)
def test_each_fault_affects_force_while_active(name: str, how: dict[str, float], expected: float) -> None:
    """The force is 40 N when the fault begins, and the contact rises to 80 N."""
    own, ledger = pressing(), Ledger({"witness": WITNESS_FAULTS})
    ledger.attach("witness", own.handlers)
    assert own.at(T0 + 1.0)[2] == 40.0
    injection = ledger.inject("witness", name, T0 + 1.0, {"for_s": 1.0, **how})
    own.at(T0 + 1.001)
    own.feel(lambda time: (0.0, 0.0, 80.0))
    assert own.at(T0 + 1.5)[2] == pytest.approx(expected, nan_ok=True)
    assert injection.struck
    ledger.handle_deadline(T0 + 2.0)
    assert own.at(T0 + 2.5)[2] == 80.0
