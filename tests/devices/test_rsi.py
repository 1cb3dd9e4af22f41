"""KUKA robot with RSI in complete runs: force, reproducibility, and refusals with a reason."""

import json
import math
import statistics
from pathlib import Path

import pytest
from click.testing import CliRunner

from emulators.devices.rsi import RSI_FAULTS
from hil_bridge.api import Result, simulate
from hil_bridge.cli import cli
from hil_bridge.devices.kinds import ROBOTS, robot_of
from hil_bridge.errors import ConfigError, DeviceError
from hil_bridge.record import Outcome, read
from hil_bridge.record.device_facts import devices_of
from hil_bridge.settings.configuration import load_config
from hil_bridge.settings.kinds import settings_of
from tests.near_surface import AWAKE_TOML

pytestmark = pytest.mark.sweep

BASE = (
    '[run]\nperiod_ms = 20\n[controller]\nsample_ms = 20\n[robot]\nemulated = "rsi"\n'
    "[task]\nretract_mm = 2.0\nretract_speed_mm_s = 20.0\napproach_depth_limit_mm = 20.0\n"
)
ABSOLUTE = '[robot.rsi]\nmode = "absolute"\n[cell.rsi]\nmode = "absolute"\n'
SLOW = "[robot.rsi]\ncycle_ms = 12\n[cell.rsi]\ncycle_ms = 12\n"
PERIOD = {SLOW: 24}
AXES = '[robot.rsi]\ncorrection = "axes"\nmode = "%s"\n[cell.rsi]\ncorrection_tag = "None"\nmode = "%s"\n'
AXES_ABSOLUTE, AXES_RELATIVE = (AXES % (mode, mode) for mode in ("absolute", "relative"))
"""Program that accepts corrections of its axes only."""
NEAR = f"{AWAKE_TOML}cell.start_position_mm = [900.0, -100.0, 590.5]\n"
"""Start of a file: a position just above the surface, and a sensor that starts quickly."""

CELL = "[cell]\njr3.gateway.boot_s = 0.2\nstart_position_mm = [900.0, -100.0, 59%s]\n"
UNDER_GUARD = CELL % "0.5" + "[limits]\nretract_patience_s = 0.3\nfollowing_error_mm = 2.0\n"
"""Settings for runs that a fault ends."""
WAVE = CELL % "1.0" + '[cell.surface]\nkind = "sinusoidal"\namplitude_mm = 5.0\nperiod_mm = 200.0\n'
"""Contour that rises and falls."""


def write_config(folder: Path, more: str = "") -> Path:
    file = folder / "rsi.toml"
    near = "" if "[cell]" in more else NEAR
    file.write_text(near + BASE.replace("= 20", f"= {PERIOD.get(more, 20)}") + more)
    return file


def invoke(folder: Path, more: str = "", *arguments: str) -> tuple[int, str]:
    command = ["run", str(write_config(folder, more)), "--virtual", "--no-view", *arguments]
    result = CliRunner().invoke(cli, command, catch_exceptions=False)
    return result.exit_code, result.output


NEXT = "with = { probability = 1.0, "
"""Start of the parameters of a fault that affects every telegram."""


def run_emulated(folder: Path, more: str, duration_s: float = 2.0, controller: str | None = None) -> Result:
    text = BASE.replace("period_ms", f"duration_s = {duration_s}\nperiod_ms") + more
    file = folder / "rsi.toml"
    file.write_text(text)
    return simulate(load_config(file, {"controller.name": controller}))


def with_fault(folder: Path, on: str, fault: str, more: str = "", options: str = "") -> Result:
    row = f'[[faults]]\non = "{on}"\nfault = "{fault}"\nphase = "track"\nafter_s = 0.3\n{options}'
    if RSI_FAULTS[on][fault].lasts_s is not None:
        row += "for_s = 0.6\n"
    return run_emulated(folder, UNDER_GUARD + more + row, duration_s=1.5)


def largest_impact(run: Result) -> int:
    (text,) = (event.text for event in run.events if " struck " in event.text)
    return int(text.split(" struck ")[1].split()[0])


