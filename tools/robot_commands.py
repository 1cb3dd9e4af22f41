"""Write a table of docs/reference/commands.md: which commands work with which emulated robot.

With --measure each command is run first, and its end goes to docs/reference/robot-commands.json;
it takes some minutes.

    python -m tools.robot_commands --client URL

moves a robot down by some millimetres through our own link: the client that `conform` judges here.
"""

import argparse
import itertools
import json
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import NamedTuple

from hil_bridge.clock import Clock, run_real
from hil_bridge.devices.device_log import Silence
from hil_bridge.devices.kinds import ROBOTS, default_settings, robot_of
from hil_bridge.devices.robots.seam import MotionLimits, RobotLink
from hil_bridge.devices.wiring import Wiring
from protocol.geometry import Pose
from tools.pages import placed, table

PROGRAM = (sys.executable, "-m", "hil_bridge")
PATIENCE_S = 120.0
"""Longest time that a command may take."""
SPEED_M_S, STEP_M, PAUSE_S, STEPS = 0.02, 1e-4, 0.02, 400
"""The client goes 40 mm down, and waits for a report behind each step."""
TRIES = 3
"""A busy computer ends a stream: a command has so many tries in real time, and their number is told."""


class End(NamedTuple):
    """The end of a command."""

    code: int
    error: str
    """Last line of standard error."""


def run(*arguments: str) -> End:
    """A command of hil-bridge, to its end."""
    done = subprocess.run(
        [*PROGRAM, *arguments], capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    return End(done.returncode, (done.stderr.strip().splitlines() or [""])[-1])


@contextmanager
def emulated(*arguments: str) -> Iterator[Mapping[str, str]]:
    """URLs of devices that another process emulates meanwhile, by their names."""
    command = [*PROGRAM, "emulate", *arguments, "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        try:
            yield json.loads(process.stdout.readline())
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(PATIENCE_S)


def identify(kind: str) -> End:
    """The tool of an emulated cell, in virtual time."""
    return run("identify", "tool", "--virtual", "--robot", kind)


def free(kind: str) -> End:
    """Lift the tool of an emulated cell of another process."""
    with emulated("cell", "--robot", kind, "--sensor", "netft") as at:
        return run("free", "--robot", at["robot"], "--sensor", at["sensor"])


def probe(kind: str) -> End:
    """Ask an emulated robot."""
    with emulated("robot", "--robot", kind) as at:
        return run("probe", "robot", at["robot"])


def panel(kind: str) -> End:
    """Press the emergency stop."""
    with emulated("robot", "--robot", kind, "--panel", "tcp-listen://127.0.0.1:0") as at:
        return run("panel", at["panel"], "emergency-stop")


def conform(kind: str) -> End:
    """Judge our own link in the scenario without a fault."""
    client = (sys.executable, "-m", "tools.robot_commands", "--client", "{url}")
    return run("conform", kind, "--only", "nominal", "--", *client)


COMMANDS = {
    "identify tool": identify,
    "free": free,
    "probe": probe,
    "panel": panel,
    "conform": conform,
}
"""How each is tried."""


async def go_down(url: str) -> None:
    """Move the tool of a robot down by our own link."""
    kind, wire = robot_of(url)
    clock = Clock.running()
    link: RobotLink = await kind.connect(wire, default_settings(kind), Wiring("robot", clock, Silence()))
    try:
        link.start()
        (x, y, z), quaternion = (await link.ready()).pose
        async with link.motion(MotionLimits(SPEED_M_S)) as motion:
            for number in range(1, STEPS + 1):
                await motion.to(Pose((x, y, z - number * STEP_M), quaternion))
                await clock.sleep_until(clock.now() + PAUSE_S)
                await link.report()
    finally:
        await link.aclose()
        clock.close()


def measure(names: Sequence[str], before: object) -> list[dict[str, object]]:
    """All commands with all robots, one after the other."""
    rows = []
    for kind, (name, command) in itertools.product(ROBOTS.own, COMMANDS.items()):
        attempts, end = 1, command(kind)
        while end.code and attempts < TRIES:
            attempts, end = attempts + 1, command(kind)
        print(kind, name, attempts, *end, flush=True)
        rows.append({"robot": kind, "command": name, "attempts": attempts, **end._asdict()})
    return rows


def renewed(document: str, rows: Sequence[Mapping[str, object]]) -> str:
    """The document with the table of these ends."""
    ends = {(row["robot"], row["command"]): row for row in rows}
    lines = [
        (f"`{kind}`", *(_cell(ends[kind, name]) for name in COMMANDS))
        for kind in dict.fromkeys(row["robot"] for row in rows)
    ]
    heads = [f"`{name}`" for name in COMMANDS]
    return placed(document, {"robot-commands": table(("robot", *heads), lines)})


def _cell(row: Mapping[str, object]) -> str:
    if row["code"]:
        return f"exit code {row['code']}: {row['error']}"
    return "works" if row["attempts"] == 1 else f"works, at attempt {row['attempts']}"


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--client", metavar="URL", required=True, help="be the client that conform judges")
    run_real(go_down(options.parse_args().client))
