"""Faults as configuration: when they occur, what they cause, how a run records them, and which are refused."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from hil_bridge.api import Result, simulate
from hil_bridge.cli import cli
from hil_bridge.clock import Clock, run_virtual
from hil_bridge.control import Command, Measurement
from hil_bridge.control.course.intent import CONNECT, TARE, Phase
from hil_bridge.errors import ConfigError
from hil_bridge.record import EventKind, EventRecord, TruthRecord, read
from hil_bridge.record.topics import TRUTH
from hil_bridge.runs.faults.schedule import FaultSchedule
from hil_bridge.runs.faults.wrong_controller import LyingController
from hil_bridge.runs.session import Outputs, execute
from hil_bridge.settings.configuration import Config, load_config, read_config
from hil_bridge.settings.faults import PHASES, FaultConfig
from hil_bridge.settings.template import schema
from tests.near_surface import NEAR
from tests.paper_cell import CELL_FAULTS, PaperCellProfile, s3_jr3_cell

pytestmark = pytest.mark.sweep

NEEDED: dict[tuple[str, str], dict[str, Any]] = {
    ("signal", "stuck"): {"phase": "approach", "after_s": 0.2},
    ("sensor", "wrong-scales"): {"phase": "connect", "after_s": 0.0},
    ("obstacle", "above"): {"phase": "retract", "after_s": 0.0},
}
"""Settings of a fault, beyond its defaults, that give an effect one second after the start of tracking."""
EVERY = [(target, fault) for target, faults in CELL_FAULTS.items() for fault in faults]


def run_with(*faults: dict[str, Any], duration_s: float = 2.0, **sections: Any) -> Result:
    config = {"run": {"duration_s": duration_s}, "faults": list(faults), **sections}
    return simulate(read_config(config))


def texts(run: Result) -> list[str]:
    return [event.text for event in run.events if event.kind == EventKind.FAULT]


def struck(run: Result, target: str, fault: str) -> int:
    (count,) = (
        int(result[1])
        for text in texts(run)
        if (result := re.fullmatch(rf"{target}: {fault} struck (\d+) times?.*", text))
    )
    return count


@pytest.mark.parametrize(
    ("target", "fault"), [name for name in EVERY if name[0] in ("surface", "obstacle", "bus")]
)
def test_cell_fault_is_injected_and_has_effect(target: str, fault: str) -> None:
    """Those of the devices are in tests/record/test_why.py."""
    row = {"on": target, "fault": fault, "phase": "track", "after_s": 0.5, **NEEDED.get((target, fault), {})}
    run = run_with(
        row, **(NEAR if target != "obstacle" else {})
    )  # the path back must be long enough to meet one
    assert struck(run, target, fault) > 0
    assert re.match(rf"{target}: {fault} (\(.*\) )?(begins|happens)", texts(run)[0])


@pytest.mark.parametrize("receiver", ["jr3-uart", "jr3-board"])
@pytest.mark.parametrize(
    ("target", "fault"),
    [
        ("signal", "scale"),
        ("signal", "noise"),
        ("signal", "stuck"),
        ("sensor", "wrong-scales"),
        ("sensor-wire", "lost"),
    ],
)
def test_other_sensors_have_their_faults(receiver: str, target: str, fault: str) -> None:
    row = {"on": target, "fault": fault, "phase": "track", "after_s": 1.0, **NEEDED.get((target, fault), {})}
    if (receiver, target) == ("jr3-board", "sensor-wire"):
        with pytest.raises(
            ValueError,
            match=r"sensor-wire: lost needs sensor.emulated = ati-can or .*, not jr3-board",
        ):
            run_with(row, **NEAR, sensor={"emulated": receiver})
    else:
        sensor = {"emulated": receiver, "unchecked": fault == "wrong-scales"}
        assert struck(run_with(row, **NEAR, sensor=sensor), target, fault) > 0


def test_computer_pause_needs_support_of_bridge() -> None:
    paused: list[float] = []

    async def main() -> None:
        clock = Clock.running()
        cell = s3_jr3_cell(PaperCellProfile(), clock.now(), 1)
        fault = FaultConfig.model_validate(
            {"on": "computer", "fault": "pause", "phase": "track", "with": {"seconds": 0.25}}
        )
        with pytest.raises(ConfigError, match=r"^faults\.0: this run cannot pause its own process$"):
            FaultSchedule((fault,), cell, clock, lambda record: None)
        schedule = FaultSchedule((fault,), cell, clock, lambda record: None, paused.append)
        schedule.event(EventRecord(clock.now(), EventKind.PHASE, "track"))
        assert [(injection.name, injection.struck) for injection in cell.faults] == [("computer: pause", 1)]

    run_virtual(main)
    assert paused == [0.25]


# --- when


def events(run: Result) -> list[tuple[float, str]]:
    return [(event.at, event.text) for event in run.events if event.kind == EventKind.FAULT]


def test_fault_starts_and_ends_at_exact_times() -> None:
    run = run_with(
        {
            "on": "signal",
            "fault": "offset",
            "phase": "track",
            "after_s": 0.7,
            "for_s": 0.4,
            "with": {"amount": 3},
        }
    )
    (tracked,) = (event.at for event in run.events if (event.kind, event.text) == (EventKind.PHASE, "track"))
    started, ended, _ = events(run)
    assert started == (tracked + 0.7, "signal: offset (axis fz, amount 3) begins for 0.4 s")
    assert ended == (tracked + 0.7 + 0.4, "signal: offset ends")


@pytest.mark.parametrize(
    ("when", "reached"),
    [
        ("force > 8", lambda record: record.force > 8.0),
        ("depth_mm > 10.5", lambda record: record.depth > 10.5e-3),
        ("travel_mm > 5", lambda record: record.travel_commanded > 5e-3),
        ("cycle > 20", lambda record: record.cycle > 20),
        ("depth_mm < -3", lambda record: record.depth < -3e-3),
    ],
)
def test_fault_condition_is_checked_each_cycle(when: str, reached: Callable[[Any], bool]) -> None:
    run = run_with({"on": "pose", "fault": "frozen", "when": when, "for_s": 0.0})
    first = next((record.answered_at for record in run.cycles if reached(record)), None)
    started = [at for at, text in events(run) if "begins" in text]
    assert started == ([] if first is None else [first])
    if first is None:
        assert texts(run) == ["pose: frozen never occurred: its phase or condition did not"]


def test_fault_condition_may_depend_on_phase() -> None:
    run = run_with({"on": "pose", "fault": "frozen", "when": "cycle > 3", "phase": "track"})
    first = next(record.answered_at for record in run.cycles if record.phase == "track" and record.cycle > 3)
    assert events(run)[0][0] == first


def test_run_is_unchanged_before_fault() -> None:
    clean = run_with()
    broken = run_with(
        {"on": "signal", "fault": "scale", "phase": "track", "after_s": 1.0, "with": {"factor": 2}}
    )
    at, _ = events(broken)[0]
    before = [record for record in clean.cycles if record.answered_at < at]
    assert len(before) > 20
    assert before == list(broken.cycles[: len(before)])
    assert clean.cycles[len(before) + 1] != broken.cycles[len(before) + 1]
    assert texts(clean) == []


def test_same_fault_gives_same_run() -> None:
    row = {"on": "wire", "fault": "lost", "phase": "track", "with": {"probability": 0.01}}
    first, second = run_with(row), run_with(row)
    assert (first.cycles, first.events, first.text) == (second.cycles, second.events, second.text)


# --- consequences of faults


def test_fault_switch_is_restored_at_end() -> None:
    run = run_with({"on": "robot", "fault": "safeguard-stop", "phase": "connect", "for_s": 0.5})
    assert run.outcome == "completed"
    assert texts(run)[1] == "robot: safeguard-stop ends"


def test_cell_obstacle_pushes_back() -> None:
    obstacle = {"height_mm": 2.0, "stiffness_n_m": 20000.0}
    free, stopped = run_with(), run_with(cell={"obstacle": obstacle})
    assert min(record.force for record in free.cycles) > -2.0
    assert min(record.force for record in stopped.cycles) < -10.0


def test_wrong_scale_is_read_by_bridge() -> None:
    row = {"on": "sensor", "fault": "wrong-scales", "with": {"factor": 0.5}}
    unchecked = {"sensor": {"unchecked": True}, "task": {"unverified_depth_mm": 15.0}}
    run = run_with(row, duration_s=6.0, **unchecked)
    right = run_with(duration_s=6.0)
    wrong_depth, right_depth = (
        next(cycle.depth for cycle in reversed(each.cycles) if cycle.phase == "track")
        for each in (run, right)
    )
    assert wrong_depth - right_depth == pytest.approx(2e-3, abs=0.3e-3), (
        "a reading of 10 N is 20 N, 2 mm deeper at 5 kN/m"
    )


# --- the record


def test_recording_contains_faults(tmp_path: Path) -> None:
    row = {
        "on": "surface",
        "fault": "step",
        "phase": "track",
        "after_s": 0.5,
        "for_s": 1.0,
        "with": {"mm": 0.5},
    }
    config = read_config({"run": {"duration_s": 3.0}, "faults": [row]})
    assert execute(config, True, Outputs(record=tmp_path / "run.mcap"), view=False) == 0
    recording = read(tmp_path / "run.mcap")
    events = [event for event in recording.events if event.kind == EventKind.FAULT]
    assert [event.text.partition(" (")[0].partition(" struck")[0] for event in events] == [
        "surface: step",
        "surface: step ends",
        "surface: step",
    ]
    for truth in recording.truths:
        active = events[0].at <= truth.at < events[1].at
        assert truth.faults == (("surface: step",) if active else ())
    assert any(truth.faults for truth in recording.truths)
    assert read_config(json.loads(recording.metadata["config"])) == config


# --- refused faults


@pytest.mark.parametrize(
    ("row", "text"),
    [
        ({}, "faults.0: unknown target ''; known: robot, pose, wire, signal"),
        (
            {"on": "signal", "fault": "melted"},
            "faults.0: unknown fault 'melted' for target 'signal'; known: stuck",
        ),
        (
            {"on": "signal", "fault": "scale", "with": {"axes": "fz"}},
            "faults.0: signal: scale has no parameter 'axes'; known: axis, factor, for_s",
        ),
        (
            {"on": "signal", "fault": "scale", "with": {"factor": "big"}},
            "faults.0: signal: scale: factor must be a number of -100 … 100, got 'big'",
        ),
        ({"on": "pose", "fault": "offset"}, "faults.0: pose: offset: give x_mm or y_mm or z_mm; all are 0"),
        (
            {"on": "signal", "fault": "swapped", "with": {"other": "fz"}},
            "faults.0: signal: swapped: axis and other must differ",
        ),
        (
            {"on": "robot", "fault": "power-cycle", "for_s": 1.0},
            "faults.0: robot: power-cycle has no parameter 'for_s'; known: after_bytes",
        ),
        (
            {"on": "signal", "fault": "dead", "for_s": -1.0},
            "faults.0: signal: dead: for_s must be a number of",
        ),
        (
            {"on": "signal", "fault": "dead", "when": "force > x"},
            "faults.0.when must be one of force, depth_mm, travel_mm, cycle, then < or >, then a number",
        ),
        ({"on": "signal", "fault": "dead", "when": "force >= 8"}, "faults.0.when must be one of"),
        ({"on": "signal", "fault": "dead", "when": "__import__ > 8"}, "faults.0.when must be one of"),
        ({"on": "signal", "fault": "dead", "when": "force > " + "9" * 5000}, "faults.0.when must be one of"),
        ({"on": "signal", "fault": "dead", "phase": "end"}, "faults.0.phase: must be"),
        ({"on": "signal", "fault": "dead", "after_s": -1}, "faults.0.after_s: must be"),
        ({"on": "signal", "fault": "dead", "why": 1}, "faults.0.why is not a setting"),
        (3, "faults.0 must be a table of settings"),
        (
            {"on": "sensor", "fault": "unplugged", "with": {"sensor": "second"}},
            "faults.0: sensor: unplugged with sensor = second needs sensor.emulated = jr3-board, not jr3",
        ),
    ],
)
def test_invalid_fault_is_refused_in_configuration(tmp_path: Path, row: Any, text: str) -> None:
    with pytest.raises(ConfigError, match=r"^[^\n]+$") as refused:
        _read(tmp_path, {"faults": [row]})
    assert text in str(refused.value)


def test_fault_may_start_in_every_phase_except_end() -> None:
    assert set(PHASES) == {"", CONNECT, TARE, *map(str, Phase)} - {str(Phase.END)}
    for phase in PHASES:
        FaultConfig.model_validate({"on": "signal", "fault": "dead", "phase": phase})
    row = schema()["$defs"]["FaultConfig"]["properties"]["phase"]
    assert row["enum"] == [*PHASES]


def test_invalid_fault_names_its_index(tmp_path: Path) -> None:
    good = {"on": "signal", "fault": "dead"}
    with pytest.raises(ConfigError, match=r"faults\.1: unknown fault 'tired' for target 'wire'; known: off"):
        _read(tmp_path, {"faults": [good, {"on": "wire", "fault": "tired"}]})


class Deeper:
    """Controller that moves a millimetre deeper in each sample."""

    name = "deeper"

    def initial(self) -> int:
        return 0

    def step(self, state: int, measurement: Measurement, reference: float) -> tuple[int, Command]:
        return state + 1, Command((state + 1) * 1e-3, 0.0)


def test_controller_fault_has_start_and_duration() -> None:
    lying = LyingController(Deeper(), "deeper", {"mm": 100.0}, after_s=0.5, for_s=0.5, sample_ms=250.0)
    state, answers = lying.initial(), []
    for time in (10.0, 10.25, 10.5, 10.75, 11.0):
        state, command = lying.step(state, Measurement(time, 5.0, 0.0, 0.0), 10.0)
        answers.append(command.position * 1e3)
    assert answers == pytest.approx([1.0, 2.0, 103.0, 104.0, 5.0])


@pytest.mark.parametrize(
    ("urls", "row", "text"),
    [
        (
            {"robot.url": "s3+tcp://h:1", "sensor.url": "jr3-uart+tcp://h:2"},
            {"on": "pose", "fault": "frozen"},
            "faults.0: pose: frozen needs the emulated cell, but robot.url names a real robot",
        ),
        (
            {"sensor.url": "jr3+can+socketcan://can0"},
            {"on": "surface", "fault": "rises"},
            "faults.0: surface: rises needs the emulated sensor, but sensor.url names a real one",
        ),
    ],
)
def test_real_port_has_no_injected_faults(
    tmp_path: Path, urls: dict[str, object], row: dict[str, Any], text: str
) -> None:
    with pytest.raises(ConfigError) as refused:
        _read(tmp_path, {"faults": [row]}, urls)
    assert text in str(refused.value)


def _read(folder: Path, values: dict[str, Any], overrides: dict[str, object] | None = None) -> Config:
    file = folder / "c.toml"
    rows = values["faults"]
    file.write_text(f"faults = [{', '.join(map(_toml, rows))}]\n", encoding="utf-8")
    return load_config(file, overrides or {})


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_toml(item)}" for key, item in value.items()) + "}"
    return json.dumps(value)


@pytest.mark.parametrize(
    ("command", "instead"),
    [
        (("emulate", "cell"), ", or inject with `hil-bridge panel`, see --panel"),
        (("emulate", "robot"), ", or inject with `hil-bridge panel`, see --panel"),
        (("emulate", "sensor"), ""),
        (("identify", "tool", "--virtual"), ""),
    ],
)
def test_commands_without_phases_refuse_planned_faults(
    tmp_path: Path, command: tuple[str, ...], instead: str
) -> None:
    """A panel is named where the command can serve one."""
    file = tmp_path / "c.toml"
    file.write_text('[[faults]]\non = "signal"\nfault = "dead"\n', encoding="utf-8")
    with pytest.raises(
        ConfigError, match=r"faults\.0: hil-bridge .* would ignore the fault; delete \[\[faults\]\]"
    ) as error:
        cli.main([*command, str(file)], standalone_mode=False)
    assert str(error.value).partition("[[faults]]")[2] == instead


# --- the list


def test_list_faults_supports_text_and_json() -> None:
    output = CliRunner().invoke(cli, ["list", "faults"]).output
    listed = json.loads(CliRunner().invoke(cli, ["list", "faults", "--json"]).output)
    assert {target: set(faults) for target, faults in listed.items()} == {
        target: set(faults) for target, faults in CELL_FAULTS.items()
    }
    for target, fault in EVERY:
        assert f"\n{target}\n" in f"\n{output}"
        assert f"\n  {fault} " in output
        assert set(listed[target][fault]["parameters"]) == set(CELL_FAULTS[target][fault].all_parameters)
    assert listed["signal"]["scale"]["parameters"]["for_s"]["default"] is None


def test_truth_of_old_recording_has_no_faults() -> None:
    reported = {"cycle": 1, "at": 2.0, "sampled_at": 1.9, "motion_at": None}
    truth = {**reported, "position": [0, 0, 0], "force": [0, 0, 9], "joints_deg": [0] * 6}
    record = TRUTH.decode(json.dumps(truth).encode())
    assert isinstance(record, TruthRecord)
    assert record.faults == ()
    with pytest.raises(ValueError, match="missing required field `force`"):
        TRUTH.decode(json.dumps({**reported, "position": [0, 0, 0]}).encode())
