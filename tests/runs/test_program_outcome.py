"""Report lines of the steps of a program, and the exit code from their criteria."""

import json
from pathlib import Path

import pytest

from hil_bridge.record import EventKind, StepRecord, read
from hil_bridge.record.analysis.steps import failed_criteria, step_lines, step_outcomes
from hil_bridge.record.analysis.summary import summarise
from tests.command_line import Command

PROGRAM = """
[cell]
start_position_mm = [900.0, 0.0, 590.3]
[run]
seed = 3
[task]
approach_speed_mm_s = 1
[[task.step]]
do = "approach"
name = "touch"
[[task.step]]
do = "track"
path = {{ kind = "line", length_mm = 10 }}
speed_mm_s = 10
{criterion}
[[task.step]]
do = "retract"
back_mm = 0.5
"""


def record(
    number: int,
    label: str,
    within: float | None = None,
    passed: bool = True,
    text: str = "",
    pass_number: int = 0,
) -> StepRecord:
    """A step that ended after 2 s; it has a criterion of 90 % where `within` is given."""
    return StepRecord(
        at=102.0,
        step=number,
        label=label,
        began_at=100.0,
        way=0.05,
        force_mean=9.876,
        within=within,
        wanted=None if within is None else 0.9,
        passed=passed,
        text=text,
        repeat=int(label[0]) if pass_number else 0,
        turn=pass_number,
    )


def test_step_report_has_time_path_force_criterion() -> None:
    record_ = record(2, "2 (track)", 0.95, text="force within ±1 N: 95.0 % of the path, required 90 %")
    (line,) = step_lines(step_outcomes([record_]))
    assert line == (
        "  step 2 (track)  2.0 s, 50.0 mm, 9.88 N mean, "
        "criterion passed: force within ±1 N: 95.0 % of the path, required 90 %"
    )


def test_step_report_has_position_in_mm_and_name() -> None:
    result = StepRecord(at=3.0, step=1, label="1 (seek)", began_at=1.0, name="edge", found=(0.9, 0.0, 0.59))
    (outcome,) = step_outcomes([result])
    assert outcome.found_mm == pytest.approx((900.0, 0.0, 590.0))
    assert step_lines([outcome]) == ["  step 1 (seek)  2.0 s, edge at 900.00 0.00 590.00 mm"]


def test_repeat_report_has_first_last_and_failed_passes() -> None:
    records: list[StepRecord] = []
    for turn in range(1, 101):
        for number, word in enumerate(("track", "retract", "move"), 1):
            failed = turn == 40 and word == "track"
            label = f"2.{number} ({word}, pass {turn})"
            within = 0.5 if failed else None
            records.append(record(len(records) + 1, label, within, not failed, pass_number=turn))
    lines = step_lines(step_outcomes([record(0, "1 (approach)"), *records]))
    reported = [line.split("  ")[1] for line in lines]
    assert reported == [
        "step 1 (approach)",
        "step 2.1 (track, pass 1)",
        "step 2.2 (retract, pass 1)",
        "step 2.3 (move, pass 1)",
        "… 114 more steps, all done",
        "step 2.1 (track, pass 40)",
        "… 179 more steps, all done",
        "step 2.1 (track, pass 100)",
        "step 2.2 (retract, pass 100)",
        "step 2.3 (move, pass 100)",
    ]


def test_repeat_report_counts_failures_beyond_ten() -> None:
    records = [
        record(turn, f"1.1 (track, pass {turn})", 0.1, passed=False, pass_number=turn)
        for turn in range(1, 31)
    ]
    steps = step_outcomes(records)
    assert step_lines(steps)[-2] == "  … 19 more steps, 19 of them FAILED"
    assert failed_criteria(steps).startswith("criterion failed in 30 steps: 1.1 (track, pass 1), ")
    assert failed_criteria(steps).endswith(", 1.1 (track, pass 10) and 20 more")


def test_interrupted_step_may_meet_its_criterion() -> None:
    good, bad = (record(1, "1 (track)", within, False, "the link broke") for within in (0.95, 0.85))
    good_step, bad_step = step_outcomes([good, bad])
    assert not good_step.criterion_failed
    assert bad_step.criterion_failed
    assert step_lines([good_step])[0].endswith("9.88 N mean, CUT")


@pytest.mark.parametrize(("percent", "code"), [(20.0, 0), (100.0, 4)])
def test_failed_criterion_gives_exit_code_4(
    percent: float,
    code: int,
    tmp_path: Path,
    hil: Command,
) -> None:
    config, file, summary = (tmp_path / name for name in ("task.toml", "run.mcap", "summary.json"))
    criterion = f"criterion = {{ within_n = 1.0, for_percent = {percent} }}"
    config.write_text(PROGRAM.format(criterion=criterion))
    arguments = ("run", str(config), "--robot", "egm", "--virtual", "--no-view")
    exit_code, output, errors = hil(*arguments, "--record", file, "--summary", summary)
    assert exit_code == code, errors
    assert output.startswith("completed\n  step 1 (approach)  ")
    assert ("criterion FAILED" in output) == (code == 4)
    assert errors.startswith("hil-bridge: criterion failed in step 2 (track): force within") == (code == 4)
    data = json.loads(summary.read_text())
    assert [step["label"] for step in data["steps"]] == ["1 (approach)", "2 (track)", "3 (retract)"]
    assert data["criteria_failed"] == (["2 (track)"] if code else [])
    touch = data["steps"][0]
    assert touch["name"] == "touch"
    assert touch["found_mm"][2] == pytest.approx(590.0, abs=0.5)
    result = summarise(read(file))
    assert result.steps[1].way_mm == pytest.approx(10.0, abs=0.5)
    assert result.outcome == "completed"


@pytest.mark.full
def test_run_stopped_by_error_names_step(tmp_path: Path, hil: Command) -> None:
    config, file = tmp_path / "task.toml", tmp_path / "run.mcap"
    text = PROGRAM.format(criterion="")
    config.write_text(f'{text}\n[[faults]]\non = "robot"\nfault = "emergency-stop"\nphase = "track"\n')
    code, output, errors = hil(
        *("run", config, "--robot", "rtde", "--virtual", "--no-view", "--record", file)
    )
    assert code == 3, errors
    stopped = next(line for line in errors.splitlines() if line.startswith("hil-bridge: stopped: "))
    assert stopped.count(", in step 2 (track)") == 1
    assert "  step 2 (track)     " in output
    recording = read(file)
    (_, cut) = summarise(recording).steps
    (stop,) = (event.at for event in recording.events if event.kind == EventKind.STOP)
    assert recording.steps[1].at == pytest.approx(stop, abs=1e-6), "without the time of the retraction"
    assert (cut.label, cut.passed) == ("2 (track)", False)
    assert ", in step 2 (track)" in cut.text
