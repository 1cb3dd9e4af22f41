"""One hour in virtual time with the recorder: memory for each minute and processor time. Also the recorder alone.

The hour runs in a separate process, so that its memory can be measured. A shorter run, also in a separate process,
reports which modules' objects grow in number or size.
"""

import asyncio
import gc
import json
import os
import subprocess
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from hil_bridge.clock import VIRTUAL_WALL_NS, Clock, run_virtual
from hil_bridge.record import VIRTUAL, Recorder, SensorRecord, Writing
from hil_bridge.record.recorder import map_buffers
from hil_bridge.settings.configuration import read_config
from tools.bench.cells import CellRun
from tools.bench.figures import Figure, Report, Target

MINUTE_S = 60.0
HOUR_MINUTES = 60
TRACED_MINUTES = 20
"""Duration of the run with traced allocations, minutes. Tracing makes it four times as slow."""
SETTLED_MINUTES = 1
"""Time at the start of a run during which allocations are ignored, minutes."""
CHUNK_LOOK_S = 0.1
"""Interval between checks for a completed chunk of the recorder, s. The recorder completes a chunk about every 20 s."""
SPEED_MM_S = 0.05
"""Speed along the surface, mm/s, low enough to stay on the surface for an hour."""
RECORDS = 100_000
KIB = 2.0**10
MIB = 2.0**20
ALL = "all modules"
WORTH_SAYING = 64.0
"""Smallest growth that is reported, bytes per minute. Less growth is noise."""
NO_GROWTH = Target("value", 1.0, aim=0.0)
"""Maximum growth at the end, in percent of the memory after the first minute. The pages of an allocator grow by
that much for the same amount of data.
"""


def module_of(filename: str) -> str:
    """Return the name of the module in this file, or the file's name if it is not a module."""
    files = {getattr(module, "__file__", None): name for name, module in sys.modules.items()}
    return files.get(filename, filename)


def size_of(file: Path) -> int:
    """Return the number of bytes that are written to the file."""
    return file.stat().st_size


