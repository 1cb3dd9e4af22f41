"""Virtual time: simulated seconds per second, and what one more cell in the same process costs.

Processor time is what counts: nothing waits in virtual time, and it leaves other processes out of the figure.
"""

import gc
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from hil_bridge.record import read
from hil_bridge.settings.configuration import Config, read_config
from tools.bench.cells import BOARD, CAN, USUAL, CellRun, run_together
from tools.bench.figures import Figure, Report, Target

TRACK_S = 20.0
BOARD_TRACK_S = 10.0
REPEATS = 5
MANY = (1, 2, 4, 8, 16, 32, 64)
MANY_TRACK_S = 1.0
"""Short, for there are 127 of them."""
COMMAND_TRACK_S = 60.0
DEFAULT, DSP = Target("value", 100.0, least=True), Target("value", 40.0, least=True)
GROWTH = Target("ratio", 1.2)
STREAMS = (
    ("EGM and Net F/T at 1 kHz", "egm", "netft", Target("ratio", 0.18, least=True)),
    ("RTDE at 500 Hz and Net F/T at 1 kHz", "rtde", "netft", Target("ratio", 0.10, least=True)),
    ("RTDE at 500 Hz and FT 300", "rtde", "ft300", None),
    ("RSI and NETCANOEM", "rsi", "ati-can", Target("ratio", 0.2, least=True)),
)
"""Robots that stream, with a sensor, and the target against the default cell. Chosen."""
STREAM_TRACK_S = 3.0
AGAINST = "real time"


def speed_once(config: Config, sensor: str) -> float:
    """Return simulated seconds per second of processor time from the first cycle to the last."""
    marks: list[tuple[float, float]] = []
    run_together(
        [
            CellRun(
                config,
                sensor=sensor,
                on_cycle=lambda record: marks.append((record.answered_at, time.process_time())),
            )
        ]
    )
    (from_s, from_cpu), (to_s, to_cpu) = marks[0], marks[-1]
    return (to_s - from_s) / (to_cpu - from_cpu)


def speed(config: Config, sensor: str) -> float:
    """Return the best of some runs, because whatever else a machine does only adds."""
    return max(speed_once(config, sensor) for _ in range(REPEATS))


def stream_speeds(default: Config) -> tuple[list[float], float]:
    """Speeds of all streams, and that of the default cell measured in turn with them: the best of some rounds."""
    configs = [
        read_config(
            {
                "run": {"duration_s": STREAM_TRACK_S, "seed": 7, "period_ms": 20},
                "controller": {"sample_ms": 20},
                "robot": {"emulated": robot},
                "sensor": {"emulated": sensor},
            }
        )
        for _, robot, sensor, _ in STREAMS
    ]
    rounds = [
        [*(speed_once(config, USUAL) for config in configs), speed_once(default, CAN)] for _ in range(REPEATS)
    ]
    *streams, default_best = map(max, zip(*rounds, strict=True))
    return streams, default_best


def cost_each(count: int) -> float:
    """Processor time of a whole run of each of so many cells in one loop, per simulated second, s."""
    config = read_config({"run": {"duration_s": MANY_TRACK_S}})
    best = float("inf")
    for _ in range(max(1, 8 // count)):
        gc.collect()
        runs = [CellRun(config, number) for number in range(count)]
        began = time.process_time()
        run_together(runs)
        best = min(best, (time.process_time() - began) / sum(run.simulated for run in runs))
    return best


def command(place: Path) -> tuple[float, float]:
    """Return simulated seconds per second of `hil-bridge run --virtual`, recorder, start and figures included: by
    the wall, and by processor time.
    """
    record = place / "run.mcap"
    arguments = [
        "run",
        "--virtual",
        "--duration",
        str(COMMAND_TRACK_S),
        "--seed",
        "7",
        "--record",
        str(record),
        "--overwrite",
    ]
    cpu, wall = os.times(), time.monotonic()
    subprocess.run([sys.executable, "-m", "hil_bridge", *arguments], check=True, stdout=subprocess.DEVNULL)
    wall, after = time.monotonic() - wall, os.times()
    used = after.children_user + after.children_system - cpu.children_user - cpu.children_system
    recording = read(record)
    simulated = recording.events[-1].at - recording.events[0].at
    return simulated / wall, simulated / used


def measure(say: Callable[[str], None]) -> Report:
    """One cell of each kind, the command, and many cells."""
    say("default cell")
    default_config = read_config({"run": {"duration_s": TRACK_S, "seed": 7}})
    default = speed(default_config, CAN)
    say("1 kHz sensor on the receiver board")
    board_config = read_config(
        {"run": {"duration_s": BOARD_TRACK_S, "seed": 7}, "sensor": {"jr3": {"board": {"period_ms": 1.0}}}}
    )
    board = speed(board_config, BOARD)
    say("robots that stream")
    streams, default_beside = stream_speeds(default_config)
    say("the command")
    with tempfile.TemporaryDirectory(prefix="hil-bridge-bench-") as name:
        wall, used = command(Path(name))
    unit = "s/s"
    figures = [
        Figure("default cell, per second of processor time", default, unit, 1.0, AGAINST, DEFAULT),
        Figure("1 kHz sensor on the DSP board, per second of processor time", board, unit, 1.0, AGAINST, DSP),
        *(
            Figure(
                f"{name}, per second of processor time", value, unit, default_beside, "default cell", target
            )
            for (name, _, _, target), value in zip(STREAMS, streams, strict=True)
        ),
        Figure(
            f"run --virtual --duration {COMMAND_TRACK_S:.0f}, recorded, by the wall", wall, unit, 1.0, AGAINST
        ),
        Figure(
            f"run --virtual --duration {COMMAND_TRACK_S:.0f}, recorded, by processor",
            used,
            unit,
            1.0,
            AGAINST,
        ),
    ]
    alone = 0.0
    for count in MANY:
        say(f"{count} cells in one process" if count > 1 else "one cell")
        cost_ms = cost_each(count) * 1e3
        if count == 1:
            alone = cost_ms
        figures.append(
            Figure(
                f"processor time of each of {count} cells" if count > 1 else "processor time of one cell",
                cost_ms,
                "ms/s",
                alone,
                "one cell",
                GROWTH if count == MANY[-1] else None,
            )
        )
    return Report(tuple(figures))
