"""Tests of small experiments: they repeat exactly, and the numbers of each claim match the CSV file."""

import csv
import io
import os
import struct
from dataclasses import replace

import pytest
from paper_experiments import (
    EXPERIMENTS,
    resolution,
    run_jobs,
    write_findings,
    write_page,
)
from paper_experiments.cell import CellJob
from paper_experiments.comparison import held, ranking, variants
from paper_experiments.paper_simulation import RESOLUTION, PaperJob
from paper_experiments.results import digits, markdown, only_row, to_csv
from paper_experiments.simulation import REFERENCE_N, STIFFNESSES

from hil_bridge.api import simulate
from hil_bridge.control import CONTROLLERS, ForceTrace, figures_of_merit
from hil_bridge.lab.drawing import draw


def from_csv(text):
    """Return the rows of a table that `to_csv` wrote."""
    return tuple(
        {name: read_value(field) for name, field in row.items()} for row in csv.DictReader(io.StringIO(text))
    )


def read_value(field):
    if not field:
        return None
    for kind in (int, float):
        try:
            return kind(field)
        except ValueError:
            continue
    return field


def evaluated(name, seeds, keep=lambda job: True):
    experiment = EXPERIMENTS[name]
    jobs = [job for job in experiment.jobs(seeds) if keep(job)]
    results = run_jobs(jobs, workers=1)
    return experiment, experiment.evaluate(jobs, [results[job] for job in jobs])


@pytest.fixture(scope="module")
def simulated():
    return evaluated("fig3-5", 20)[1].table


def row(table, controller, stiffness):
    return only_row(table, controller=controller, stiffness_n_m=stiffness)


@pytest.mark.parametrize(
    ("stiffness", "rise"), [(1000, 129), (5000, 30), (20_000, 11), (50_000, 3), (100_000, 1)]
)
def test_rise_of_fixed_gains_is_that_of_the_specification(simulated, stiffness, rise):
    assert row(simulated, "fuzzy", stiffness)["rise_samples"] == pytest.approx(rise, rel=0.2)


@pytest.mark.parametrize(("stiffness", "swing"), [(50_000, 32.0), (100_000, 63.0)])
def test_limit_cycle_of_fixed_gains_is_that_of_the_specification(simulated, stiffness, swing):
    assert row(simulated, "fuzzy", stiffness)["steady_peak_to_peak_n"] == pytest.approx(swing, rel=0.2)


def test_adaptation_of_the_paper_is_ten_times_faster_on_the_sponge(simulated):
    fixed, adapted = (row(simulated, name, 5000)["rise_samples"] for name in ("fuzzy", "fuzzy-adaptive"))
    assert fixed >= 10 * adapted


@pytest.mark.parametrize("stiffness", [5000, 20_000, 50_000, 100_000])
def test_resolution_awareness_rests_where_no_step_is_better(simulated, stiffness):
    aware = row(simulated, "resolution-aware", stiffness)
    assert aware["steps_per_s"] == 0.0
    assert abs(aware["steady_mean_error_n"]) <= stiffness * RESOLUTION / 2
    if stiffness <= 50_000:
        assert aware["overshoot_percent"] <= 10.0


def test_simulation_covers_the_reference_cases(simulated):
    assert REFERENCE_N == 50.0
    assert {entry["stiffness_n_m"] for entry in simulated} == set(STIFFNESSES)


@pytest.mark.parametrize("name", ["rules", "fig3-5"])
def test_claims_follow_from_the_csv_file_alone(name):
    experiment, findings = evaluated(name, 2)
    assert experiment.claims(from_csv(to_csv(findings.table))) == experiment.claims(findings.table)


def test_numbers_of_a_text_stand_in_its_csv_file(tmp_path):
    experiment, findings = evaluated("fig3-5", 2)
    write_findings(experiment, findings, tmp_path)
    write_page(tmp_path / "page.md", tmp_path, {"fig3-5": findings}, [experiment], "the command")
    rows = list(csv.DictReader(io.StringIO((tmp_path / "fig3-5.csv").read_text())))
    text = (tmp_path / "page.md").read_text()
    by_wall = {int(entry["stiffness_n_m"]): entry for entry in rows if entry["controller"] == "fuzzy"}
    assert f"rise {float(by_wall[1000]['rise_samples']):.3g} samples" in text
    assert f"{float(by_wall[50_000]['steady_peak_to_peak_n']):.3g} N peak to peak" in text


