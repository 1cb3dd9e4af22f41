"""Speed of virtual time: simulated seconds per second, and the cost of another cell in the same process.

Processor time is measured, because nothing waits in virtual time. Other processes do not affect it.
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
REPEATS, COMPLETE_REPEATS = 5, 3
MANY = (1, 2, 4, 8, 16, 32, 64)
MANY_TRACK_S = 1.0
"""Tracking time of each of 127 runs, s. It is short because there are so many runs."""
COMMAND_TRACK_S = 60.0
DEFAULT, DSP = Target("value", 100.0, least=True), Target("value", 40.0, least=True)
GROWTH = Target("ratio", 1.2)
STREAMS = (
    ("EGM and Net F/T at 1 kHz", "egm", "netft", Target("ratio", 0.22, least=True, aim=0.44)),
    ("RTDE at 500 Hz and Net F/T at 1 kHz", "rtde", "netft", Target("ratio", 0.15, least=True, aim=0.3)),
    ("RTDE at 500 Hz and FT 300", "rtde", "ft300", Target("ratio", 0.25, least=True, aim=0.5)),
    ("RSI and NETCANOEM", "rsi", "ati-can", Target("ratio", 0.3, least=True, aim=0.6)),
)
"""Streaming robots, each with a sensor and its target relative to the default cell. Chosen."""
STREAM_TRACK_S = 3.0
SHORT_S, LONG_S = 3.0, 13.0
"""Tracking times of complete runs, s. The cost of tracking is the difference. Chosen."""
AGAINST = "real time"


def speed_once(config: Config, sensor: str) -> float:
    """Return simulated seconds per second of processor time, from the first cycle to the last."""
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
    """Return the best speed of several runs, because other work on the machine can only add time."""
    return max(speed_once(config, sensor) for _ in range(REPEATS))


def stream_speeds(default: Config) -> tuple[list[float], float]:
    """Return the speeds of all streaming robots and of the default cell. They are measured in turn, and the best of
    several rounds counts.
    """
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


def processor_time(*arguments: str) -> float:
    """Return the processor time of the command `run --virtual` with these arguments, s."""
    before = os.times()
    command = [sys.executable, "-m", "hil_bridge", "run", "--virtual", "--seed", "7", *arguments]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system


def complete_run_speeds() -> tuple[list[float], float]:
    """Return the speeds of all streaming robots and of the default cell by complete runs without a recording, in which
    each packet has a decision. The best of several rounds counts.
    """
    cells = [["--robot", robot, "--sensor", sensor] for _, robot, sensor, _ in STREAMS]

    def tracking_speed(cell: list[str]) -> float:
        short, long = (
            processor_time(*cell, "--no-record", "--duration", str(track_s)) for track_s in (SHORT_S, LONG_S)
        )
        return (LONG_S - SHORT_S) / (long - short)

    rounds = [[*map(tracking_speed, cells), tracking_speed([])] for _ in range(COMPLETE_REPEATS)]
    *streams, default_best = map(max, zip(*rounds, strict=True))
    return streams, default_best


def cost_each(count: int) -> float:
    """Return the processor time per simulated second of each cell if several cells run in one loop, s."""
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
    """Return the speed of `hil-bridge run --virtual`, including recorder, start and figures.

    It is returned twice: by wall time and by processor time.
    """
    record = place / "run.mcap"
    began = time.monotonic()
    used = processor_time("--duration", str(COMMAND_TRACK_S), "--record", str(record), "--overwrite")
    wall = time.monotonic() - began
    recording = read(record)
    simulated = recording.events[-1].at - recording.events[0].at
    return simulated / wall, simulated / used


def measure(report_step: Callable[[str], None]) -> Report:
    """Measure one cell of each kind, the command, and many cells."""
    report_step("default cell")
    default_config = read_config({"run": {"duration_s": TRACK_S, "seed": 7}})
    default = speed(default_config, CAN)
    report_step("1 kHz sensor on the receiver board")
    board_config = read_config(
        {"run": {"duration_s": BOARD_TRACK_S, "seed": 7}, "sensor": {"jr3": {"board": {"period_ms": 1.0}}}}
    )
    board = speed(board_config, BOARD)
    report_step("robots that stream")
    streams, default_speed = stream_speeds(default_config)
    report_step("complete runs of robots that stream")
    complete, default_complete = complete_run_speeds()
    report_step("the command")
    with tempfile.TemporaryDirectory(prefix="hil-bridge-bench-") as name:
        wall, used = command(Path(name))
    unit = "s/s"
    figures = [
        Figure("default cell, per second of processor time", default, unit, 1.0, AGAINST, DEFAULT),
        Figure("1 kHz sensor on the DSP board, per second of processor time", board, unit, 1.0, AGAINST, DSP),
        *(
            Figure(
                f"{name}, per second of processor time", value, unit, default_speed, "default cell", target
            )
            for (name, _, _, target), value in zip(STREAMS, streams, strict=True)
        ),
        *(
            Figure(f"{name}, by complete runs", value, unit, default_complete, "default cell")
            for (name, *_), value in zip(STREAMS, complete, strict=True)
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
        report_step(f"{count} cells in one process" if count > 1 else "one cell")
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
