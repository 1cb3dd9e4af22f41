"""The adaptive controllers on a contour, behind a robot with a dead band of half a resolution step.

A sideways move over a slope changes the force without a move in depth. The dead band reports moves that were not made.
Both spoil quotients of eq. (4).
"""

import math
from random import Random

import pytest

from hil_bridge.control import FuzzyPi, Measurement, ResolutionAware

STEP = 0.125e-3
QUANTUM = 0.0244
"""Force per count of a 400 N sensor, N."""


def track(controller, stiffness, surface, seed, samples=150, reference=10.0):
    """True forces in N after the first ten samples, and the estimates in N/m."""
    noise, state, commanded = Random(seed), controller.initial(), 0.0
    true = noise.uniform(-0.5, 0.5) * STEP
    forces, estimates = [], []
    for k in range(samples):
        word = round(commanded / STEP) * STEP
        true = min(max(true, word - STEP / 2), word + STEP / 2)
        force = stiffness * max(true - surface(k), 0.0)
        read = round((force + noise.gauss(0.0, 0.03)) / QUANTUM) * QUANTUM
        measurement = Measurement(k * 0.18, read, word, commanded, in_contact=read > 0.5)
        state, command = controller.step(state, measurement, reference)
        commanded = command.position
        forces.append(force)
        estimates.append(command.stiffness)
    return forces[10:], [k for k in estimates[10:] if k is not None]


def slope(mm_per_sample):
    return lambda k: mm_per_sample * 1e-3 * k


def wave(k):
    return 5e-3 * math.sin(k / 75 * 2 * math.pi)


def rms_error(forces, reference=10.0):
    return math.sqrt(sum((force - reference) ** 2 for force in forces) / len(forces))


@pytest.mark.parametrize("surface", [slope(0.0), slope(0.05), slope(0.2), slope(-0.2), wave])
def test_resolution_aware_beats_fixed_gains_on_a_sponge(surface):
    for seed in range(5):
        aware, estimates = track(ResolutionAware(force_uncertainty_n=0.1), 5e3, surface, seed)
        fixed, _ = track(FuzzyPi(), 5e3, surface, seed)
        assert rms_error(aware) < rms_error(fixed)
        assert min(aware) > 0
        assert max(aware) < 15
        assert all(5e3 / 3 < k < 5e3 * 3 for k in estimates)


def test_resolution_aware_rests_on_a_hard_surface():
    for seed in range(5):
        forces, _ = track(ResolutionAware(force_uncertainty_n=0.1), 2e4, slope(0.0), seed)
        assert max(forces[-40:]) == min(forces[-40:])
        assert abs(forces[-1] - 10.0) < 2e4 * STEP