def test_a_changed_number_changes_the_claims():
    experiment, findings = evaluated("fig3-5", 1)
    changed = [{**entry, "steady_peak_to_peak_n": 77.7} for entry in findings.table]
    assert "77.7 N" in experiment.claims(changed)[1].found


def test_the_one_entry_that_the_rules_do_not_give_is_named(tmp_path):
    experiment, findings = evaluated("rules", 1)
    (claim,) = experiment.claims(findings.table)
    assert "168 of 169" in claim.found
    assert "G(+6, 0) is printed −5 and computed −4" in claim.found
    matrix = {entry["error \\ change"]: entry for entry in experiment.summary(findings.table)}
    assert matrix["+6"]["0"] == "-4 (-5)"


@pytest.mark.parametrize(
    ("name", "columns"),
    [
        ("rules", {"error_level", "change_level", "printed", "computed"}),
        (
            "fig3-5",
            {"controller", "stiffness_n_m", "seeds", "rise_samples", "rise_samples_sd", "overshoot_percent"},
        ),
    ],
)
def test_columns(name, columns):
    _, findings = evaluated(name, 1)
    assert columns <= set(from_csv(to_csv(findings.table))[0])


def test_pictures_are_png_small_enough_and_repeat():
    experiment, findings = evaluated("fig3-5", 1)
    first, second = (draw(experiment.panels(findings.curves), 3) for _ in range(2))
    assert first == second
    assert first.startswith(b"\x89PNG")
    width, height = struct.unpack(">II", first[16:24])
    assert width > 800
    assert height > 300
    assert len(first) < 150_000


def test_a_simulated_run_is_a_function_of_its_seed():
    job = PaperJob("fuzzy", (), 5e3, 50.0, seed=3, samples=30)
    assert job() == job()
    assert job() != PaperJob("fuzzy", (), 5e3, 50.0, seed=4, samples=30)()


def test_a_run_of_the_chain_is_a_function_of_its_seed():
    config = CellJob("fuzzy", (), seed=1, duration=2.0).config()
    first, second = simulate(config), simulate(config)
    assert (first.cycles, first.events) == (second.cycles, second.events)
    assert first.outcome == "completed"
    assert {cycle.phase for cycle in first.cycles} >= {"approach", "track", "retract"}


def test_processes_give_what_one_gives(monkeypatch):
    jobs = [CellJob("fuzzy", (), seed, duration=1.0) for seed in (1, 2)]
    jobs += [PaperJob("fuzzy", (), 5e3, 50.0, seed, samples=10) for seed in range(6)]
    ended = []
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    alone, together = run_jobs(jobs, 1), run_jobs(jobs, 2, ended.append)
    assert sum(ended) == len(jobs)
    assert os.environ["OMP_NUM_THREADS"] == "3"
    assert "OPENBLAS_NUM_THREADS" not in os.environ
    assert list(alone) == jobs
    for job in jobs:
        assert repr(alone[job]) == repr(together[job])


def test_the_steady_state_is_that_of_the_last_samples_asked_for():
    long, short = (CellJob("fuzzy", (), 1, duration=12.0, steady_samples=count)() for count in (40, 10))
    assert long.force.tolist() == short.force.tolist()
    assert short.merit.steady_mean_error_n == pytest.approx(short.force[-10:].mean() - 10.0)
    assert long.merit.steady_mean_error_n == pytest.approx(long.force[-40:].mean() - 10.0)
    assert long.merit == figures_of_merit(
        ForceTrace(long.time, long.force, 10.0, long.commanded, [True] * len(long.time))
    )
    assert CellJob("fuzzy", (), 1, duration=2.0)().merit.steady_peak_to_peak_n is None


def test_every_figure_of_the_chain_comes_out_of_a_short_run(tmp_path):
    for name in ("fig7-8", "fig9-11"):
        experiment = EXPERIMENTS[name]
        jobs = [replace(job, duration=9.0) for job in experiment.jobs(1)]
        findings = experiment.evaluate(jobs, [job() for job in jobs])
        paths = write_findings(experiment, findings, tmp_path)
        assert {path.name for path in paths} == {f"{name}{end}" for end in (".csv", ".png", "-curves.csv")}
        assert all(path.stat().st_size for path in paths)
        table = from_csv(paths[0].read_text())
        assert table == findings.table
        assert {"force_n", "depth_mm", "time_s"} <= set(findings.curves[0])
        assert experiment.claims(table) == experiment.claims(findings.table)


