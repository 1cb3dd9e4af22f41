"""Tables of docs/reference/identify-cell.md: hidden settings of emulated cells, and the values identified for them.

The cells are run and identified in virtual time, which takes about six minutes.
"""

import json
import math
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import hil_bridge
from emulators.devices.ati_can.profile import AtiCanProfile
from emulators.devices.rtde.profile import RtdeProfile
from hil_bridge.lab.campaign.drawing import Between, Draw, Setting, draw_values, numbers_of
from hil_bridge.lab.identification.identifying import identify_run
from hil_bridge.lab.identification.values import Values
from hil_bridge.record import Recording
from hil_bridge.settings.configuration import read_config
from hil_bridge.settings.overrides import lay_over
from protocol.devices.netft.page import FILTERS_HZ, filter_weight
from protocol.devices.netft.records import INTERNAL_RATE_HZ, output_step
from protocol.wrench import AXES
from tools.pages import run_jobs, table

TRACK_S = 10.0
HARDEST_N_M = 3e4
STREAMED = ("egm", "rtde", "rsi")
SENSORS = ("netft", "ft300", "ati-can", "netft", "ft300")
CELLS = (*(("s3", "jr3"),) * 5, *((robot, sensor) for robot in STREAMED for sensor in SENSORS))
"""Robot and sensor of each cell."""
_JR3_SCALES = tuple(full / 2**14 for full in (115.0, 111.0, 185.0, 5.6, 5.2, 6.1))
"""Scale of each axis of the emulated JR3, N or N·m per count."""
_JR3_SAMPLE_S, _JR3_LATE_S = 128.5e-6, 45e-6
"""Sample period of the emulated JR3, and mean delay of a frame after the request, s."""
_FT300_STEPS = (0.01,) * 3 + (0.001,) * 3


def _between(key: str, low: float, high: float, log: bool = False, whole: bool = False) -> Setting:
    return Setting(key, Between(low, high, log, whole))


SURFACE = (
    _between("cell.surface.stiffness_n_m", 2e3, HARDEST_N_M, log=True),
    _between("cell.surface.friction", 0.05, 0.5),
    _between("cell.surface.damping_ns_m", 1.0, 100.0, log=True),
)
ROBOT: Mapping[str, Sequence[Setting]] = {
    "s3": (
        _between("cell.s3.robot.turnaround_ms", 8.0, 30.0),
        _between("cell.s3.robot.turnaround_spread_ms", 1.0, 6.0),
        _between("cell.s3.servo.transport_delay_ms", 10.0, 60.0),
        _between("cell.s3.servo.natural_frequency_rad_s", 30.0, 80.0),
    ),
    "egm": (
        _between("cell.egm.ref_delay_cycles", 2, 8, whole=True),
        _between("cell.egm.arm.natural_frequency_rad_s", 60.0, 150.0),
    ),
    "rsi": (
        _between("cell.rsi.transport_delay_ms", 4.0, 24.0),
        _between("cell.rsi.natural_frequency_rad_s", 40.0, 100.0),
    ),
    "rtde": (
        _between("cell.rtde.joint_noise_urad", 8.0, 30.0),
        _between("cell.rtde.follow_delay_cycles", 1, 5, whole=True),
    ),
}
_GATEWAYS = ((2.0, 0.0), (5.0, 0.0), (2.0, 100.0), (2.0, 200.0), (10.0, 10.0))
"""Settings of the gateway: period, ms, and cut-off frequency, Hz."""
SENSOR: Mapping[str, Sequence[Setting]] = {
    "jr3": (
        _between("cell.jr3.sensor.noise_counts", 0.5, 2.8),
        Setting(
            "gateway",
            options=tuple(
                {"sensor.jr3.gateway.period_ms": period, "sensor.jr3.gateway.cutoff_hz": cutoff}
                for period, cutoff in _GATEWAYS
            ),
        ),
    ),
    "netft": (
        _between("cell.netft.noise_n", 0.005, 0.05),
        _between("cell.netft.noise_nm", 0.0003, 0.003),
        _between("cell.netft.slope_n_min", -1.0, 1.0),
        _between("cell.netft.filter", 0, 7, whole=True),
    ),
    "ft300": (
        _between("cell.ft300.noise_n", 0.04, 0.12),
        _between("cell.ft300.noise_nm", 0.003, 0.01),
        _between("cell.ft300.slope_n_min", -1.0, 1.0),
    ),
    "ati-can": (
        _between("cell.ati_can.noise_gages", 2.0, 20.0),
        _between("cell.ati_can.slope_n_min", -1.0, 1.0),
    ),
}
_SPEED_MM_S, _SMOOTHING_MM_S = 5.5, 1.0
_AT_SPEED = _SPEED_MM_S / math.hypot(_SPEED_MM_S, _SMOOTHING_MM_S)
"""Friction of the emulated surface at the usual speed across it, as a share of its full friction. The steps of an
S3 are faster.
"""
_PACKETS: Mapping[str, int] = {"jr3": 2, "netft": 1, "ft300": 16, "ati-can": 2}
"""Number of wire packets in a frame of each sensor."""


