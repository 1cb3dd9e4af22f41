"""Force control in a run: each controller, soft and hard, flat and curved surfaces, and oscillation."""

import itertools
import math
import statistics
from typing import Any

import pytest

from hil_bridge.control import CONTROLLERS
from hil_bridge.record import CycleRecord, Outcome
from tests.bench import Bench, RunBench

pytestmark = pytest.mark.sweep

DEEP = {"approach_depth_limit_mm": 30.0}
"""Settings for surfaces deeper below the start than an approach moves by default."""


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_every_controller_holds_10_n_on_sponge(bench: RunBench, controller: str) -> None:
    run = bench(run={"duration_s": 12.0}, controller={"name": controller})
    assert run.result.outcome is Outcome.COMPLETED
    steady = [record.force for record in run.tracked()[-40:]]
    assert statistics.fmean(steady) == pytest.approx(10.0, abs=0.5)
    assert all(record.in_contact for record in run.tracked())
    assert run.texts("phase") == ["connect", "tare", "approach", "track", "retract", "end"]
    assert run.true_force == 0.0


def rise(run: Bench, force: float) -> int:
    """Samples of tracking until 90 % of the desired force."""
    return next(i for i, record in enumerate(run.tracked()) if record.force >= 0.9 * force)


def rms_after_rise(run: Bench, force: float) -> float:
    """Root mean square of the force error from three samples after the rise on, N."""
    tracked = run.tracked()[rise(run, force) + 3 :]
    return math.sqrt(statistics.fmean((record.force - force) ** 2 for record in tracked))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_known_stiffness_gives_faster_rise(bench: RunBench, seed: int) -> None:
    runs = {
        name: bench(run={"duration_s": 8.0, "seed": seed}, controller={"name": name})
        for name in ("fuzzy", "fuzzy-adaptive", "resolution-aware", "predictive")
    }
    slow = rise(runs.pop("fuzzy"), 10.0)
    for run in runs.values():
        assert 2 * rise(run, 10.0) <= slow + 1  # complete samples
        assert all(record.in_contact for record in run.tracked())
    assert rms_after_rise(runs["predictive"], 10.0) <= 0.6


@pytest.mark.full
@pytest.mark.parametrize("seed", [1, 2])
def test_predictive_follows_curved_contour(bench: RunBench, seed: int) -> None:
    surface = {"kind": "sinusoidal", "amplitude_mm": 10.0, "period_mm": 200.0}
    cell = {"surface": surface, "start_position_mm": (900.0, -100.0, 605.0)}
    ahead, behind = (
        bench(run={"duration_s": 26.0, "seed": seed}, cell=cell, controller={"name": name}, task=DEEP)
        for name in ("predictive", "fuzzy")
    )
    assert ahead.result.outcome is Outcome.COMPLETED
    assert all(record.in_contact for record in ahead.tracked())
    assert rms_after_rise(ahead, 10.0) <= 0.5
    assert rms_after_rise(behind, 10.0) > 3 * rms_after_rise(ahead, 10.0)


@pytest.mark.full
@pytest.mark.parametrize("stiffness", [500.0, 2e3, 5e3, 2e4, 5e4, 1e5])
def test_one_tuning_covers_two_decades_of_stiffness(bench: RunBench, stiffness: float) -> None:
    for seed in (1, 2):
        run = bench(
            # where a hard surface is expected, the barrier lets a soft one be pressed in slowly only
            run={"duration_s": 12.0 if stiffness > 2e3 else 50.0 if stiffness < 1e3 else 20.0, "seed": seed},
            controller={"name": "predictive"},
            task={"force_n": 50.0, "expected_stiffness_n_m": 1e5, "zero_lift_mm": 0.0},
            limits={"force_limit_n": 150.0, "resultant_limit_n": 300.0, "correction_total_mm": 200.0},
            cell={
                "surface": {"stiffness_n_m": stiffness},
                "jr3": {"sensor": {"full_scales_n": (317.0, 314.0, 845.0)}},
            },
        )
        assert run.result.outcome is Outcome.COMPLETED
        assert all(record.in_contact for record in run.tracked())
        most = max(record.force for record in run.cycles)
        assert most <= 50.0 + 0.15 * 50.0 + stiffness * 0.125e-3
        steady = [record.force for record in run.tracked()[-40:]]
        assert statistics.fmean(steady) == pytest.approx(50.0, abs=0.5 + stiffness * 0.125e-3 / 2)
        assert max(steady) - min(steady) < 0.3  # no limit cycle


def test_waiting_for_force_reduces_first_impact(bench: RunBench) -> None:
    """Seed 7 draws a hard first blow; with others the contact may fall so that waiting gains nothing."""
    surface = {"kind": "sinusoidal", "amplitude_mm": 10.0, "period_mm": 200.0, "stiffness_n_m": 1e5}
    most = []
    for share in (0.0, 0.8):
        run = bench(
            run={"duration_s": 10.0, "seed": 7},
            controller={"name": "predictive"},
            task={
                "force_n": 50.0,
                "expected_stiffness_n_m": 1e5,
                "travel_from_share": share,
                "zero_lift_mm": 0.0,
            },
            limits={"force_limit_n": 150.0, "resultant_limit_n": 300.0},
            cell={
                "surface": surface,
                "jr3": {"sensor": {"full_scales_n": (317.0, 314.0, 845.0)}},
                "start_position_mm": (900.0, -100.0, 602.0),
            },
        )
        assert run.result.outcome is Outcome.COMPLETED
        most.append(max(record.force for record in run.cycles))
    assert most[1] <= 60.0 < most[0]