def resident() -> int:
    """Return the resident memory of this process, bytes."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


async def track(record: Path, minutes: int, look: Callable[[], object]) -> dict[str, object]:
    """Track for this many minutes plus one, and call `look` after every minute except the last.

    The call follows when the recorder has completed a chunk, so that the open chunk always has the same small size.
    """
    duration_s = (minutes + 1) * MINUTE_S
    config = read_config({"run": {"duration_s": duration_s}, "task": {"speed_mm_s": SPEED_MM_S}})
    clock = Clock.running()
    map_buffers()
    recorder = Recorder(record, clock.wall_ns, {}, VIRTUAL)
    run = CellRun(
        config,
        on_cycle=recorder.put,
        on_event=recorder.put,
        on_frame=recorder.put,
    )

    async def looking() -> None:
        began = clock.now()
        for minute in range(1, minutes + 1):
            await clock.sleep_until(began + minute * MINUTE_S)
            size = size_of(record)
            while size_of(record) == size:
                await clock.sleep_until(clock.now() + CHUNK_LOOK_S)
            look()

    began = time.process_time()
    async with asyncio.TaskGroup() as group:
        timer = group.create_task(looking())
        await run.main()
        timer.cancel()  # it would wait for a file that no longer grows
    recorder.close()
    used = time.process_time() - began
    return {
        "cpu_s": used,
        "simulated_s": run.simulated,
        "frames": run.frames,
        "dropped": sum(recorder.dropped.values()),
    }


def hour(record: Path) -> dict[str, object]:
    """Run for an hour. Also return the memory of this process after every minute, bytes."""
    memory: list[int] = []
    result = run_virtual(lambda: track(record, HOUR_MINUTES, lambda: memory.append(resident())))
    return result | {"memory": memory}


def growth(record: Path) -> dict[str, float]:
    """Return the growth of the live objects, by the module that created them, bytes per minute.

    It is measured in a shorter run with traced allocations. Allocations of the tracing itself are excluded.
    """
    sizes: list[dict[str, int]] = []
    ours = [tracemalloc.Filter(False, file) for file in (__file__, tracemalloc.__file__)]

    def look() -> None:
        gc.collect()
        statistics = tracemalloc.take_snapshot().filter_traces(ours).statistics("filename")
        sizes.append({module_of(one.traceback[0].filename): one.size for one in statistics})

    tracemalloc.start()
    run_virtual(lambda: track(record, TRACED_MINUTES, look))
    if len(sizes) < TRACED_MINUTES:
        raise RuntimeError(f"the run ended in its minute {len(sizes) + 1}")
    after = sizes[SETTLED_MINUTES:]
    minutes = np.arange(len(after))
    modules = {module for one in after for module in one}
    return {
        module: float(np.polyfit(minutes, [one.get(module, 0) for one in after], 1)[0])
        for module in sorted(modules)
    }


def recorder_speed(place: Path) -> tuple[float, float, float]:
    """Return three rates of the recorder: sensor records, lines of JSON, and bytes of messages, per second.

    The lines of JSON contain the same sensor records, written by the standard library.
    """
    records = [SensorRecord(k * 1e-3, k, (k % 99, -3, -870 - k % 7, 12, 5, -1)) for k in range(RECORDS)]
    began = time.process_time()
    recorder = Recorder(
        place / "speed.mcap", lambda at: VIRTUAL_WALL_NS + round(at * 1e9), {}, Writing(False)
    )
    for record in records:
        recorder.put(record)
    recorder.close()
    ours = time.process_time() - began
    began = time.process_time()
    with (place / "speed.jsonl").open("w", encoding="ascii") as file:
        for record in records:
            line = {"at": record.at, "sequence": record.sequence, "counts": record.counts}
            file.write(json.dumps(line, separators=(",", ":")) + "\n")
    plain = time.process_time() - began
    return RECORDS / ours, RECORDS / plain, size_of(place / "speed.jsonl") / ours


def run_separately(what: str, record: Path) -> dict[str, Any]:
    """Return the result of `hour` or `growth`, computed in a separate process."""
    child = [sys.executable, "-m", "tools.bench.long_run", what, str(record)]
    result: dict[str, Any] = json.loads(
        subprocess.run(child, check=True, stdout=subprocess.PIPE, text=True).stdout
    )
    return result


def measure(report_step: Callable[[str], None]) -> Report:
    """Measure the hour, then its growing objects, then the recorder."""
    with tempfile.TemporaryDirectory(prefix="hil-bridge-bench-") as name:
        place = Path(name)
        report_step("an hour in virtual time")
        result = run_separately("hour", place / "hour.mcap")
        size = size_of(place / "hour.mcap")
        report_step(f"{TRACED_MINUTES} minutes of it with every allocation watched")
        grown = run_separately("growth", place / "growth.mcap")
        report_step("recorder")
        ours, plain, rate = recorder_speed(place)
    if result["dropped"]:
        raise RuntimeError(f"the recorder dropped {result['dropped']} records")
    if len(result["memory"]) < HOUR_MINUTES:
        raise RuntimeError(f"the run ended in its minute {len(result['memory']) + 1}")
    memory = np.array(result["memory"]) / MIB
    minutes = np.arange(1, len(memory) + 1)
    slope_mib = float(np.polyfit(minutes[1:], memory[1:], 1)[0])
    first, last = float(memory[0]), float(memory[-1])
    growth_percent = 100.0 * (last / first - 1.0)
    duration = f"{HOUR_MINUTES + 1} minutes"
    live = {ALL: sum(grown.values())} | grown
    return Report(
        (
            Figure("memory after an hour", last, "MiB", first, "after the first minute"),
            Figure("growth of memory after the first minute", growth_percent, "%", target=NO_GROWTH),
            Figure("slope of memory after the first minute", slope_mib * KIB, "KiB/min"),
            *(
                Figure(f"slope of the objects that live, {module}", slope / KIB, "KiB/min")
                for module, slope in sorted(live.items(), key=lambda item: -item[1])
                if slope >= WORTH_SAYING or module == ALL
            ),
            Figure(
                f"processor time of {duration}",
                result["cpu_s"],
                "s",
                result["simulated_s"],
                "simulated",
            ),
            Figure(f"recording of {duration}", size / MIB, "MiB"),
            Figure(f"sensor frames recorded in {duration}", float(result["frames"]), ""),
            Figure("recorder, sensor records", ours, "1/s", plain, "lines of JSON by the standard library"),
            Figure("recorder, JSON in its messages", rate / MIB, "MiB/s"),
        )
    )


if __name__ == "__main__":
    json.dump({"hour": hour, "growth": growth}[sys.argv[1]](Path(sys.argv[2])), sys.stdout)