class Row(NamedTuple):
    """Identified value of a cell, with the true value."""

    key: str
    part: str
    words: str
    unit: str
    true: float
    found: float | None
    """Identified value; None if it was not identified."""
    low: float | None
    high: float | None
    why: str | None

    @property
    def within(self) -> bool:
        """Whether the interval contains the true value."""
        return self.low is not None and self.high is not None and self.low <= self.true <= self.high


def cell(number: int) -> dict[str, Any]:
    """Return the settings of a cell, drawn with its number as the seed."""
    robot, sensor = CELLS[number]
    lost = [_lost("sensor-wire"), *([_lost("wire")] if robot in ("egm", "rsi") else [])]
    draw = Draw((*SURFACE, *ROBOT[robot], *SENSOR[sensor]), tuple(lost), len(lost), len(lost))
    values: dict[str, Any] = {
        "run": {"duration_s": TRACK_S, "seed": number + 1},
        "robot": {"emulated": robot},
        "sensor": {"emulated": sensor},
        "task": {"expected_stiffness_n_m": HARDEST_N_M},
        "cell": {"arm": {"compliance": "rigid"}},
    }
    numbers = numbers_of(f"hidden cell {number}", draw.dimensions)
    drawn = json.loads(draw_values(draw, "", json.dumps(values), numbers))
    lay_over(values, drawn["config"])
    return {**values, "faults": drawn["faults"]}


def _lost(on: str) -> dict[str, Any]:
    probability = {"from": 5e-4, "to": 1e-2, "log": True}
    return {
        "on": on,
        "fault": "lost",
        "phase": "connect",
        "after_s": 0.0,
        "for_s": 3600.0,
        "with": {"probability": probability, "way": "from"},
    }


def true_values(settings: Mapping[str, Any]) -> dict[str, float]:
    """Return the true values of a cell that follow from its settings, by key."""
    robot, sensor = settings["robot"]["emulated"], settings["sensor"]["emulated"]
    cell, surface = settings["cell"], settings["cell"]["surface"]
    found = {
        "surface.stiffness": surface["stiffness_n_m"],
        "surface.damping": surface["damping_ns_m"],
        "surface.exponent": 1.0,
        "surface.friction": surface["friction"] * (1.0 if robot == "s3" else _AT_SPEED),
        **_robot_truth(robot, cell[robot]),
        **_sensor_truth(sensor, cell[sensor.replace("-", "_")], settings),
    }
    shares = {fault["on"]: fault["with"]["probability"] for fault in settings["faults"]}
    whole = 1.0 - (1.0 - shares.get("sensor-wire", 0.0)) ** _PACKETS[sensor]
    found["line.sensor.lost"] = 1e3 * whole
    if robot == "s3":
        found |= {"line.robot.damaged": 0.0, "line.robot.repeated": 0.0}
    else:
        found |= {"line.robot.lost": 1e3 * shares.get("wire", 0.0), "line.robot.late": 0.0}
    return found


def _robot_truth(robot: str, cell: Mapping[str, Any]) -> dict[str, float]:
    match robot:
        case "s3":
            turnaround, spread = (
                cell["robot"][name] * 1e-3 for name in ("turnaround_ms", "turnaround_spread_ms")
            )
            servo = cell["servo"]
            return {
                "robot.turnaround.move": turnaround,
                "robot.turnaround.status": turnaround,
                "robot.turnaround.spread": spread / math.sqrt(3.0),
                "robot.servo": servo["transport_delay_ms"] * 1e-3 + 2.0 / servo["natural_frequency_rad_s"],
                "robot.step": 0.125e-3,
            }
        case "rsi":
            servo_s = cell["transport_delay_ms"] * 1e-3 + 2.0 / cell["natural_frequency_rad_s"]
            return {"robot.servo": servo_s, "robot.cycle": 0.004, "robot.step": 1e-7}
        case "egm":
            servo_s = (cell["ref_delay_cycles"] + 1) * 0.004 + 2.0 / cell["arm"]["natural_frequency_rad_s"]
            return {"robot.servo": servo_s, "robot.cycle": 0.004}
        case _:
            usual = RtdeProfile()
            later = (cell["follow_delay_cycles"] - usual.follow_delay_cycles) * 0.002
            rounding = 2.0 * math.pi / 2**usual.joint_bits * 1e6 / math.sqrt(12.0)
            ratio = math.hypot(cell["joint_noise_urad"], rounding) / math.hypot(
                usual.joint_noise_urad, rounding
            )
            return {
                "robot.servo": 0.004 + 0.03 + later,  # two cycles to the robot, and servoj's lookahead
                "robot.cycle": 0.002,
                "robot.noise.ratio": ratio,
            }