@pytest.mark.parametrize(
    "surface",
    [
        {"kind": "sloped", "slope_deg": 5.0},
        {"kind": "sinusoidal", "amplitude_mm": 2.0, "period_mm": 100.0},
        {"kind": "circular_arc", "radius_mm": 300.0},
    ],
)
def test_contact_is_kept_on_every_surface_model(bench: RunBench, surface: dict[str, Any]) -> None:
    run = bench(run={"duration_s": 10.0}, cell={"surface": surface}, task={"speed_mm_s": 2.75, **DEEP})
    assert run.result.outcome is Outcome.COMPLETED
    assert all(record.in_contact for record in run.tracked()[5:])
    assert statistics.fmean(record.force for record in run.tracked()[10:]) == pytest.approx(10.0, abs=2.5)


@pytest.mark.full
def test_oscillating_force_settles_after_gain_reduction(bench: RunBench) -> None:
    """Seed 4 of the paper's adaptation keeps oscillating: its pairs of force and position are misaligned."""
    settings = {"run": {"duration_s": 40.0, "seed": 4}, "controller": {"name": "fuzzy-adaptive"}}
    free = bench(**settings, limits={"oscillation_guard": False})
    guarded = bench(**settings)
    assert peak_to_peak(free) > 3.0
    assert peak_to_peak(guarded) < 0.5 * peak_to_peak(free)
    assert any("the force oscillates: gain lowered to 0.5" in record.reasons for record in guarded.tracked())
    assert guarded.result.outcome is Outcome.COMPLETED


def test_oscillation_at_lowest_gain_ends_run(bench: RunBench) -> None:
    run = bench(
        run={"duration_s": 60.0},
        cell={"surface": {"stiffness_n_m": 60_000.0, "damping_ns_m": 0.0}, "jr3": {"sensor": LARGE_SENSOR}},
        controller={"name": "pi", "parameters": {"integral": 8.0}},
        task={"force_n": 40.0, "approach_speed_mm_s": 0.55, "zero_lift_mm": 0.0, "loss_limit": 100},
        limits={"force_limit_n": 600.0, "resultant_limit_n": 600.0},
        oscillation={"factor_min": 0.5},
    )
    assert run.result.outcome is Outcome.STOPPED
    assert "continues to oscillate" in run.result.text
    assert run.true_force == 0.0


LARGE_SENSOR = {"full_scales_n": (317.0, 314.0, 845.0), "full_scales_nm": (22.1, 21.9, 30.7)}


def peak_to_peak(run: Bench) -> float:
    """Peak to peak of the force over the last 40 samples of tracking, N."""
    forces = [record.force for record in run.tracked()[-40:]]
    return max(forces) - min(forces)


def test_contour_force_and_speed_follow_normal(bench: RunBench) -> None:
    """Compare the paper's fixed direction with the estimated normal, using the emulator's ground truth."""
    amplitude, period = 0.010, 0.200

    def truth(follow: bool) -> tuple[float, float]:
        """Return the RMS error of the true normal force, N, and the mean distance along the surface a sample, mm."""
        pressed: list[float] = []
        path: list[tuple[float, ...]] = []

        def record_truth(bench: Bench, record: CycleRecord) -> None:
            if record.phase != "track":
                return
            state = bench.cell.true_state(record.sample.now)
            slope = amplitude * math.tau / period * math.cos(math.tau * state.position[1] / period)
            angle = math.atan(slope)
            _, along, up = state.contact_force
            pressed.append(up * math.cos(angle) - along * math.sin(angle))
            path.append(state.position)

        bench(
            record_truth,
            run={"duration_s": 26.0},
            frame={"follow_normal": follow},
            cell={
                "surface": {"kind": "sinusoidal", "amplitude_mm": 1e3 * amplitude, "period_mm": 1e3 * period}
            },
        )
        errors = [force - 10.0 for force in pressed[15:]]
        distances = [math.dist(a, b) for a, b in itertools.pairwise(path[15:])]
        return math.sqrt(statistics.fmean(e * e for e in errors)), 1e3 * statistics.fmean(distances)

    fixed_rms, fixed_distance = truth(follow=False)
    rms, distance = truth(follow=True)
    assert rms < 0.7 * fixed_rms
    assert rms < 0.5
    assert distance == pytest.approx(1.0, abs=0.01)
    assert fixed_distance > 1.015


@pytest.mark.parametrize("stiffness", [500.0, 5_000.0, 50_000.0, 100_000.0])
@pytest.mark.parametrize("start_mm", [590.5, 592.03])
def test_one_setting_suits_soft_and_hard_surfaces(bench: RunBench, stiffness: float, start_mm: float) -> None:
    """50 N from a light touch: at most 15 % over, and one resolution step of force. Approach and first moves are
    made for the hardest surface expected; nothing is tuned in between.
    """
    run = bench(
        run={"duration_s": 8.0},
        controller={"name": "predictive", "parameters": {"stiffest_n_m": 200_000.0}},
        task={"force_n": 50.0, "expected_stiffness_n_m": 100_000.0, "retract_mm": 1.0},
        limits={"force_limit_n": 150.0, "resultant_limit_n": 300.0},
        cell={
            "surface": {"stiffness_n_m": stiffness},
            "jr3": {"sensor": LARGE_SENSOR},
            "start_position_mm": (900.0, -100.0, start_mm),
        },
    )
    assert run.result.outcome is Outcome.COMPLETED
    forces = [record.force for record in run.tracked()]
    assert max(forces) <= 1.15 * 50.0 + stiffness * 0.125e-3
    contact = [record.in_contact for record in run.tracked()]
    assert sum(before and not after for before, after in itertools.pairwise(contact)) <= 1
    if stiffness > 500.0:  # the supervisor's 2 mm a cycle make 500 N/m slow
        assert statistics.fmean(forces[-10:]) == pytest.approx(50.0, abs=1.0 + stiffness * 0.0625e-3)
