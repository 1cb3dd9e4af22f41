"""The bridge and its emulated cell as processes of their own, as an operator starts them."""

import json
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from hil_bridge.clock.realtime import RealTime, real_time_thread
from hil_bridge.errors import ConfigError
from hil_bridge.lab.tuning.writing import toml
from tools.bench.machine import stolen_s

HIL_BRIDGE = (sys.executable, "-m", "hil_bridge")
PATIENCE_S = 120.0
"""Longest time of all that a run does beside tracking, s."""
BUSY_POLL_MS = 100.0
"""Longer than any wait of a cycle, so that the bridge never sleeps."""
AWAKE = ", processors kept awake"
STOLEN = "processor time that the host kept for itself"


class RunFailed(Exception):
    """A program of the benchmark did not come to its end."""


class Ended(NamedTuple):
    """A run that has come to its end."""

    summary: Mapping[str, Any]
    stolen_s: float
    """Processor time that the host kept for itself meanwhile, s."""


def slow_tool(robot: str, track_s: float) -> dict[str, Any]:
    """Return settings of a run whose tool goes so slowly that it stays on the surface and in reach of the robot."""
    return {
        "run": {"duration_s": track_s},
        "task": {"speed_mm_s": 1.0, "approach_speed_mm_s": 10.0, "retract_mm": 5.0},
        "robot": {"emulated": robot},
    }


def write_config(path: Path, settings: Mapping[str, Any]) -> Path:
    """Write nested settings as a configuration, and return its path."""
    path.write_text(toml(settings, ()), encoding="utf-8")
    return path


@contextmanager
def started(*command: str | Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Start a program, and yield it with the first line of its output. It is ended if it has not ended by itself."""
    with subprocess.Popen(list(map(str, command)), stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            if not (line := process.stdout.readline().strip()):
                raise RunFailed(f"{Path(command[0]).name} said nothing and ended with {process.wait()}")
            yield process, line
        finally:
            process.send_signal(signal.SIGTERM)
            with suppress(subprocess.TimeoutExpired):
                process.wait(10.0)
            process.kill()


@contextmanager
def emulated_cell(config: Path, *options: str) -> Iterator[dict[str, str]]:
    """Emulate a cell, and yield the options with which a bridge runs on it, by their names."""
    with started(*HIL_BRIDGE, "emulate", "cell", config, "--json", *options) as (_, line):
        yield json.loads(line)


def run_bridge(config: Path, devices: Mapping[str, str], record: Path | None, patience_s: float) -> Ended:
    """Run a bridge on these devices to its end. Raises RunFailed."""
    summary = config.with_suffix(".json")
    options = [part for name, value in devices.items() for part in (f"--{name}", value)]
    keep: Sequence[str | Path] = ("--no-record",) if record is None else ("--record", record)
    command = [*HIL_BRIDGE, "run", config, *options, "--no-view", *keep, "--summary", summary, "--overwrite"]
    stolen = stolen_s()
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=patience_s, check=False)
    except subprocess.TimeoutExpired as error:
        raise RunFailed(f"the run has not ended within {error.timeout:g} s") from error
    stolen = stolen_s() - stolen
    if done.returncode:
        raise RunFailed(f"the run ended with {done.returncode}: {done.stderr.strip()}")
    return Ended(json.loads(summary.read_text(encoding="utf-8")), stolen)


@contextmanager
def processors_awake(left_out: list[str]) -> Iterator[bool]:
    """Keep the processors from sleeping meanwhile, and yield whether they do not.

    Why a machine refuses is entered among what is left out.
    """
    with ExitStack() as stack:
        try:
            stack.enter_context(real_time_thread(RealTime(keep_awake=True)))
        except ConfigError as error:
            if str(error) not in left_out:
                left_out.append(str(error))
            yield False
        else:
            yield True
