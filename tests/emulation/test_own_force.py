"""A robot's own idea of the force on its tool: late, off, noisy, and wrong by its faults."""

import math
import statistics

import pytest

from emulators.arm.own_force import EVERY_S, WITNESS_FAULTS, Errors, OwnForce
from emulators.faults.ledger import Ledger
from protocol.geometry import Vector

T0 = 1000.25
EXACT = Errors(0.0, 0.0)


def pressing(force: Vector = (0.0, 0.0, 40.0), errors: Errors = EXACT, seed: int = 1) -> OwnForce:
    own = OwnForce(errors, seed)
    own.feel(lambda time: force if time >= T0 else (0.0, 0.0, 0.0))
    return own


def test_it_looks_at_the_contact_now_and_then_and_never_ahead() -> None:
    asked: list[float] = []
    own = OwnForce(EXACT, 1)

    def contact(time: float) -> Vector:
        asked.append(time)
        return 0.0, 0.0, 0.0

    own.feel(contact)
    times = [T0 + 0.002 * cycle for cycle in range(12)]
    for now in times:
        own.at(now)
    assert len(asked) == 3
    assert all(time < now for time, now in zip(asked, times[::4], strict=True))


def test_it_follows_the_contact_by_its_time_constant() -> None:
    own = pressing(errors=Errors(0.0, 0.01))
    assert own.at(T0 - 0.001) == (0.0, 0.0, 0.0)
    assert own.at(T0 - 0.001 + EVERY_S)[2] == pytest.approx(40.0 * (1.0 - math.exp(-0.8)))
    assert own.at(T0 + 0.2)[2] == pytest.approx(40.0, abs=1e-6)


def test_offset_and_noise_are_those_of_its_seed() -> None:
    errors = Errors(4.5, 0.0, 0.2)
    readings = [pressing(errors=errors, seed=seed).at(T0 - 1.0) for seed in (1, 1, 2)]
    assert readings[0] == readings[1] != readings[2]
    own = pressing(errors=errors)
    forces = [own.at(T0 - 1.0)[2] for _ in range(2000)]
    assert statistics.stdev(forces) == pytest.approx(0.2, rel=0.1)
    assert abs(statistics.mean(forces)) < 4.5


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
def test_each_fault_spoils_it_while_it_lasts(name: str, how: dict[str, float], expected: float) -> None:
    """It stands at 40 N when the fault begins, and the contact rises to 80 N."""
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
