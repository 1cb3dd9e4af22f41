"""An hour in virtual time with its recorder: memory minute by minute, processor time; and the recorder alone.

The hour runs in a process of its own, so that its memory is its own. So does a shorter run that tells whose objects
grow in number or size.
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
"""Minutes of the run whose every allocation is watched, which takes four times as long."""
SETTLED_MINUTES = 1
"""First minutes, whose allocations may stay."""
CHUNK_LOOK_S = 0.1
"""Between two looks at whether the recorder has finished a chunk; it does so every 20 s or so."""
SPEED_MM_S = 0.05
"""Along the surface: an hour stays on it."""
RECORDS = 100_000
KIB = 2.0**10
MIB = 2.0**20
ALL = "all modules"
WORTH_SAYING = 64.0
"""Bytes a minute; what changes less is the noise of what happens to live at a look."""
NO_GROWTH = Target("value", 1.0, aim=0.0)
"""Percent of the memory after the first minute by which it may have grown at the end. An allocator's pages grow so for
the same amount of data.
"""


def module_of(filename: str) -> str:
    """Return the name of the module in this file, or the file's where there is none."""
    files = {getattr(module, "__file__", None): name for name, module in sys.modules.items()}
    return files.get(filename, filename)


def size_of(file: Path) -> int:
    """Bytes of it that the system has been given."""
    return file.stat().st_size


def resident() -> int:
    """Memory of this process, bytes."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


async def track(record: Path, minutes: int, look: Callable[[], object]) -> dict[str, object]:
    """Track for so long and a minute. Look after every minute but the last, as soon as the recorder has finished a
    chunk. Then its part of the next one is always as small.
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
        looks = group.create_task(looking())
        await run.main()
        looks.cancel()  # it would wait for a file that grows no more
    recorder.close()
    used = time.process_time() - began
    return {
        "cpu_s": used,
        "simulated_s": run.simulated,
        "frames": run.frames,
        "dropped": sum(recorder.dropped.values()),
    }


def hour(record: Path) -> dict[str, object]:
    """Run an hour; also return the memory of this process after every minute, bytes."""
    memory: list[int] = []
    told = run_virtual(lambda: track(record, HOUR_MINUTES, lambda: memory.append(resident())))
    return told | {"memory": memory}


def growth(record: Path) -> dict[str, float]:
    """Growth of the objects that live, by the module that made them, bytes a minute. It comes from a shorter run, which
    watches every allocation but the watching's own.
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
    """Three rates: sensor records a second through the recorder, the same written as lines of JSON by the standard
    library, and the recorder's bytes of messages a second.
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


def asked(what: str, record: Path) -> dict[str, Any]:
    """Answer of a process of its own about `hour` or `growth`."""
    child = [sys.executable, "-m", "tools.bench.long_run", what, str(record)]
    told: dict[str, Any] = json.loads(
        subprocess.run(child, check=True, stdout=subprocess.PIPE, text=True).stdout
    )
    return told


def measure(say: Callable[[str], None]) -> Report:
    """Measure the hour, whose objects grow, then the recorder."""
    with tempfile.TemporaryDirectory(prefix="hil-bridge-bench-") as name:
        place = Path(name)
        say("an hour in virtual time")
        told = asked("hour", place / "hour.mcap")
        size = size_of(place / "hour.mcap")
        say(f"{TRACED_MINUTES} minutes of it with every allocation watched")
        grown = asked("growth", place / "growth.mcap")
        say("recorder")
        ours, plain, rate = recorder_speed(place)
    if told["dropped"]:
        raise RuntimeError(f"the recorder dropped {told['dropped']} records")
    if len(told["memory"]) < HOUR_MINUTES:
        raise RuntimeError(f"the run ended in its minute {len(told['memory']) + 1}")
    memory = np.array(told["memory"]) / MIB
    minutes = np.arange(1, len(memory) + 1)
    slope_mib = float(np.polyfit(minutes[1:], memory[1:], 1)[0])
    first, last = float(memory[0]), float(memory[-1])
    growth_percent = 100.0 * (last / first - 1.0)
    whole = f"{HOUR_MINUTES + 1} minutes"
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
                f"processor time of {whole}",
                told["cpu_s"],
                "s",
                told["simulated_s"],
                "simulated",
            ),
            Figure(f"recording of {whole}", size / MIB, "MiB"),
            Figure(f"sensor frames recorded in {whole}", float(told["frames"]), ""),
            Figure("recorder, sensor records", ours, "1/s", plain, "lines of JSON by the standard library"),
            Figure("recorder, JSON in its messages", rate / MIB, "MiB/s"),
        )
    )


if __name__ == "__main__":
    json.dump({"hour": hour, "growth": growth}[sys.argv[1]](Path(sys.argv[2])), sys.stdout)