def _sensor_truth(sensor: str, cell: Mapping[str, Any], settings: Mapping[str, Any]) -> dict[str, float]:
    slope = cell.get("slope_n_min", 0.0)
    found = {f"sensor.drift.{axis}": slope for axis in AXES[:3]}
    noise: Sequence[float]
    match sensor:
        case "jr3":
            gateway = settings["sensor"]["jr3"]["gateway"]
            cutoff = gateway["cutoff_hz"]
            lowered = _lowered(-math.expm1(-2.0 * math.pi * cutoff * _JR3_SAMPLE_S)) if cutoff else 1.0
            noise = [cell["sensor"]["noise_counts"] * scale * lowered for scale in _JR3_SCALES]
            found |= {f"sensor.step.{axis}": step for axis, step in zip(AXES, _JR3_SCALES, strict=True)}
            found |= {"sensor.cutoff": cutoff, "sensor.period": gateway["period_ms"] * 1e-3 + _JR3_LATE_S}
        case "netft":
            weight = filter_weight(FILTERS_HZ[cell["filter"]]) if cell["filter"] else 1.0
            noise = [value * _lowered(weight) for value in _six(cell)]
            found |= {
                "sensor.cutoff": FILTERS_HZ[cell["filter"]],
                "sensor.period": output_step(1000) / INTERNAL_RATE_HZ,
            }
        case "ft300":
            noise = _six(cell)
            found |= {f"sensor.step.{axis}": step for axis, step in zip(AXES, _FT300_STEPS, strict=True)}
            found |= {"sensor.period": 0.01}
        case _:
            profile = AtiCanProfile()
            rows = [profile.matrix[6 * axis : 6 * axis + 6] for axis in range(6)]
            noise = [math.hypot(*row) * cell["noise_gages"] / profile.counts_per_unit for row in rows]
    return found | {f"sensor.noise.{axis}": value for axis, value in zip(AXES, noise, strict=True)}


def _lowered(weight: float) -> float:
    """Return the factor by which a first-order filter reduces the rms of white noise."""
    return math.sqrt(weight / (2.0 - weight))


def _six(cell: Mapping[str, Any]) -> list[float]:
    return [cell["noise_n"]] * 3 + [cell["noise_nm"]] * 3


def run_of(number: int) -> Recording:
    """Return the recording of a cell."""
    return hil_bridge.simulate(cell(number)).recording


def rows_of(number: int, values: Values) -> list[Row]:
    """Return the identified values of a cell that have a true value."""
    true = true_values(cell(number))
    rows = []
    for value in values:
        if value.key in true:
            found, low, high = (value.value, value.low, value.high) if value.seen else (None, None, None)
            why = None if value.why is None else value.why.value
            words = value.key, value.part, value.words, value.unit
            rows.append(Row(*words, true[value.key], found, low, high, why))
    return rows


def figures_of(number: int) -> dict[str, Any]:
    """Run and identify one cell."""
    recording = run_of(number)
    robot, sensor = CELLS[number]
    rows = [row._asdict() for row in rows_of(number, identify_run(recording).values)]
    return {
        "cell": number,
        "robot": robot,
        "sensor": sensor,
        "outcome": recording.end["outcome"],
        "rows": rows,
    }


def measure(names: Sequence[str], before: object) -> list[dict[str, Any]]:
    """Run and identify all cells, one cell per core at a time."""
    return run_jobs(figures_of, range(len(CELLS)))


# --- the page


def drawn_settings() -> Iterator[tuple[str, Setting]]:
    """Return every setting that is drawn, and the cells for which it is drawn."""
    for setting in SURFACE:
        yield "all", setting
    for kind, settings in (*ROBOT.items(), *SENSOR.items()):
        for setting in settings:
            yield f"`{kind}`", setting