def test_page_names_its_command_and_finds_its_pictures(tmp_path):
    experiment, findings = evaluated("fig3-5", 1)
    folder = tmp_path / "paper"
    write_findings(experiment, findings, folder)
    write_page(tmp_path / "paper.md", folder, {"fig3-5": findings}, [experiment], "the command")
    page = (tmp_path / "paper.md").read_text()
    assert "the command" in page
    assert "(paper/fig3-5.png)" in page
    assert experiment.claims(findings.table)[0].found in page


def test_figures_are_shown_as_people_read_them():
    assert [digits(v) for v in (None, "x", 5000, 12345.6, 0.12345)] == [
        "–",
        "x",
        "5 000",
        "12 300",
        "0.123",
    ]
    assert markdown([{"a_b": 1}]).splitlines()[0] == "| a b |"


@pytest.fixture(scope="module")
def resolution_findings():
    return evaluated("resolution", 1)


def test_limit_cycles_are_as_predicted_at_every_point(resolution_findings):
    experiment, findings = resolution_findings
    assert len(findings.table) == len(resolution.STIFFNESSES) * len(resolution.RESOLUTIONS_MM)
    for entry in findings.table:
        assert entry["rounding_n"] == pytest.approx(entry["rounding_predicted_n"], rel=0.25)
        assert entry["chain_n"] == pytest.approx(entry["chain_predicted_n"], rel=0.25)
        assert entry["chain_period_s"] == pytest.approx(entry["chain_predicted_period_s"], rel=0.25)
        assert entry["rounding_n"] == pytest.approx(entry["step_force_n"], rel=0.01)
        assert entry["chain_n"] < 0.5 * entry["step_force_n"]
    (claim,) = experiment.claims(findings.table)
    assert claim.found.count("within 25% at 12 of 12 points") == 2


def test_points_off_the_prediction_and_without_one_do_not_count(resolution_findings):
    experiment, findings = resolution_findings
    assert experiment.claims(from_csv(to_csv(findings.table))) == experiment.claims(findings.table)
    first, second, *others = findings.table
    (claim,) = experiment.claims([{**first, "chain_ratio": 1.3}, {**second, "chain_ratio": None}, *others])
    assert "servo with dead band: within 25% at 10 of 12 points" in claim.found
    (claim,) = experiment.claims([{**entry, "chain_ratio": None} for entry in findings.table])
    assert claim.found.endswith("no limit cycle predicted")


def test_comparison_counts_what_is_held():
    experiment = EXPERIMENTS["controllers"]
    jobs = [
        job
        for job in experiment.jobs(1)
        if job.controller in ("fuzzy", "fuzzy-adaptive")
        and job.stiffness in (5e3, 5e4)
        and (job.baudrate, job.noise_counts) == (19200, 1.0)
    ]
    findings = experiment.evaluate(jobs, [job() for job in jobs])
    assert len(findings.table) == 4
    counts = {entry["controller"]: entry["held"] for entry in ranking(findings.table)}
    assert counts["fuzzy"] == sum(held(entry) for entry in findings.table if entry["controller"] == "fuzzy")
    claims = experiment.claims(from_csv(to_csv(findings.table)))
    assert claims == experiment.claims(findings.table)
    assert f"they hold {counts['fuzzy']} of 2 points" in claims[0].found


def test_the_whole_grid_has_every_controller_twice():
    jobs = EXPERIMENTS["controllers"].jobs(1)
    assert {job.controller for job in jobs} == set(CONTROLLERS)
    assert {"pi", "pi+estimate", "admittance", "admittance+estimate"} <= set(variants())
    stiffnesses = {job.stiffness for job in jobs}
    assert len(stiffnesses) >= 6
    assert (min(stiffnesses), max(stiffnesses)) == (500.0, 200_000.0)
    assert {job.baudrate for job in jobs} == {9600, 19200}
    combinations = {
        (job.controller, job.parameters, job.stiffness, job.noise_counts, job.baudrate) for job in jobs
    }
    assert len(combinations) == len(jobs) == len(variants()) * len(stiffnesses) * 2 * 2
