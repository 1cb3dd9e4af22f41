"""The paper's simulation (Figs. 3 and 5) with its actual results, not the paper's claims. 20 noise seeds."""

import pytest

from hil_bridge.control import FuzzyAdaptive, FuzzyPi, ResolutionAware, Surface

UNLIMITED = ResolutionAware(feedforward_limit_mm=None)


@pytest.mark.parametrize(
    ("stiffness", "rise", "peak_to_peak"),
    [(1e3, 129, None), (5e3, 30, 1.0), (2e4, 11, 7.3), (5e4, 3, 32.0), (1e5, 1, 63.0)],
)
def test_fixed_gains_creep_on_soft_walls_and_cycle_on_hard_ones(wall_means, stiffness, rise, peak_to_peak):
    means = wall_means(FuzzyPi(), stiffness)
    assert means["rise_samples"] == pytest.approx(rise, rel=0.2)
    if peak_to_peak is not None:
        assert means["steady_peak_to_peak_n"] == pytest.approx(peak_to_peak, rel=0.2)


def test_limit_cycle_of_fixed_gains_is_five_resolution_steps(wall):
    for stiffness in (5e4, 1e5):
        commands = {round(x / 0.125e-3) for x in wall(FuzzyPi(), stiffness, seed=0).commanded[-40:]}
        assert max(commands) - min(commands) == 5


def test_adaptation_rises_ten_times_faster_on_a_soft_wall(wall_means):
    fixed, adaptive = (wall_means(kind(), 5e3)["rise_samples"] for kind in (FuzzyPi, FuzzyAdaptive))
    assert adaptive * 10 <= fixed
    assert wall_means(FuzzyAdaptive(), 1e3)["rise_samples"] < 10


def test_paper_adaptation_keeps_limit_cycle_on_hard_walls(wall_means):
    assert wall_means(FuzzyAdaptive(), 1e5)["steady_peak_to_peak_n"] == pytest.approx(76, rel=0.2)
    assert wall_means(FuzzyAdaptive(), 2e4)["steady_peak_to_peak_n"] == pytest.approx(10, rel=0.2)
    assert wall_means(FuzzyAdaptive(), 2e4, reference=100.0)["steady_peak_to_peak_n"] < 4.0


@pytest.mark.parametrize("stiffness", [5e3, 2e4, 5e4, 1e5])
def test_resolution_awareness_ends_every_limit_cycle(wall, stiffness):
    for seed in range(20):
        merit = wall(UNLIMITED, stiffness, seed).merit
        assert merit.steps_per_s == 0.0
        assert abs(merit.steady_mean_error_n) <= stiffness * 0.125e-3 / 2 + 0.5


def test_feedforward_limit_only_costs_rise_time(wall_means):
    limited, free = wall_means(ResolutionAware(), 5e3), wall_means(UNLIMITED, 5e3)
    assert free["rise_samples"] < limited["rise_samples"] < 10
    assert limited["steps_per_s"] == 0.0


# On the softest wall a step changes the force by less than the noise, so noise chooses the pairs.
@pytest.mark.parametrize(
    ("stiffness", "factor"), [(1e3, 2.0), (5e3, 1.25), (2e4, 1.25), (5e4, 1.1), (1e5, 1.1)]
)
def test_estimate_matches_wall_stiffness(wall, stiffness, factor):
    for seed in range(20):
        assert stiffness / factor < wall(UNLIMITED, stiffness, seed).stiffnesses[-1] < stiffness * factor


@pytest.mark.parametrize("surface", Surface)
def test_every_surface_settles_on_a_sponge(wall, surface):
    merit = wall(FuzzyPi(surface=surface), 5e3, seed=1).merit
    assert abs(merit.steady_mean_error_n) < 0.5
    assert merit.overshoot_percent < 3
