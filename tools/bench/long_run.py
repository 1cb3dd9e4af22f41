"""An hour in virtual time with its recorder: memory minute by minute, processor time; and the recorder alone.

The hour runs in a process of its own, so that its memory is its own.
"""

import asyncio
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from hil_bridge.clock import VIRTUAL_WALL_NS, Clock, run_virtual
from hil_bridge.config import Config
from hil_bridge.recording import VIRTUAL_CHUNKS, Recorder, SensorRecord
from tools.bench.cells import CellRun
from tools.bench.figures import Figure, Report, Target

HOUR_S = 3600.0
MINUTE_S = 60.0
STEP_MM = 0.01
"""Travel a cycle: an hour stays on the surface."""
RECORDS = 100_000
MIB = 2.0**20
NO_GROWTH = Target("value", 1.0, aim=0.0)
"""Percent of the memory after the first minute by which it may have grown at the end: what an allocator's pages make
of the same amount of data.
"""


def resident() -> int:
    """Memory of this process, bytes."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


async def hour(record: Path) -> dict[str, object]:
    """Run for an hour and look at the memory every minute."""
    config = Config.model_validate({"run": {"duration_s": HOUR_S}, "task": {"step_mm": STEP_MM}})
    clock = Clock.running()
    recorder = Recorder(record, clock.wall_ns, threaded=False, metadata={}, chunks=VIRTUAL_CHUNKS)
    run = CellRun(
        config,
        on_cycle=recorder.put,
        on_event=recorder.put,
        on_frame=lambda frame: recorder.put(SensorRecord(frame.at, frame.sequence, frame.counts)),
    )
    memory: list[int] = []

    async def look() -> None:
        began = clock.now()
        while True:
            await clock.sleep_until(began + (len(memory) + 1) * MINUTE_S)
            memory.append(resident())

    began = time.process_time()
    looking = asyncio.create_task(look())
    try:
        await run.main()
    finally:
        looking.cancel()
    used = time.process_time() - began
    recorder.close()
    return {
        "memory": memory,
        "cpu_s": used,
        "simulated_s": run.simulated,
        "frames": run.frames,
        "cycles": run.cycles,
        "dropped": sum(recorder.dropped.values()),
    }


def recorder_speed(place: Path) -> tuple[float, float, float]:
    """Sensor records a second through the recorder, the same written as lines of JSON by the standard library, and
    the recorder's bytes of messages a second.
    """
    records = [SensorRecord(k * 1e-3, k, (k % 99, -3, -870 - k % 7, 12, 5, -1)) for k in range(RECORDS)]
    began = time.process_time()
    recorder = Recorder(place / "speed.mcap", lambda at: VIRTUAL_WALL_NS + round(at * 1e9), False, {})
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
    size = (place / "speed.jsonl").stat().st_size
    return RECORDS / ours, RECORDS / plain, size / ours


def measure(say: Callable[[str], None]) -> Report:
    """The hour, then the recorder."""
    with tempfile.TemporaryDirectory(prefix="hil-bridge-bench-") as name:
        place = Path(name)
        say("an hour in virtual time")
        child = [sys.executable, "-m", "tools.bench.long_run", str(place / "hour.mcap")]
        told = json.loads(subprocess.run(child, check=True, stdout=subprocess.PIPE, text=True).stdout)
        size = (place / "hour.mcap").stat().st_size
        say("recorder")
        ours, plain, rate = recorder_speed(place)
    if told["dropped"]:
        raise RuntimeError(f"the recorder dropped {told['dropped']} records")
    memory = np.array(told["memory"][:60]) / MIB
    minutes = np.arange(1, len(memory) + 1)
    slope = float(np.polyfit(minutes[1:], memory[1:], 1)[0])
    first, last = float(memory[0]), float(memory[-1])
    growth = 100.0 * (last / first - 1.0)
    return Report(
        (
            Figure("memory after an hour", last, "MiB", first, "after the first minute"),
            Figure("growth of memory after the first minute", growth, "%", target=NO_GROWTH),
            Figure("slope of memory after the first minute", slope * 1024.0, "KiB/min"),
            Figure("processor time of the hour", told["cpu_s"], "s", told["simulated_s"], "simulated"),
            Figure("recording of the hour", size / MIB, "MiB"),
            Figure("sensor frames recorded in the hour", float(told["frames"]), ""),
            Figure("recorder, sensor records", ours, "1/s", plain, "lines of JSON by the standard library"),
            Figure("recorder, JSON in its messages", rate / MIB, "MiB/s"),
        )
    )


if __name__ == "__main__":
    json.dump(run_virtual(lambda: hour(Path(sys.argv[1]))), sys.stdout)
