"""Web clients: whether a run answers its robot later while three clients watch its page than while none does.

One run on the emulated cell, 250 cycles a second. Clients come and go in turns, so that whatever else the machine does
meets both alike: two pages, and one client of Foxglove's protocol that wants every channel.

`python -m tools.bench.web_clients 60` tracks for 60 s and shows the figures.
"""

import asyncio
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

import aiohttp

from hil_bridge.recording import CycleRecord, read
from tools.bench.figures import Figure, Report, Spread, Target
from tools.web_run import WebRun

TRACK_S = 120.0
TURN_S = 5.0
"""With clients, then as long without."""
SETTLE_S = 0.7
"""Begin of each turn that does not count."""
PATIENCE_S = 120.0
TARGET = Target("ratio", 1.1)
CONFIG = """\
[run]
duration_s = %g
[task]
speed_mm_s = 1.0
approach_speed_mm_s = 10.0
retract_mm = 5.0
[robot]
emulated = "egm"
[sensor]
emulated = "netft"
[limits]
stale_after_ms = 20000.0
still_after_ms = 20000.0
cycle_deadline_ms = 20000.0
"""
"""On a busy machine the run goes on, so that there is something to compare."""
MICRO = 1e6
Turn = tuple[float, float]


async def _watch(session: aiohttp.ClientSession, run: WebRun, foxglove: bool) -> None:
    path, protocols = ("/", ("foxglove.sdk.v1",)) if foxglove else ("/live", ())
    async with session.ws_connect(run.origin + path, protocols=protocols, max_msg_size=0) as socket:
        async for message in socket:
            if foxglove and message.type is aiohttp.WSMsgType.TEXT:
                told = json.loads(message.data)
                if told["op"] == "advertise":
                    wanted = [{"id": one["id"], "channelId": one["id"]} for one in told["channels"]]
                    await socket.send_json({"op": "subscribe", "subscriptions": wanted})


async def _turns(run: WebRun) -> tuple[list[Turn], list[Turn]]:
    """Let clients come and go until the run has ended: when there were some, and when none, s since 1970."""
    with_them: list[Turn] = []
    without: list[Turn] = []
    async with aiohttp.ClientSession() as session:
        while run.process.poll() is None:
            clients = [asyncio.create_task(_watch(session, run, number == 0)) for number in range(3)]
            began = time.time()
            await asyncio.sleep(TURN_S)
            with_them.append((began + SETTLE_S, time.time()))
            for client in clients:
                client.cancel()
            with suppress(aiohttp.ClientError, OSError):
                await asyncio.gather(*clients, return_exceptions=True)
            began = time.time()
            await asyncio.sleep(TURN_S)
            without.append((began + SETTLE_S, time.time()))
    return with_them, without


def answers(cycles: Sequence[CycleRecord], zero_s: float, turns: Sequence[Turn]) -> list[float]:
    """How long the answers of these turns took while the run tracked, s."""
    return [
        cycle.answer_s
        for cycle in cycles
        if cycle.phase == "track" and any(a <= zero_s + cycle.started_at <= b for a, b in turns)
    ]


def measure(tell: Callable[[str], object], track_s: float = TRACK_S) -> Report:
    """Run once and compare."""
    tell(f"one run of {track_s:.0f} s, clients in turns of {TURN_S:.0f} s")
    with tempfile.TemporaryDirectory() as place:
        run = WebRun(Path(place), ("--record", "run.mcap"), CONFIG % track_s)
        try:
            with_them, without = asyncio.run(_turns(run))
        finally:
            with suppress(subprocess.TimeoutExpired):
                run.process.wait(PATIENCE_S)
            run.process.kill()
        recording = read(Path(place) / "run.mcap")
    zero_s = recording.unix_zero_ns * 1e-9
    watched, alone = (Spread(answers(recording.cycles, zero_s, turns)) for turns in (with_them, without))
    figures = []
    for name, share in (("p50", 0.5), ("p99", 0.99), ("p99.9", 0.999)):
        one, two = (times.at(share) * MICRO for times in (watched, alone))
        target = TARGET if name == "p99" else None
        label = f"{name} of an answer with three clients, beside none"
        figures.append(Figure(label, one, "µs", two, "the same run without clients", target))
    figures.append(
        Figure("answers with clients", len(watched.values), "answers", len(alone.values), "answers without")
    )
    return Report(tuple(figures))


if __name__ == "__main__":
    for figure in measure(print, float(sys.argv[1])).figures:
        print(figure.line())