# --- the loop


@pytest.mark.parametrize(
    "more",
    ["", ABSOLUTE, SLOW, AXES_ABSOLUTE, AXES_RELATIVE],
    ids=["relative", "absolute", "12 ms", "axes, absolute", "axes, relative"],
)
def test_rsi_run_holds_ten_newtons(more: str, tmp_path: Path) -> None:
    summary = tmp_path / "s.json"
    code, output = invoke(tmp_path, more, "--duration", "1.5", "--no-record", "--summary", str(summary))
    assert code == 0, output
    figures = json.loads(summary.read_text())
    assert figures["outcome"] == "completed"
    assert figures["force_mean_steady_n"] == pytest.approx(10.0, abs=0.5)
    assert figures["figures"]["contact_losses"] == 0
    assert figures["link"]["packets"] == figures["link"]["answers"]
    assert set(figures["link"]) == {"packets", "answers"}  # no telegram was late or lost


def test_rsi_run_holds_force_on_contour(tmp_path: Path) -> None:
    run = run_emulated(tmp_path, WAVE, duration_s=3.0)
    assert run.outcome is Outcome.COMPLETED
    tracked = [cycle for cycle in run.cycles if cycle.phase == "track"]
    assert all(cycle.in_contact for cycle in tracked)
    errors = [cycle.force - 10.0 for cycle in tracked[50:]]
    assert statistics.fmean(errors) == pytest.approx(0.0, abs=0.5)
    assert math.sqrt(statistics.fmean(error**2 for error in errors)) < 1.0
    depths = [cycle.depth for cycle in tracked]
    assert max(depths) - min(depths) > 2e-3  # it went up and down with the surface


@pytest.mark.full
def test_rsi_axis_corrections_hold_same_force(tmp_path: Path) -> None:
    """The fuzzy-adaptive controller on a contour: the same set points reach the robot by either channel."""
    runs = [
        run_emulated(tmp_path, WAVE + channel, 2.0, "fuzzy-adaptive") for channel in (ABSOLUTE, AXES_ABSOLUTE)
    ]
    forces = [[cycle.force for cycle in run.cycles if cycle.phase == "track"] for run in runs]
    assert len(forces[0]) == len(forces[1]) > 50
    assert max(abs(a - b) for a, b in zip(*forces, strict=True)) < 0.1
    assert statistics.fmean(forces[1][50:]) == pytest.approx(10.0, abs=1.0)


@pytest.mark.parametrize(
    "faults",
    [
        (("sensor", "unplugged"),),
        (("robot", "stands"),),
        (("robot", "limit"),),
        (("wire", "off"),),
        (("wire", "late"),),
        (("wire", "lost"), ("sensor", "unplugged")),
        (("pose", "nan"),),
        (("robot", "program-restarted"),),
    ],
)
def test_rsi_guard_limits_axis_corrections(faults: tuple[tuple[str, str], ...], tmp_path: Path) -> None:
    rows = "".join(
        f'[[faults]]\non = "{on}"\nfault = "{fault}"\nphase = "track"\nafter_s = 0.3\n'
        for on, fault in faults
    )
    run = run_emulated(tmp_path, UNDER_GUARD + AXES_ABSOLUTE + rows, duration_s=1.5)
    assert sum(" struck " in event.text for event in run.events) == len(faults)
    assert run.outcome is Outcome.STOPPED
    assert max(cycle.force for cycle in run.cycles) < 15.0


@pytest.mark.full
def test_rsi_runs_with_same_seed_are_identical(tmp_path: Path) -> None:
    records = [tmp_path / f"{name}.mcap" for name in ("one", "again")]
    for record in records:
        code, output = invoke(tmp_path, "", "--duration", "0.5", "--seed", "7", "--record", str(record))
        assert code == 0, output
    assert records[0].read_bytes() == records[1].read_bytes()
    for command in ("replay", "latency"):
        result = CliRunner().invoke(cli, [command, str(records[0])], catch_exceptions=False)
        assert result.exit_code == 0, result.output
    devices = devices_of(read(records[0]))
    assert (devices.robot.kind, devices.robot.cycle_s) == ("rsi", 0.004)
    assert devices.robot.model == "KUKA controller with RSI, relative corrections"
    assert devices.robot.servo is not None
    assert devices.robot.servo.marks["interpolation_s"] == "observed"


