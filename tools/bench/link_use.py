"""Link use: how much of a cycle the characters on a paced line are.

The emulated controller answers at once here: its turnaround is its own and not the link's. In virtual time whatever
is above the floor is the protocol's; in real time the two processes' work comes to it.
"""

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from hil_bridge.api import simulate
from hil_bridge.clock.realtime import RealTime, real_time_thread
from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import toml_pair
from hil_bridge.record import CycleRecord, read
from hil_bridge.settings.configuration import read_config
from protocol.devices.s3.adlp import LinkProfile
from protocol.devices.s3.timing import line_floor
from tools.bench.figures import Figure, Report, Target
from tools.bench.machine import stolen_s

BAUDRATES = (9600, 19200)
TRACK_S = 10.0
MILLI = 1e3
PATIENCE_S = 120.0
AS_IT_IS: Mapping[str, Any] = MappingProxyType({})
POLLING: Mapping[str, Any] = MappingProxyType({"busy_poll_ms": 100.0})
"""Longer than any wait of a cycle, so that the bridge never sleeps."""
AWAKE: Mapping[str, Any] = MappingProxyType({"keep_awake": True})
WAYS = {
    "real time": AS_IT_IS,
    "real time, busy polling": POLLING,
    "real time, processors kept awake": AWAKE,
}
"""Settings in `[realtime]` on both sides."""
USE = Target("ratio", 1.0 / 0.97)
"""Cycle time by floor: at least 97 % of a cycle are characters."""
HIL_BRIDGE = (sys.executable, "-m", "hil_bridge")


def settings(baudrate: int, realtime: Mapping[str, object] = AS_IT_IS) -> dict[str, object]:
    """Settings of both sides: this rate, a controller without turnaround, and short ways."""
    link = {"baudrate": baudrate}
    robot = {"turnaround_ms": 0.0, "turnaround_spread_ms": 0.0}
    return {
        "run": {"duration_s": TRACK_S},
        "robot": {"s3": {"link": link}},
        "task": {"retract_mm": 1.0},
        "realtime": dict(realtime),
        "cell": {"s3": {"link": link, "robot": robot}, "start_position_mm": (900.0, -100.0, 591.0)},
    }


def cycle_time(cycles: Sequence[CycleRecord]) -> float:
    """Mean from cycle to cycle while the surface is tracked, s."""
    begins = [cycle.started_at for cycle in cycles if cycle.phase == "track"]
    return (begins[-1] - begins[0]) / (len(begins) - 1)


def real(baudrate: int, place: Path, realtime: Mapping[str, object]) -> tuple[CycleRecord, ...]:
    """The cycles of bridge and emulated cell as two processes, a paced pseudo-terminal between them."""
    config, record = place / "cell.toml", place / "run.mcap"
    config.write_text(_toml(settings(baudrate, realtime)), encoding="utf-8")
    with subprocess.Popen([*HIL_BRIDGE, "emulate", "cell", config, "--json"], stdout=subprocess.PIPE) as cell:
        try:
            assert cell.stdout is not None
            urls = json.loads(cell.stdout.readline())
            options = [text for device, url in urls.items() for text in (f"--{device}", url)]
            command = [
                *HIL_BRIDGE,
                "run",
                config,
                *options,
                "--unchecked",
                "--no-view",
                "--record",
                record,
                "--overwrite",
            ]
            with subprocess.Popen(command, stdout=subprocess.DEVNULL) as run:
                if run.wait(PATIENCE_S):
                    raise subprocess.CalledProcessError(run.returncode, command)
        finally:
            cell.terminate()
    return read(record).cycles


def _toml(sections: object, key: str = "") -> str:
    """Nested tables of plain values."""
    assert isinstance(sections, dict)
    lines = [f"[{key}]"] if key else []
    lines += [toml_pair(name, value) for name, value in sections.items() if not isinstance(value, dict)]
    for name, value in sections.items():
        if isinstance(value, dict):
            lines.append(_toml(value, f"{key}.{name}" if key else name))
    return "\n".join(lines) + "\n"


def measure(say: Callable[[str], None]) -> Report:
    """Both rates, both kinds of time."""
    figures, ways, left_out = [], dict(WAYS), []
    try:
        with real_time_thread(RealTime(**AWAKE)):
            pass
    except ConfigError as error:
        left_out.append(str(error))
        ways = {way: realtime for way, realtime in ways.items() if realtime is not AWAKE}
    with tempfile.TemporaryDirectory(prefix="hil-bridge-bench-") as name:
        for baudrate in BAUDRATES:
            floor = line_floor(LinkProfile(baudrate=baudrate)) * MILLI
            say(f"{baudrate} baud, virtual time")
            virtual = cycle_time(simulate(read_config(settings(baudrate))).cycles) * MILLI
            times = {"virtual time": virtual}
            stolen = {}
            for way, realtime in ways.items():
                say(f"{baudrate} baud, {way}")
                before = stolen_s()
                times[way] = cycle_time(real(baudrate, Path(name), realtime)) * MILLI
                stolen[way] = stolen_s() - before
            for way, value in times.items():
                title = f"cycle at {baudrate} baud, {way}"
                figures.append(Figure(title, value, "ms", floor, "floor of the line", USE))
            for way, value in stolen.items():
                title = f"processor time that the host kept for itself, {baudrate} baud, {way}"
                figures.append(Figure(title, value, "s"))
    return Report(tuple(figures), tuple(left_out))