def _draws() -> Iterator[tuple[str, str, str, str]]:
    for cells, setting in drawn_settings():
        if setting.between is None:
            keys = " and ".join(f"`{key}`" for key in setting.options[0])
            pairs = "; ".join(", ".join(f"{value:g}" for value in one.values()) for one in setting.options)
            usual = ", ".join(_format_default(key) for key in setting.options[0])
            yield cells, keys, f"one of: {pairs}", usual
        else:
            drawn = setting.between
            law = ", rounded to a whole number" if drawn.whole else " in its logarithm" if drawn.log else ""
            words = f"{drawn.low:g} … {drawn.high:g}, uniform{law}"
            yield cells, f"`{setting.key}`", words, _format_default(setting.key)


def _format_default(key: str) -> str:
    """Return the default of a setting as text. If it has one value per axis, the text has the values of the three
    axes.
    """
    robot, sensor = next(
        (robot, sensor)
        for robot, sensor in CELLS
        if {robot, sensor.replace("-", "_")} & {*key.split(".")} or key.startswith("cell.surface.")
    )
    value: Any = read_config({"robot": {"emulated": robot}, "sensor": {"emulated": sensor}}).model_dump()
    for name in key.split("."):
        value = value[name]
    return ", ".join(f"{one:g}" for one in value) if isinstance(value, tuple) else f"{value:g}"


def _losses() -> str:
    """Return how many cells lose packets, by wire."""
    lost = [{fault["on"] for fault in cell(number)["faults"]} for number in range(len(CELLS))]
    both, sensor, robot = ({"sensor-wire", "wire"}, {"sensor-wire"}, {"wire"})
    return (
        f"{lost.count(sensor)} cells lose packets of the sensor alone, {lost.count(robot)} packets of the robot alone, "
        f"and {lost.count(both)} both."
    )


def all_rows(figures: Sequence[Mapping[str, Any]]) -> list[tuple[Mapping[str, Any], Row]]:
    """Return every row with its cell."""
    return [(one, Row(**row)) for one in figures for row in one["rows"]]


def within_of(rows: Sequence[Row]) -> tuple[int, int]:
    """Return the number of values inside their intervals, and the number of all estimated values."""
    estimated = [row for row in rows if row.found is not None]
    return sum(row.within for row in estimated), len(estimated)


def _quantities(rows: Sequence[Row]) -> Iterator[tuple[str, str, str, str, str]]:
    for words in dict.fromkeys(_general(row) for row in rows):
        own = [row for row in rows if _general(row) == words]
        within, estimated = within_of(own)
        widths = [
            100.0 * 0.5 * (row.high - row.low) / abs(row.true)
            for row in own
            if row.low is not None and row.high is not None and row.true
        ]
        width = f"± {statistics.median(widths):.2g} %" if widths else "–"
        reasons = dict.fromkeys(row.why for row in own if row.why is not None)
        missing = f"{len(own) - estimated}: {'; '.join(map(str, reasons))}" if reasons else "0"
        yield words, str(estimated), str(within), width, missing


def _general(row: Row) -> str:
    """Return the description of a value in a form that is the same for all axes."""
    axis = row.key.rpartition(".")[2]
    general = row.words.removesuffix(f" of {axis}") + " of each axis" if axis in AXES else row.words
    return f"{row.part}: {general}"


def _coverage(figures: Sequence[Mapping[str, Any]]) -> str:
    rows = [row for _, row in all_rows(figures)]
    within, estimated = within_of(rows)
    noise_within, noise_estimated = within_of([row for row in rows if row.key.startswith("sensor.noise")])
    return (
        f"{len(figures)} cells have {len(rows)} values with a known true value. {estimated} are "
        f"estimated, and {within} of these, {100.0 * within / estimated:.1f} %, lie within their intervals. Of the "
        f"sensor noises, whose intervals have no allowance, {noise_within} of {noise_estimated} do, "
        f"{100.0 * noise_within / noise_estimated:.1f} %."
    )


_QUANTITIES = ("value", "estimated", "within", "half width, median", "not estimated, and why")
TABLES: Mapping[str, Callable[[Sequence[Mapping[str, Any]]], str]] = {
    "drawn": lambda figures: table(("cells", "setting", "drawn from", "default"), _draws()),
    "losses": lambda figures: _losses(),
    "coverage": _coverage,
    "quantities": lambda figures: table(_QUANTITIES, _quantities([row for _, row in all_rows(figures)])),
}