def test_rsi_url_selects_kind_and_sections(tmp_path: Path) -> None:
    assert robot_of("rsi+udp-bind://127.0.0.1:49152")[0].name == "rsi"
    config = load_config(write_config(tmp_path, ABSOLUTE), {})
    assert settings_of(config, ROBOTS.kind("rsi")).client.mode == "absolute"
    for wrong, text in [
        ('[robot.rsi]\nmode = "both"\n', "relative"),
        ("[robot.rsi]\ncycle_ms = 5\n", "4"),
        ("[cell.rsi]\nlim_mm = -1\n", "lim_mm must be more than 0"),
        ('[cell.rsi]\nsend = ["a b"]\n', "is not a valid tag"),
    ]:
        with pytest.raises(ConfigError, match=text):
            load_config(write_config(tmp_path, wrong), {})


# --- refusals


@pytest.mark.parametrize(
    ("on", "fault", "message"),
    [
        ("robot", "emergency-stop", "its program does not run (ProgStatus 4); release its stops"),
        ("robot", "stands", "mm from the commanded one, allowed: at most 2 mm"),
        ("robot", "limit", "mm from the commanded one, allowed: at most 2 mm"),
        ("robot", "guidance-ended", "sent nothing for 0.5 s"),
        ("robot", "program-restarted", "its program restarted, or moves by itself"),
        ("robot", "drives-stop", "sent nothing for 0.5 s"),
        ("robot", "out-of-limits", "sent nothing for 0.5 s"),
        ("wire", "off", "sent nothing for 0.5 s"),
        ("wire", "garbled", "sent nothing for 0.5 s"),
        ("wire", "late", "answers in a row"),
        ("wire", "mute", "sent nothing for 0.5 s"),
        ("wire", "malformed", "sent nothing for 0.5 s"),
        ("pose", "nan", "not a number"),
        ("pose", "missing", "sent nothing for 0.5 s"),
        ("robot", "clock-jump", "its clock jumped"),
        ("wire", "deaf", "answers in a row"),
    ],
)
def test_rsi_refusal_ends_run_with_one_line(on: str, fault: str, message: str, tmp_path: Path) -> None:
    run = with_fault(tmp_path, on, fault)
    assert largest_impact(run) > 0
    assert run.outcome is Outcome.STOPPED
    assert message in run.text
    assert "\n" not in run.text
    assert max(cycle.force for cycle in run.cycles) < 15.0


@pytest.mark.parametrize(
    ("fault", "options", "more"),
    [
        ("lost", "", ABSOLUTE),
        ("corrupted", "", ABSOLUTE),
        ("twice", "", ""),
        ("lost", NEXT + 'count = 20, way = "from" }\n', ABSOLUTE),
        ("lost", NEXT + 'count = 3, way = "from" }\n', ""),
        ("twice", NEXT + 'way = "from" }\n', ""),
        ("reordered", 'with = { way = "from" }\n', ABSOLUTE),
        ("lost", NEXT + 'count = 3, way = "to" }\n', ""),
        ("lost", NEXT + 'count = 3, way = "to" }\n', ABSOLUTE),
    ],
)
def test_rsi_run_tolerates_slightly_lossy_network(
    fault: str, options: str, more: str, tmp_path: Path
) -> None:
    run = with_fault(tmp_path, "wire", fault, more, options)
    assert largest_impact(run) > 0
    assert run.outcome is Outcome.COMPLETED
    forces = [cycle.force for cycle in run.cycles if cycle.phase == "track"][-10:]
    assert statistics.fmean(forces) == pytest.approx(10.0, abs=0.5)
    # set point and robot stay together despite any loss
    stops = [
        math.dist(cycle.sample.position, cycle.target) for cycle in run.cycles if cycle.phase == "track"
    ][-20:]
    assert max(stops) == pytest.approx(0.35e-3, abs=0.05e-3)  # the distance travelled during the robot's lag


