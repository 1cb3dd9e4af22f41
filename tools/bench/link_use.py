"""Link use: how much of a cycle the characters on a paced line are.

The emulated controller answers at once here: its turnaround is its own and not the link's. In virtual time whatever
is above the floor is the protocol's; in real time the two processes' work comes to it.
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
"""Settings in `[realtime]` on both sides."""
USE = Target("ratio", 1.0 / 0.97)
"""Cycle time by floor: at least 97 % of a cycle are characters."""


def settings(baudrate: int, realtime: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings of both sides: this rate, a controller without turnaround, and a short path."""
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
    """Mean from cycle to cycle while the surface is tracked, ms."""
    begins = [cycle.started_at for cycle in cycles if cycle.phase == "track"]
    return (begins[-1] - begins[0]) / (len(begins) - 1) * MILLI


def real_ms(baudrate: int, realtime: Mapping[str, Any]) -> tuple[float, float]:
    """Time of a cycle of bridge and emulated cell as two processes, ms, and the time that the host kept, s."""
    with tempfile.TemporaryDirectory(prefix="hil-bridge-bench-") as folder:
        record = Path(folder) / "run.mcap"
        config = write_config(Path(folder) / "cell.toml", settings(baudrate, realtime))
        with emulated_cell(config) as devices:
            ended = run_bridge(config, devices, record, PATIENCE_S)
        return cycle_ms(read(record).cycles), ended.stolen_s


def figures_at(baudrate: int, say: Callable[[str], None], left_out: list[str]) -> Iterator[Figure]:
    """Both kinds of time at one rate."""
    say(f"{baudrate} baud, virtual time")
    times = {"virtual time": cycle_ms(simulate(read_config(settings(baudrate, {}))).cycles)}
    stolen: dict[str, float] = {}
    for name, realtime in REAL_TIME.items():
        say(f"{baudrate} baud, {name}")
        with processors_awake(left_out) if "keep_awake" in realtime else nullcontext(True) as ready:
            if ready:
                times[name], stolen[name] = real_ms(baudrate, realtime)
    floor_ms = line_floor(LinkProfile(baudrate=baudrate)) * MILLI
    for name, value in times.items():
        yield Figure(f"cycle at {baudrate} baud, {name}", value, "ms", floor_ms, "floor of the line", USE)
    for name, value in stolen.items():
        yield Figure(f"{STOLEN}, {baudrate} baud, {name}", value, "s")


def measure(say: Callable[[str], None]) -> Report:
    """Both rates."""
    left_out: list[str] = []
    figures = [figure for baudrate in BAUDRATES for figure in figures_at(baudrate, say, left_out)]
    return Report(tuple(figures), tuple(left_out))
