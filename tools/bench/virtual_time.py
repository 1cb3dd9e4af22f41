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

from hil_bridge.recording import CycleRecord, read
from hil_bridge.settings.configuration import Config
from tools.bench.cells import BOARD, CAN, CellRun, run_together
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
AGAINST = "real time"


def speed(config: Config, sensor: str) -> float:
    """Simulated seconds per second of processor time from the first cycle to the last, the best of some runs.

    The best, because whatever else a machine does only adds.
    """
    best = 0.0
    for _ in range(REPEATS):
        marks: list[tuple[float, float]] = []

        def mark(record: CycleRecord, marks: list[tuple[float, float]] = marks) -> None:
            marks.append((record.answered_at, time.process_time()))

        run_together([CellRun(config, sensor=sensor, on_cycle=mark)])
        (from_s, from_cpu), (to_s, to_cpu) = marks[0], marks[-1]
        best = max(best, (to_s - from_s) / (to_cpu - from_cpu))
    return best


def cost_each(count: int) -> float:
    """Processor time of a whole run of each of so many cells in one loop, per simulated second, s."""
    config = Config.model_validate({"run": {"duration_s": MANY_TRACK_S}})
    best = float("inf")
    for _ in range(max(1, 8 // count)):
        gc.collect()
        runs = [CellRun(config, number) for number in range(count)]
        began = time.process_time()
        run_together(runs)
        best = min(best, (time.process_time() - began) / sum(run.simulated for run in runs))
    return best


def command(place: Path) -> tuple[float, float]:
    """Simulated seconds per second of `hil-bridge run --virtual` with its recorder, start and figures included: by
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
    default_config = Config.model_validate({"run": {"duration_s": TRACK_S, "seed": 7}})
    default = speed(default_config, CAN)
    say("1 kHz sensor on the receiver board")
    board_config = Config.model_validate(
        {"run": {"duration_s": BOARD_TRACK_S, "seed": 7}, "sensor": {"board": {"period_ms": 1.0}}}
    )
    board = speed(board_config, BOARD)
    say("the command")
    with tempfile.TemporaryDirectory(prefix="hil-bridge-bench-") as name:
        wall, used = command(Path(name))
    unit = "s/s"
    figures = [
        Figure("default cell, per second of processor time", default, unit, 1.0, AGAINST, DEFAULT),
        Figure("1 kHz sensor on the DSP board, per second of processor time", board, unit, 1.0, AGAINST, DSP),
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