@pytest.mark.parametrize(
    ("fault", "options", "message"),
    [
        ("turned", "degrees = 2.5", "a tool turned by 2.5° from the start, allowed: at most 2°"),
        ("offset", "x_mm = 5.0", "the reported position jumped by 5.0 mm"),
        ("drift", "z_mm_s = 20.0", "mm behind all that was ordered in the last "),
        ("mirrored", 'axis = "y"', "mm from the commanded one, allowed: at most 2 mm"),
        ("late", "ms = 500.0", "mm"),
        ("frozen", "", "mm from the commanded one, allowed: at most 2 mm"),
    ],
)
def test_rsi_guard_limits_tilt_speed_and_following(
    fault: str, options: str, message: str, tmp_path: Path
) -> None:
    run = with_fault(tmp_path, "pose", fault, options=f"with = {{{options}}}\n")
    assert run.outcome is Outcome.STOPPED
    assert message in run.text
    assert run.left.startswith("retracted")
    assert max(cycle.force for cycle in run.cycles) < 20.0


def test_rsi_every_fault_is_covered() -> None:
    assert {name for faults in RSI_FAULTS.values() for name in faults} == {
        "emergency-stop", "stands", "limit", "guidance-ended", "program-restarted", "drives-stop", "out-of-limits",
        "clock-jump", "offset", "drift", "turned", "mirrored", "late", "frozen", "nan", "missing",
        "off", "mute", "deaf", "lost", "twice", "corrupted", "garbled", "malformed", "reordered",
    }  # fmt: skip


def test_rsi_refused_run_exits_with_code_3(tmp_path: Path) -> None:
    row = '[[faults]]\non = "wire"\nfault = "deaf"\nphase = "track"\nafter_s = 0.2\n'
    code, output = invoke(tmp_path, row, "--duration", "1", "--no-record")
    assert code == 3
    assert "it has not accepted" in output


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ('[cell.rsi]\nmode = "absolute"\n', "mm"),  # complete values are added as corrections
        ('[robot.rsi]\nmode = "absolute"\n', "mm"),
        ('[robot.rsi]\nsentype = "Other"\n', "SENTYPE"),
        ('[robot.rsi]\ncorrection_tag = "AKorr"\n', "mm"),
        ("[cell.rsi]\nlim_mm = 0.2\n", "mm"),
        ('[cell.rsi]\nref = "tool"\n', "mm"),
        ('[robot.rsi]\ncorrection = "axes"\nmode = "absolute"\n', "mm"),  # each complete value is added
        ('[robot.rsi]\ncorrection = "axes"\n[cell.rsi]\naxis_tags = ["AKorr"]\n', "mm"),
    ],
)
def test_rsi_setup_mismatch_is_refused_early(more: str, message: str, tmp_path: Path) -> None:
    code, output = invoke(tmp_path, more, "--duration", "1", "--no-record")
    assert code == 3, output
    assert message in output


def test_rsi_telegrams_without_axes_are_refused(tmp_path: Path) -> None:
    more = '[robot.rsi]\ncorrection = "axes"\n[cell.rsi]\nsend = ["DEF_RIst", "DEF_RSol"]\n'
    with pytest.raises(DeviceError, match=r"have no AIPos, .* add DEF_AIPos to"):
        invoke(tmp_path, more, "--duration", "1", "--no-record")


def test_rsi_fault_table_matches_emulated_robot(tmp_path: Path) -> None:
    row = '[[faults]]\non = "wire"\nfault = "unheard"\n'
    with pytest.raises(
        ConfigError, match="unknown fault 'unheard' for target 'wire'; known: off, mute, deaf, lost"
    ):
        load_config(write_config(tmp_path, row), {})
    assert any("rsi" in kind for kind in ROBOTS.names)
