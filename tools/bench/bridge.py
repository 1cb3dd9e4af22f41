"""Bridge and emulated cell as separate processes, as an operator starts them."""

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
"""Time limit of a run, in addition to its tracking time, s."""
BUSY_POLL_MS = 100.0
"""Busy-poll time, ms. It is longer than any wait in a cycle, so the bridge never sleeps."""
AWAKE = ", processors kept awake"
STOLEN = "processor time that the host kept for itself"


class RunFailed(Exception):
    """Failure of a program that the benchmark started."""


class CompletedRun(NamedTuple):
    """Results of a completed run."""

    summary: Mapping[str, Any]
    stolen_s: float
    """Processor time that the host withheld during the run, s."""


def slow_tool(robot: str, track_s: float) -> dict[str, Any]:
    """Return settings of a run whose tool moves so slowly that it stays on the surface and within the robot's reach."""
    return {
        "run": {"duration_s": track_s},
        "task": {"speed_mm_s": 1.0, "approach_speed_mm_s": 10.0, "retract_mm": 5.0},
        "robot": {"emulated": robot},
    }


def write_config(path: Path, settings: Mapping[str, Any]) -> Path:
    """Write nested settings to a configuration file, and return its path."""
    path.write_text(toml(settings, ()), encoding="utf-8")
    return path


@contextmanager
def started(*command: str | Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Start a program, and yield it with the first line of its output. At the end, terminate it if it is still
    running.
    """
    with subprocess.Popen(list(map(str, command)), stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            if not (line := process.stdout.readline().strip()):
                raise RunFailed(
                    f"{Path(command[0]).name} printed nothing and ended with exit code {process.wait()}"
                )
            yield process, line
        finally:
            process.send_signal(signal.SIGTERM)
            with suppress(subprocess.TimeoutExpired):
                process.wait(10.0)
            process.kill()


@contextmanager
def emulated_cell(config: Path, *options: str) -> Iterator[dict[str, str]]:
    """Emulate a cell, and yield the options with which a bridge connects to it, by name."""
    with started(*HIL_BRIDGE, "emulate", "cell", config, "--json", *options) as (_, line):
        yield json.loads(line)


def run_bridge(
    config: Path, devices: Mapping[str, str], record: Path | None, patience_s: float
) -> CompletedRun:
    """Run a bridge on these devices until it ends. Raises RunFailed."""
    summary = config.with_suffix(".json")
    options = [part for name, value in devices.items() for part in (f"--{name}", value)]
    keep: Sequence[str | Path] = ("--no-record",) if record is None else ("--record", record)
    command = [*HIL_BRIDGE, "run", config, *options, "--no-view", *keep, "--summary", summary, "--overwrite"]
    stolen = stolen_s()
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=patience_s, check=False)
    except subprocess.TimeoutExpired as error:
        raise RunFailed(f"the run did not end within {error.timeout:g} s") from error
    stolen = stolen_s() - stolen
    if done.returncode:
        raise RunFailed(f"the run ended with exit code {done.returncode}: {done.stderr.strip()}")
    return CompletedRun(json.loads(summary.read_text(encoding="utf-8")), stolen)


@contextmanager
def processors_awake(left_out: list[str]) -> Iterator[bool]:
    """Prevent the processors from sleeping within the context. Yield whether that is possible.

    If the machine refuses, the reason is added to the report's list of figures left out.
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
