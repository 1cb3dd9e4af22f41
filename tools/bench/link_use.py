"""Link utilisation: share of a cycle that a paced line spends on characters.

The emulated controller answers immediately, because its response time is not part of the link. In virtual time,
everything above the minimum is caused by the protocol. Real time also includes the work of the two processes.
"""

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from hil_bridge.api import simulate
from hil_bridge.record import CycleRecord, read
from hil_bridge.settings.configuration import read_config
from protocol.devices.s3.adlp import LinkProfile
from protocol.devices.s3.timing import line_floor
from tools.bench.bridge import (
    AWAKE,
    BUSY_POLL_MS,
    PATIENCE_S,
    STOLEN,
    emulated_cell,
    processors_awake,
    run_bridge,
    write_config,
)
from tools.bench.figures import Figure, Report, Target

BAUDRATES = (9600, 19200)
TRACK_S = 10.0
MILLI = 1e3
REAL_TIME: Mapping[str, Mapping[str, Any]] = {
    "real time": {},
    "real time, busy polling": {"busy_poll_ms": BUSY_POLL_MS},
    f"real time{AWAKE}": {"keep_awake": True},
}
"""Settings of `[realtime]` for bridge and cell."""
USE = Target("ratio", 1.0 / 0.97)
"""Target for the ratio of the cycle time to its minimum: characters take at least 97 % of a cycle."""


def settings(baudrate: int, realtime: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings for bridge and cell: this rate, a controller without response time, and a short path."""
    link = {"baudrate": baudrate}
    robot = {"turnaround_ms": 0.0, "turnaround_spread_ms": 0.0}
    return {
        "run": {"duration_s": TRACK_S},
        "robot": {"s3": {"link": link}},
        "task": {"retract_mm": 1.0},
        "realtime": dict(realtime),
        "cell": {"start_position_mm": [900.0, -100.0, 591.0], "s3": {"link": link, "robot": robot}},
    }


def cycle_ms(cycles: Sequence[CycleRecord]) -> float:
    """Return the mean time between cycles while the surface is tracked, ms."""
    begins = [cycle.started_at for cycle in cycles if cycle.phase == "track"]
    return (begins[-1] - begins[0]) / (len(begins) - 1) * MILLI


def real_ms(baudrate: int, realtime: Mapping[str, Any]) -> tuple[float, float]:
    """Return the cycle time of bridge and emulated cell as two processes, ms, and the processor time that the host
    withheld, s.
    """
    with tempfile.TemporaryDirectory(prefix="hil-bridge-bench-") as folder:
        record = Path(folder) / "run.mcap"
        config = write_config(Path(folder) / "cell.toml", settings(baudrate, realtime))
        with emulated_cell(config) as devices:
            ended = run_bridge(config, devices, record, PATIENCE_S)
        return cycle_ms(read(record).cycles), ended.stolen_s


def figures_at(baudrate: int, report_step: Callable[[str], None], left_out: list[str]) -> Iterator[Figure]:
    """Yield the figures in virtual and in real time at one rate."""
    report_step(f"{baudrate} baud, virtual time")
    times = {"virtual time": cycle_ms(simulate(read_config(settings(baudrate, {}))).cycles)}
    stolen: dict[str, float] = {}
    for name, realtime in REAL_TIME.items():
        report_step(f"{baudrate} baud, {name}")
        with processors_awake(left_out) if "keep_awake" in realtime else nullcontext(True) as ready:
            if ready:
                times[name], stolen[name] = real_ms(baudrate, realtime)
    floor_ms = line_floor(LinkProfile(baudrate=baudrate)) * MILLI
    for name, value in times.items():
        yield Figure(f"cycle at {baudrate} baud, {name}", value, "ms", floor_ms, "floor of the line", USE)
    for name, value in stolen.items():
        yield Figure(f"{STOLEN}, {baudrate} baud, {name}", value, "s")


def measure(report_step: Callable[[str], None]) -> Report:
    """Measure link utilisation at both rates."""
    left_out: list[str] = []
    figures = [figure for baudrate in BAUDRATES for figure in figures_at(baudrate, report_step, left_out)]
    return Report(tuple(figures), tuple(left_out))
