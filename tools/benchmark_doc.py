"""Tables of docs/reference/benchmark.md: results of the benchmark campaigns, and the published figures of robots.

`--measure A.sqlite …` takes the figures from results of campaigns in examples/campaigns/benchmark.
"""

import csv
import json
import math
import statistics
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from hil_bridge.errors import ConfigError
from hil_bridge.lab.campaign.digest import runs_by_case, tally_of, values_of
from hil_bridge.lab.campaign.plan import PrimaryFigure
from hil_bridge.lab.campaign.plan_file import read_plan
from hil_bridge.lab.campaign.store import Done, Store
from hil_bridge.lab.significance import median_interval
from hil_bridge.record.analysis.definition import UNKNOWN
from hil_bridge.record.analysis.figures import FIGURES
from tools.pages import table

ROOT = Path(__file__).resolve().parent.parent
CAMPAIGNS = ROOT / "examples" / "campaigns" / "benchmark"
JSON_DEPTH = 3
UR10E = "UR10e and its published figures"
"""Name of the campaign of the emulated UR10e."""

FORCE, MOVED = (read_plan(CAMPAIGNS / f"{name}.toml") for name in ("force", "moved"))
COLUMNS = [*FORCE.primary, *MOVED.primary]
"""Columns of the table of results: the primary figures of the campaigns."""
COMPARED = (
    "settle_10n_s",
    "touch_error_mean_n",
    "touch_error_deviation_n",
    "track_error_mean_n",
    "track_error_deviation_n",
)
"""Figures of the published robots that the emulated robot is compared with."""
NEAREST = "force mode, gain 1"
"""Published device from which the distance is stated: the robot's own force mode at its higher gain."""


def measure(names: Sequence[str], figures: Mapping[str, Any]) -> dict[str, Any]:
    """Return the figures of the named results, and those of other results from before."""
    if not names:
        raise ConfigError("name the results of benchmark campaigns with --measure")
    kept = {campaign: dict(rows) for campaign, rows in figures.items()}
    for name in names:
        with Store.open(Path(name)) as store:
            plan, runs = store.plan(), list(store.runs())
            config = json.loads(plan.cases[0].config)
            devices = config["robot"]["emulated"], config["sensor"]["emulated"], config["controller"]["name"]
            tally = tally_of(runs)
            cases = {
                case: dict(_figures(case, of_case)) for case, of_case in runs_by_case(plan, runs).items()
            }
            kept.setdefault(plan.name, {})[", ".join(devices)] = {
                "facts": {"passed": tally.passed, "runs": tally.total},
                **{case: values for case, values in cases.items() if values},
            }
    return kept


def _figures(case: str, runs: Sequence[Done]) -> Iterator[tuple[str, list[float | None]]]:
    """Yield the figures of a case that the tables use: median and its interval; None for infinity."""
    columns = [column.figure for column in COLUMNS if column.case == case]
    for key in columns or (COMPARED if case.startswith("task.force_n") else ()):
        if values := values_of(key, runs):
            interval = median_interval(values) or ()
            yield key, [_finite(value) for value in (statistics.median(values), *interval)]


def _finite(value: float) -> float | None:
    return round(value, 6) if math.isfinite(value) else None


def results_table(figures: Mapping[str, Any]) -> str:
    """Return the results of each robot, sensor and controller."""
    rows: dict[str, dict[str, Any]] = {}
    for campaign, results in figures.items():
        if campaign != UR10E:
            for name, result in results.items():
                row = rows.setdefault(name, {})
                row |= {
                    key: value for key, value in result.items() if key != "facts" or campaign == FORCE.name
                }
    head = [
        "robot, sensor, controller",
        "passed",
        *(f"{one.title}, {FIGURES[one.figure].unit}".rstrip(", ") for one in COLUMNS),
    ]
    return table(
        head,
        (
            (name, "{passed}/{runs}".format(**row["facts"]), *(_cell(row, column) for column in COLUMNS))
            for name, row in sorted(rows.items())
        ),
    )


def _cell(cases: Mapping[str, Any], column: PrimaryFigure) -> str:
    values = cases.get(column.case, {}).get(column.figure)
    return UNKNOWN if values is None else _text(column.figure, values)


def _text(key: str, values: Sequence[float | None]) -> str:
    """Format a median and its interval, without a unit."""
    median, low, high = (_number(key, value) for value in values)
    return median if low == high else f"{median} ({low} … {high})"


def _number(key: str, value: float | None) -> str:
    return "∞" if value is None else f"{value:{FIGURES[key].form}}".replace("-", "−")


def measured_table(figures: Mapping[str, Any]) -> str:
    """Return the published figures of the UR10e on the straight profile at 0.1 m/s, and the emulated robot's."""
    with (CAMPAIGNS / "measured-robots.csv").open(encoding="utf-8") as file:
        published = [
            row for row in csv.DictReader(file) if (row["table"], row["travel_m_s"]) == ("straight", "0.1")
        ]
    (emulated,) = figures[UR10E].values()
    rows = []
    for force in dict.fromkeys(row["force_n"] for row in published):
        of_force = [row for row in published if row["force_n"] == force]
        rows += [(force, row["device"], *(row[key] or UNKNOWN for key in COMPARED)) for row in of_force]
        (nearest,) = (row for row in of_force if row["device"] == NEAREST)
        for stiffness in ("20 kN/m", "50 kN/m"):
            values = emulated[f"task.force_n {float(force)}, surface {stiffness}"]
            rows.append((force, f"**emulated, {stiffness}**", *(_text(key, values[key]) for key in COMPARED)))
            rows.append(
                (force, f"distance of {stiffness}", *(_distance(nearest, key, values) for key in COMPARED))
            )
    return table(("target, N", "device", *(FIGURES[key].title for key in COMPARED)), rows)


def _distance(nearest: Mapping[str, str], key: str, values: Mapping[str, Sequence[float | None]]) -> str:
    """Return the emulated figure less the published one of the nearest device."""
    median = values[key][0]
    if median is None or not nearest[key]:
        return UNKNOWN
    return f"{median - float(nearest[key]):+.2f}".replace("-", "−")


TABLES = {"results": results_table, "measured": measured_table}
