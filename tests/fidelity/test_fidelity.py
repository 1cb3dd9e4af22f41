"""Recordings of emulated devices, compared with emulated devices: equal ones have no difference, others exactly their
own.
"""

import csv
import json
import math
import sys
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from hil_bridge.cli import cli
from hil_bridge.errors import ConfigError
from hil_bridge.errors.extras import install_command
from hil_bridge.lab.fidelity.comparing import Comparison, Line
from hil_bridge.lab.fidelity.emulating import emulate_robot
from hil_bridge.lab.fidelity.measures import LEAST_SAMPLES
from hil_bridge.lab.fidelity.sensing import emulate_sensor, with_load
from hil_bridge.lab.fidelity.subjects import STANDSTILL, Measured, compare_with
from hil_bridge.lab.fidelity.tables import Table, read_table
from hil_bridge.lab.fidelity.units import FAMILIES, ROTATION, UNITS, WRENCH
from hil_bridge.settings.configuration import load_config
from tests.emulation.exact_arm import NO_ERROR
from tests.near_surface import STILL

pytestmark = pytest.mark.sweep

Settings = Mapping[str, Any]
EXACT: Settings = {f"cell.rtde.{name}": value for name, value in NO_ERROR.items()}
"""Universal Robot without noise, so that only the tested property remains."""
WHITE: Settings = {f"cell.netft.{name}": value for name, value in STILL.items()}
"""Net F/T with white noise only."""


