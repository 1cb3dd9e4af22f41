"""Effect of web clients: whether a run answers its robot later while three clients watch its page.

There is one run of each robot on the emulated cell. Clients connect and disconnect in turns, so that other work on
the machine affects both cases equally. The clients are two pages, and one client of Foxglove's protocol that
subscribes to every channel. They run in a process of lower priority, because they could also run on another
computer.

`python -m tools.bench.web_clients 60` tracks for 60 s and prints the figures.
"""

import asyncio
import json
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import aiohttp

from hil_bridge.errors import BridgeError
from hil_bridge.lab.tuning.writing import toml
from hil_bridge.record import CycleRecord, Recording, read
from tools.bench.bridge import slow_tool
from tools.bench.figures import Figure, Report, Spread, Target
from tools.web_run import WebRun

TRACK_S = 120.0
TURN_S = 6.0
"""Duration of each turn with clients, and of each turn without clients, s."""
SETTLE_S = 2.0
"""Time at the start of each turn that does not count, s."""
TARGET = Target("ratio", 1.1)
PATIENT = dict.fromkeys(("stale_after_ms", "still_after_ms", "cycle_deadline_ms"), 20000.0)
"""Limits that let the run continue on a busy machine, so that there is a result to compare."""
MICRO = 1e6
LEAST = 100
"""Minimum number of values for a p99."""
Turn = tuple[float, float]


class Way(NamedTuple):
    """Cell, with the quantity that increases when the cell's loop is delayed."""

    robot: str
    sensor: str
    what: str
    of: Callable[[CycleRecord], float]


WAYS = (
    Way("egm", "netft", "answer to the robot (egm)", lambda cycle: cycle.answer_s),
    Way("s3", "jr3", "time of a cycle (s3)", lambda cycle: cycle.answered_at - cycle.started_at),
)


async def _watch(session: aiohttp.ClientSession, origin: str, foxglove: bool) -> None:
    path, protocols = ("/", ("foxglove.sdk.v1",)) if foxglove else ("/live", ())
    async with session.ws_connect(origin + path, protocols=protocols, max_msg_size=0) as socket:
        async for message in socket:
            if foxglove and message.type is aiohttp.WSMsgType.TEXT:
                message_data = json.loads(message.data)
                if message_data["op"] == "advertise":
                    subscriptions = [
                        {"id": one["id"], "channelId": one["id"]} for one in message_data["channels"]
                    ]
                    await socket.send_json({"op": "subscribe", "subscriptions": subscriptions})


async def watch(origin: str) -> None:
    """Run three clients until the server ends."""
    async with aiohttp.ClientSession() as session:
        await asyncio.gather(*(_watch(session, origin, number == 0) for number in range(3)))


def _turns(run: WebRun) -> tuple[list[Turn], list[Turn]]:
    """Connect and disconnect clients until the run ends. Return the turns with clients and without clients, s since
    1970.
    """
    turns: tuple[list[Turn], list[Turn]] = ([], [])
    while run.process.poll() is None:
        for watched in (True, False):
            command = ("nice", "-n", "19", sys.executable, "-m", "tools.bench.web_clients", run.origin)
            clients = subprocess.Popen(command, stderr=subprocess.DEVNULL) if watched else None
            began = time.time()
            time.sleep(TURN_S)
            turns[not watched].append((began + SETTLE_S, time.time()))
            if clients is not None:
                clients.kill()
                clients.wait()
    return turns


def values(way: Way, recording: Recording, turns: Sequence[Turn]) -> list[float]:
    """Return the values that were measured in these turns during tracking, s."""
    zero_s = recording.unix_zero_ns * 1e-9
    return [
        way.of(cycle)
        for cycle in recording.cycles
        if math.isfinite(way.of(cycle))
        and cycle.phase == "track"
        and any(a <= zero_s + cycle.started_at <= b for a, b in turns)
    ]


def measure(report_step: Callable[[str], object], track_s: float = TRACK_S) -> Report:
    """Run once with each robot, and compare the turns with and without clients."""
    figures: list[Figure] = []
    left_out: list[str] = []
    for way in WAYS:
        report_step(f"{way.robot}: one run of {track_s:.0f} s, clients in turns of {TURN_S:.0f} s")
        try:
            recording, turns = _tracked(way, track_s)
        except BridgeError:
            left_out.append(f"{way.what}: the run ended before it moved, since the machine is too busy")
            continue
        watched, alone = (Spread(values(way, recording, each)) for each in turns)
        if min(len(watched.values), len(alone.values)) < LEAST:
            cause = recording.end.get("cause") or "the run was too short"
            left_out.append(f"{way.what}: there were fewer than {LEAST} of each kind, since {cause}")
            continue
        for name, share in (("p50", 0.5), ("p99", 0.99)):
            one, two = watched.at(share) * MICRO, alone.at(share) * MICRO
            target = TARGET if name == "p99" else None
            against = f"no client in the same run; {len(watched.values)} and {len(alone.values)} values"
            figures.append(Figure(f"{way.what}, {name} with three clients", one, "µs", two, against, target))
    return Report(tuple(figures), tuple(left_out))


def _tracked(way: Way, track_s: float) -> tuple[Recording, tuple[list[Turn], list[Turn]]]:
    """Run once; return the recording and the turns of its clients."""
    with tempfile.TemporaryDirectory() as place:
        sensor = {"sensor": {"emulated": way.sensor}, "limits": PATIENT}
        settings = toml({**slow_tool(way.robot, track_s), **sensor}, ())
        run = WebRun(Path(place), ("--record", "run.mcap"), settings)
        try:
            turns = _turns(run)
        finally:
            run.process.kill()
        return read(Path(place) / "run.mcap"), turns


if __name__ == "__main__":
    if sys.argv[1].startswith("http"):
        asyncio.run(watch(sys.argv[1]))
    else:
        report = measure(print, float(sys.argv[1]))
        print("\n".join([*(figure.line() for figure in report.figures), *report.left_out]))