def rise(times: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Return a smooth motion between two standstills, without a step in speed."""
    return 0.5 * (1.0 - np.cos(1.6 * times))


def robot_table(kind: str, orders: Table, settings: Settings) -> Table:
    """Return a recording of an emulated robot that replayed orders."""
    return emulate_robot(load_config(None, {"robot.emulated": kind, **settings}), orders)


def compare(kind: str, measured: Table, folder: Path, settings: Settings) -> Comparison:
    """Compare a recording with the emulated device, with settings by dotted key."""
    file = folder / "cell.toml"
    sections: dict[str, list[str]] = {}
    for key, value in settings.items():
        section, _, name = key.rpartition(".")
        sections.setdefault(section, []).append(f"{name} = {json.dumps(value)}")
    file.write_text("\n".join(f"[{name}]\n" + "\n".join(rows) for name, rows in sections.items()))
    return compare_with(kind, Measured(measured), file, 3).comparison


def line(comparison: Comparison, output: str) -> Line:
    return next(each for each in comparison.lines if each.output == output)


def places(kind_cycle_s: float) -> Table:
    times = np.arange(0.0, 4.0, kind_cycle_s)
    motion = {"order_x": 0.02 * rise(times), "order_y": np.zeros(len(times)), "order_z": -0.01 * rise(times)}
    return Table(times, motion)


@pytest.mark.parametrize("kind", ["rsi", "egm", "rtde"])
def test_same_robot_has_no_difference(kind: str, tmp_path: Path) -> None:
    settings = EXACT if kind == "rtde" else {}
    measured = robot_table(kind, places(0.004), settings)
    for axis in ("x", "z"):
        result = line(compare(kind, measured, tmp_path, settings), axis)
        assert result.source == f"order_{axis}"
        assert result.measured.lag_s > 0.0
        assert result.emulated.lag_s == pytest.approx(result.measured.lag_s, abs=2e-4)
        assert result.emulated.rest_rms == pytest.approx(result.measured.rest_rms, rel=0.1)
        assert result.apart_s == pytest.approx(0.0, abs=3e-4)
        assert result.apart_rms < 1e-5


def test_longer_transport_delay_is_measured(tmp_path: Path) -> None:
    measured = robot_table("rsi", places(0.004), {"cell.rsi.transport_delay_ms": 8.0})
    result = line(compare("rsi", measured, tmp_path, {"cell.rsi.transport_delay_ms": 20.0}), "x")
    assert result.emulated.lag_s - result.measured.lag_s == pytest.approx(0.012, abs=2e-4)
    assert result.apart_s == pytest.approx(0.012, abs=2e-4)


def test_coarser_robot_resolution_is_measured(tmp_path: Path) -> None:
    measured = robot_table("rsi", places(0.004), {"cell.rsi.precision": 2})
    result = line(compare("rsi", measured, tmp_path, {"cell.rsi.precision": 1}), "x")
    assert result.measured.grid == pytest.approx(1e-5, rel=1e-3)
    assert result.emulated.grid == pytest.approx(1e-4, rel=1e-3)


@pytest.mark.full
def test_abb_joints_are_replayed_as_joints(tmp_path: Path) -> None:
    times = np.arange(0.0, 4.0, 0.004)
    motion = {f"order_{name}": np.full(len(times), 0.1) for name in FAMILIES["q"]}
    motion["order_q1"] = 0.1 + 0.05 * rise(times)
    slow = {"cell.egm.mode": "joint", "cell.egm.arm.natural_frequency_rad_s": 50.0}
    measured = robot_table("egm", Table(times, motion), {"cell.egm.mode": "joint"})
    assert measured.columns["q3"] == pytest.approx(0.1, abs=3e-4)
    for settings, later_s in (({"cell.egm.mode": "joint"}, 0.0), (slow, 0.02)):
        quantity = line(compare("egm", measured, tmp_path, settings), "q1")
        assert quantity.source == "order_q1"
        assert quantity.emulated.lag_s - quantity.measured.lag_s == pytest.approx(later_s, abs=1e-3)
    with pytest.raises(ConfigError, match="set it to joint for order_q"):
        compare("egm", measured, tmp_path, {})


def joints(family: str) -> Table:
    """Return the motion of two joints of a ur10e, as orders of positions or speeds."""
    times = np.arange(0.0, 4.0, 0.01)
    start = (0.3, -1.5, 1.8, -1.8, -1.5, 0.2)
    motion, speed = 0.2 * rise(times), 0.2 * 0.8 * np.sin(1.6 * times)
    columns = {name: np.full(len(times), part) for name, part in zip(FAMILIES["q"], start, strict=True)}
    if family == "order_q":
        columns |= {f"order_{name}": values for name, values in columns.items()}
        columns["order_q1"] = columns["order_q1"] + motion
        columns["order_q4"] = columns["order_q4"] - motion
    else:
        columns |= dict.fromkeys(FAMILIES["target_qd"], np.zeros(len(times)))
        columns |= {"target_qd1": speed, "target_qd4": -speed}
    return Table(times, columns)


@pytest.mark.full
def test_different_servoj_lookahead_is_measured(tmp_path: Path) -> None:
    usual = {**EXACT, "robot.rtde.lookahead_s": 0.03}
    measured = robot_table("rtde", joints("order_q"), usual)
    same = line(compare("rtde", measured, tmp_path, usual), "q1")
    assert same.emulated.lag_s == pytest.approx(same.measured.lag_s, abs=2e-4)
    other = line(compare("rtde", measured, tmp_path, {**usual, "robot.rtde.lookahead_s": 0.08}), "q1")
    assert other.emulated.lag_s - other.measured.lag_s == pytest.approx(0.05, abs=2e-3)


@pytest.mark.full
def test_joint_speeds_are_replayed_as_speeds(tmp_path: Path) -> None:
    measured = robot_table("rtde", joints("target_qd"), EXACT)
    columns = {name: measured.columns[name] for name in (*FAMILIES["q"], *FAMILIES["target_qd"])}
    result = line(compare("rtde", Table(measured.times, columns), tmp_path, EXACT), "q4")
    assert result.source == "∫target_qd4"
    assert result.emulated.lag_s == pytest.approx(result.measured.lag_s, abs=2e-4)
    assert result.apart_rms < 2e-4


def test_robot_without_inputs_is_compared_by_noise(tmp_path: Path) -> None:
    times = np.arange(100) / 100.0
    force = np.random.default_rng(5).normal(0.0, 0.4, 100)
    result = compare("rtde", Table(times, {"fz": force}), tmp_path, {"cell.rtde.force_noise_n": [0.4] * 3})
    quantity = line(result, "fz")
    assert quantity.source == ""
    assert quantity.measured.noise == pytest.approx(0.4, rel=0.25)
    assert quantity.emulated.noise == pytest.approx(0.4, rel=0.25)
    assert result.left_out == (STANDSTILL,)


def test_table_without_robot_quantities_is_refused(tmp_path: Path) -> None:
    mapping = '[time]\ncolumn = "t"\n[columns]\ndepth = { columns = ["q1"], unit = "m" }\n'
    output = ask(tmp_path, "rtde", GOOD, mapping)
    assert "nothing to compare: the emulated rtde does not report depth" in output
    output = ask(tmp_path, "rsi", GOOD, "")
    assert "nothing to compare: the emulated rsi does not report q" in output


# --- sensors


def turning() -> Table:
    """Return a sensor that rotates about its x axis, with a load of 1 kg."""
    times = np.arange(0.0, 2.0, 0.005)
    angle = 1.2 * np.sin(3.1 * times)
    zeros, ones = np.zeros(len(times)), np.ones(len(times))
    cosine, sine = np.cos(angle), np.sin(angle)
    rows = (ones, zeros, zeros, zeros, cosine, -sine, zeros, sine, cosine)
    columns = dict(zip(ROTATION, rows, strict=True))
    turned = np.array(rows).T.reshape(-1, 3, 3)
    force = turned.transpose(0, 2, 1) @ np.array([0.0, 0.0, -9.80665])
    moment = np.cross(np.array([0.01, 0.0, 0.08]), force)
    columns |= dict(zip(WRENCH, np.hstack([force, moment]).T, strict=True))
    return Table(times, columns)


def sensor_table(kind: str, settings: Settings) -> Table:
    """Return a recording of an emulated sensor under that load."""
    loaded = with_load(turning())
    sensed = emulate_sensor(load_config(None, {"sensor.emulated": kind, **settings}), loaded)
    rotation = {name: np.interp(sensed.times, loaded.times, loaded.columns[name]) for name in ROTATION}
    turned = np.column_stack([rotation[name] for name in ROTATION]).reshape(-1, 3, 3)
    left, _, right = np.linalg.svd(turned)  # between two rotations lies none
    flat = (left @ right).reshape(-1, 9).T
    wrench = {name: sensed.columns[name] for name in WRENCH}
    return Table(sensed.times, {**wrench, **dict(zip(ROTATION, flat, strict=True))})


@pytest.mark.parametrize(("noise_n", "ratio"), [(0.02, 1.0), (0.06, 3.0)])
def test_different_sensor_noise_is_measured(noise_n: float, ratio: float, tmp_path: Path) -> None:
    settings = {**WHITE, "cell.netft.rate_hz": 200, "cell.netft.noise_n": 0.02}
    measured = sensor_table("netft", settings)
    result = compare("netft", measured, tmp_path, {**settings, "cell.netft.noise_n": noise_n})
    for axis in ("fy", "fz"):
        quantity = line(result, axis)
        assert quantity.measured.noise == pytest.approx(0.02, rel=0.1)
        assert quantity.emulated.noise == pytest.approx(ratio * quantity.measured.noise, rel=0.1)
        assert quantity.emulated.lag_s == pytest.approx(quantity.measured.lag_s, abs=3e-3)
    assert result.emulated_gaps.mean_s == pytest.approx(0.005, rel=1e-3)


def test_stationary_sensor_is_loaded_with_mean_wrench(tmp_path: Path) -> None:
    times = np.arange(400) / 100.0
    random = np.random.default_rng(3)
    noise = random.normal(0.0, 0.05, (400, 3)) + np.array([1.0, -2.0, -7.0])
    measured = Table(times, dict(zip(FAMILIES["force"], noise.T, strict=True)))
    result = compare("ft300", measured, tmp_path, {"cell.ft300.noise_n": 0.1})
    for axis in FAMILIES["force"]:
        quantity = line(result, axis)
        assert math.isnan(quantity.measured.lag_s)
        assert quantity.measured.noise == pytest.approx(0.05, rel=0.15)
        assert quantity.emulated.noise == pytest.approx(0.1, rel=0.15)


# --- contact


@pytest.mark.parametrize(("stiffness", "ratio"), [(3000.0, 1.0), (6000.0, 2.0)])
def test_different_contact_stiffness_is_measured(stiffness: float, ratio: float, tmp_path: Path) -> None:
    times = np.arange(0.0, 5.0, 0.01)
    depth = 0.02 + 0.001 * times
    press = 3000.0 * np.maximum(depth - 0.021, 0.0)
    measured = Table(times, {"depth": depth, "press": press})
    result = compare(
        "contact",
        measured,
        tmp_path,
        {"cell.surface.stiffness_n_m": stiffness, "cell.surface.damping_ns_m": 0.0},
    )
    laws = {law.name: law for law in result.laws}
    assert laws["exponent of the depth"].measured == pytest.approx(1.0, abs=0.01)
    stiff = laws["stiffness of the law at 5 N"]
    assert stiff.measured == pytest.approx(3000.0, rel=0.01)
    assert stiff.emulated == pytest.approx(ratio * stiff.measured, rel=0.02)
    assert (line(result, "press").apart_rms < 1e-3) == (ratio == 1.0)


def test_contact_with_soft_body_is_emulated(tmp_path: Path) -> None:
    """The force law is that of the recording from which the soft body has its figures: 0.56 N at 1 mm, exponent 1.46.
    The recording begins in contact.
    """
    times = np.arange(0.0, 4.0, 0.01)
    depth = 0.001 + 0.0015 * times
    measured = Table(times, {"depth": depth, "press": 0.56 * (depth * 1e3) ** 1.46})
    still = {"cell.soft_body.material.relaxation_share": 0.0, "cell.soft_body.material.dissipation_s_m": 0.0}
    result = compare("contact", measured, tmp_path, {"cell.surface_kind": "soft-body", **still})
    assert line(result, "press").apart_rms < 0.02
    laws = {law.name: law for law in result.laws}
    assert laws["exponent of the depth"].emulated == pytest.approx(1.46, abs=0.02)
    plain = compare("contact", measured, tmp_path, {})
    assert line(plain, "press").apart_rms > 0.5


# --- the command


def ask(folder: Path, kind: str, rows: Sequence[tuple[str, ...]], mapping: str, *more: str) -> str:
    """Return the text that the command prints for a table, or its error. Without a mapping the columns are `t` and a
    joint.
    """
    table, plan = folder / "log.csv", folder / "log.toml"
    with table.open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    plan.write_text(
        mapping
        or '[time]\ncolumn = "t"\n[columns]\nq = { columns = ["q1", "", "", "", "", ""], unit = "rad" }\n'
    )
    result = CliRunner().invoke(
        cli, ["identify", "fidelity", str(table), "--columns", str(plan), "--as", kind, *more]
    )
    return result.output if result.exit_code == 0 else str(result.exception)


def rsi_rows() -> list[tuple[str, ...]]:
    measured = robot_table("rsi", places(0.012), {"cell.rsi.cycle_ms": 12, "robot.rsi.cycle_ms": 12})
    names = ("order_x", "order_y", "order_z", "x", "y", "z")
    columns = [1e3 * measured.times, *(1e3 * measured.columns[name] for name in names)]
    return [("ipoc", *names), *(tuple(f"{part:.4f}" for part in row) for row in zip(*columns, strict=True))]


RSI_MAPPING = """
[time]
column = "ipoc"
unit = "ms"
[columns]
order_position = { columns = ["order_x", "order_y", "order_z"], unit = "mm" }
position = { columns = ["x", "y", "z"], unit = "mm" }
"""


def test_fidelity_command_writes_page_of_table(tmp_path: Path) -> None:
    cell, page = tmp_path / "cell.toml", tmp_path / "page.html"
    cell.write_text("[robot.rsi]\ncycle_ms = 12\n[cell.rsi]\ncycle_ms = 12\n")
    more = ("--config", str(cell), "--page", str(page))
    rows = rsi_rows()
    output = ask(tmp_path, "rsi", rows, RSI_MAPPING, *more)
    assert "x behind order_x" in output
    assert str(page) in output
    text = page.read_text()
    assert text.count("<script") == 2
    assert "log.csv against the emulated rsi" in text
    assert "http" not in text.replace("http-equiv", "").partition("<script>")[0]
    assert "already exists" in ask(tmp_path, "rsi", rows, RSI_MAPPING, *more)
    printed = json.loads(ask(tmp_path, "rsi", rows, RSI_MAPPING, "--config", str(cell), "--json"))
    quantity = next(each for each in printed["lines"] if each["output"] == "x")
    assert quantity["emulated"]["lag_s"] == pytest.approx(quantity["measured"]["lag_s"], abs=3e-4)
    assert printed["measured_gaps"]["mean_s"] == pytest.approx(0.012)
    still = next(each for each in printed["lines"] if each["output"] == "y")
    assert still["emulated"]["lag_s"] is None
    short = ask(tmp_path, "rsi", rows, RSI_MAPPING, "--config", str(cell), "--between", "0.5", "3.5")
    assert "250 samples over 2.99 s" in short


@pytest.mark.parametrize("kind", ["egm", "rtde", "rsi"])
def test_recording_shorter_than_a_cycle_is_refused(tmp_path: Path, kind: str) -> None:
    """An example is a time in seconds that is read as milliseconds."""
    rows = [("t", "x"), *((f"{0.004 * k:.5f}", f"{0.1 * k}") for k in range(200))]
    mapping = (
        '[time]\ncolumn = "t"\nunit = "ms"\n[columns]\nposition = { columns = ["x", "", ""], unit = "mm" }\n'
    )
    output = ask(tmp_path, kind, rows, mapping)
    assert output == (
        f"the recording lasts 0.000796 s, too short for two samples of the emulated {kind}; check time.unit"
    )


@pytest.mark.full
def test_run_is_compared_with_its_own_devices(tmp_path: Path) -> None:
    """The settings are those of the devices. The client's ramp is between order and setpoint: a deviation of a cycle is
    allowed.
    """
    config, record = tmp_path / "run.toml", tmp_path / "run.mcap"
    config.write_text(
        '[run]\nduration_s = 2.0\n[robot]\nemulated = "rsi"\n[sensor]\nemulated = "netft"\n'
        "[cell.rsi]\ntransport_delay_ms = 30.0\n[cell.netft]\nnoise_n = 0.05\nmotion_n = 0.0\nvibration_n = 0.0\n"
    )
    result = CliRunner().invoke(cli, ["run", str(config), "--virtual", "--record", str(record)])
    assert record.exists(), result.output

    def line_as(kind: str, output: str, *more: str) -> Any:
        result = CliRunner().invoke(cli, ["identify", "fidelity", str(record), "--as", kind, "--json", *more])
        assert result.exit_code == 0, result.exception
        return next(each for each in json.loads(result.output)["lines"] if each["output"] == output)

    position, force = line_as("rsi", "z"), line_as("netft", "fz")
    assert position["emulated"]["lag_s"] == pytest.approx(position["measured"]["lag_s"], abs=2e-3)
    assert force["measured"]["noise"] == pytest.approx(0.05, rel=0.1)
    assert force["emulated"]["noise"] == pytest.approx(force["measured"]["noise"], rel=0.1)
    quick = tmp_path / "quick.toml"
    quick.write_text("[cell.rsi]\ntransport_delay_ms = 0.0\n")
    earlier = line_as("rsi", "z", "--config", str(quick))
    assert earlier["emulated"]["lag_s"] == pytest.approx(position["emulated"]["lag_s"] - 0.03, abs=1e-3)


GOOD = [("t", "q1"), *((f"{k / 100}", "1.0") for k in range(60))]


@pytest.mark.parametrize(
    ("rows", "mapping", "message"),
    [
        (GOOD[:20], "", "19 rows; at least 50 are required"),
        ([*GOOD[:30], GOOD[28], *GOOD[30:]], "", "the time decreases in line 31"),
        ([*GOOD[:30], ("0.29", "nan"), *GOOD[31:]], "", "q1 in line 31 is not a number: 'nan'"),
        ([*GOOD[:30], ("0.29", "one"), *GOOD[31:]], "", "q1 in line 31 is not a number: 'one'"),
        ([*GOOD[:30], ("0.29",), *GOOD[31:]], "", "line 31 has 1 columns, q1 is in column 2"),
        ([("t", "p1"), *GOOD[1:]], "", "has no column 'q1'; its header begins with 't, p1'"),
        (GOOD, '[time]\ncolumn = "t"\nunit = "h"\n[columns]\nq = {}\n', "time.unit must be one of s, ms"),
        (
            GOOD,
            '[time]\ncolumn = "t"\n[columns]\nspin = {}\n',
            "unknown quantity 'spin'; known: order_q",
        ),
        (GOOD, '[time]\ncolumn = "t"\n[columns]\ndepth = 3\n', "columns.depth must be a table"),
        (GOOD, '[time]\ncolumn = "t"\n[columns]\nq = { columns = ["q1"] }\n', "must name 6 columns"),
        (
            GOOD,
            '[time]\ncolumn = "t"\n[columns]\ndepth = { columns = ["q1"], unit = "inch" }\n',
            "columns.depth.unit must be one of m, cm, mm, µm, in, got 'inch'",
        ),
        (
            GOOD,
            '[time]\ncolumn = "t"\n[columns]\ndepth = { columns = [0], unit = "m" }\n',
            "columns.depth must be a column name, or its number from 1, got 0",
        ),
        (GOOD, "[time]\nrate_hz = 0\n[columns]\nq = {}\n", "time.rate_hz must be greater than 0"),
        (GOOD, "[time]\n[columns]\nq = {}\n", "[time] must have either column or rate_hz"),
        (GOOD, "[time]\nrate_hz = 5\n", "must have the sections [time] and [columns]"),
        (GOOD, 'separator = "x"\n', "separator must be one of"),
        (GOOD, "speed = 3\n", "unknown key 'speed'; known: separator"),
        (
            [GOOD[0], *((f"{60 * k}", "1.0") for k in range(70))],
            "",
            "the recording lasts 4140 s; at most 3600 s",
        ),
        (
            [*GOOD[:30], ("0.29", "1e200"), *GOOD[31:]],
            "",
            "q1 reaches 1e+200 rad; check its unit",
        ),
    ],
)
def test_fidelity_invalid_table_or_mapping_is_refused(
    rows: Sequence[tuple[str, ...]], mapping: str, message: str, tmp_path: Path
) -> None:
    output = ask(tmp_path, "rtde", rows, mapping)
    assert message in output
    assert "\n" not in output.strip()


EXAMPLES = sorted((Path(__file__).resolve().parents[2] / "examples" / "fidelity").glob("*.toml"))


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_examples_are_mappings_or_cells(file: Path, tmp_path: Path) -> None:
    """A mapping is tested with tables that have its columns, each with different values."""
    if file.stem.endswith("-cell"):
        load_config(file, {})
        return
    plan = tomllib.loads(file.read_text())
    entries = [plan["time"] | {"columns": [plan["time"]["column"]]}] if "column" in plan["time"] else []
    names: dict[str, list[Any]] = {}
    for entry in (*plan["columns"].values(), *entries):
        names.setdefault(entry.get("file", "log.csv"), []).extend(entry["columns"])
    for name, columns in names.items():
        shared = columns if name == "log.csv" else [*columns, plan["time"]["column"]]
        header = [str(column) for column in dict.fromkeys(shared)]
        if not plan.get("header", True):
            header = [str(k) for k in range(1, 1 + max(columns))]
        separator = " " if plan.get("separator") == "space" else ","
        rows = [separator.join(str(row + 0.001 * k) for k in range(len(header))) for row in range(60)]
        top = [separator.join(header)] if plan.get("header", True) else []
        (tmp_path / name).write_text("\n".join([*top, *rows]))
    table = read_table(tmp_path / "log.csv", file)
    for family, entry in plan["columns"].items():
        assert table.has(family), entry
        size = abs(UNITS[family][entry.get("unit", "1")])
        steps = np.abs(np.diff(table.columns[FAMILIES[family][0]]))[1:]  # another table begins later
        assert steps == pytest.approx(size, rel=1e-6)


def test_tables_without_common_time_are_refused(tmp_path: Path) -> None:
    (tmp_path / "other.csv").write_text("\n".join(["t,d", *(f"{900 + k},1" for k in range(60))]))
    mapping = '[time]\ncolumn = "t"\n[columns]\ndepth = { columns = ["d"], unit = "m", file = "other.csv" }\n'
    mapping += 'press = { columns = ["q1"], unit = "N" }\n'
    assert "other.csv and log.csv have no time in common" in ask(tmp_path, "contact", GOOD, mapping)


def test_reference_lists_all_families_and_units() -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "reference" / "fidelity.md").read_text()
    for family, units in UNITS.items():
        row = next(
            (row for row in page.splitlines() if row.startswith("|") and f"`{family}`" in row.split("|")[1]),
            "",
        )
        assert [unit for unit in units if f"`{unit}`" not in row] == [], family
    assert f"{LEAST_SAMPLES} samples are needed" in page


def test_unknown_kind_and_missing_mapping_are_refused(tmp_path: Path) -> None:
    assert "unknown kind 'lathe'; known: egm" in ask(tmp_path, "lathe", GOOD, "")
    assert "does not support replaying a recording" in ask(tmp_path, "s3", GOOD, "")
    result = CliRunner().invoke(cli, ["identify", "fidelity", str(tmp_path / "log.csv"), "--as", "rsi"])
    assert "give its column mapping with --columns" in str(result.exception)


def test_missing_scipy_is_reported_with_install_command(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name in [name for name in sys.modules if name.startswith("hil_bridge.lab.fidelity")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "scipy.optimize", None)
    path = tmp_path / "log.csv"
    path.write_text("t\n", encoding="utf-8")
    result = CliRunner().invoke(cli, ["identify", "fidelity", str(path), "--as", "contact"])
    assert isinstance(result.exception, ConfigError)
    assert install_command("fidelity") in str(result.exception)
