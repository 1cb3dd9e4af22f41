"""Files that other code closes during a run: each is noticed and reported, and the tool's state too."""

import asyncio
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hil_bridge.clock import Clock, run_real
from hil_bridge.clock.polling import CHECK_S, BusyPolling, WatchfulSelector
from hil_bridge.errors import TransportError
from hil_bridge.record import read
from hil_bridge.transports.opening import connect_bytes, connect_datagrams, listen_bytes, listen_datagrams

pytestmark = pytest.mark.live

NOTICED_S = 20 * CHECK_S
"""A closed file is noticed within this time, also on a busy machine."""


def opened_since(before: set[int]) -> list[int]:
    return sorted(files() - before)


def files() -> set[int]:
    """Numbers of the files that this process has open."""
    return {int(name) for name in os.listdir("/proc/self/fd") if Path(f"/proc/self/fd/{name}").exists()}


def kind_of(fd: int) -> str:
    return os.readlink(f"/proc/self/fd/{fd}")


async def tcp(clock: Clock) -> tuple[Any, Any, int]:
    served = await listen_bytes("tcp-listen://127.0.0.1:0", clock)
    before = files()
    wire = await connect_bytes(served.address, clock)
    return served.transport, wire, opened_since(before)[0]


async def terminal(clock: Clock) -> tuple[Any, Any, int]:
    served = await listen_bytes("pty:", clock)
    before = files()
    wire = await connect_bytes(served.address, clock)
    return served.transport, wire, next(fd for fd in opened_since(before) if kind_of(fd).startswith("/dev/"))


async def udp(clock: Clock) -> tuple[Any, Any, int]:
    served = await listen_datagrams("udp-bind://127.0.0.1:0", clock)
    before = files()
    wire = await connect_datagrams(served.address, clock)
    return served.transport, wire, opened_since(before)[0]


@pytest.mark.parametrize("open_wire", [tcp, terminal, udp])
def test_closed_wire_file_ends_with_message(open_wire: Callable[[Clock], Any]) -> None:
    async def main() -> TransportError:
        clock = Clock.running()
        served, wire, fd = await open_wire(clock)
        ended: asyncio.Future[TransportError] = clock.loop.create_future()
        served.start(lambda data: None, lambda error: None)
        wire.start(lambda data: None, ended.set_result)
        await asyncio.sleep(0.01)
        os.close(fd)
        async with asyncio.timeout(NOTICED_S):
            error = await ended
        with pytest.raises(TransportError):
            wire.send([b"x"] if open_wire is udp else b"x")
        await wire.aclose()
        await served.aclose()
        clock.close()
        return error

    assert CLOSED in str(run_real(main))


@pytest.mark.parametrize("kind", ["anon_inode:[timerfd]", "anon_inode:[eventpoll]"])
def test_loop_continues_with_closed_own_file(kind: str) -> None:
    before = files()

    async def main() -> float:
        clock = Clock.running()
        mine = [fd for fd in opened_since(before) if kind_of(fd) == kind]
        began = clock.now()
        closing = clock.call_at(began + 0.05, lambda: os.close(mine[0]))
        for k in range(1, 6):
            await clock.sleep_until(began + 0.02 * k)
        took = clock.now() - began
        closing.cancel()
        clock.close()
        return took

    assert 0.1 <= run_real(main) < NOTICED_S


def test_selector_reports_closed_file_as_ready() -> None:
    for selector in (WatchfulSelector(), BusyPolling(1e-4)):
        there, here = os.pipe()
        key = selector.register(there, 1)
        os.close(there)
        until = time.monotonic() + NOTICED_S
        ready: list[Any] = []
        while not ready and time.monotonic() < until:
            ready = selector.select(CHECK_S)
        assert ready == [(key, 1)]
        selector.unregister(there)
        assert selector.select(0.0) == []
        selector.close()
        os.close(here)


CLOSES = """
import os
import hil_bridge.runs.cycle as run
record_cycle = run.cycle_record
def closing(report, sample, decision, *more, **known):
    if decision.intent.phase == 'track' and sample.force > 8.0:
        for name in os.listdir('/proc/self/fd'):
            try:
                if int(name) > 2 and {which}:
                    os.close(int(name))
            except OSError:
                pass
    return record_cycle(report, sample, decision, *more, **known)
run.cycle_record = closing
from hil_bridge.cli import main
main()
"""
CONFIG = """
[task]
retract_mm = 3.0
[limits]
cycle_deadline_ms = 5000.0
stale_after_ms = 1500.0
retract_patience_s = 2.0
[cell]
start_position_mm = [900.0, -100.0, 592.0]
jr3.gateway.boot_s = 0.2
"""
RUN = ("--no-view", "--duration", "1.5", "--record", "run.mcap")
NAMED = "os.readlink('/proc/self/fd/' + name)"
CLOSED = "broke: other code of this process has closed its file"
CASES = {
    "robot": (f"{NAMED} == '{{robot}}'", 3, "left: NOT retracted: left at ", CLOSED),
    "sensor": (f"{NAMED} == '{{sensor}}'", 3, "left: NOT retracted: left at ", CLOSED),
    "timers": (f"{NAMED} == 'anon_inode:[timerfd]'", 0, "left: retracted, ", ""),
    "loop": (f"{NAMED} == 'anon_inode:[eventpoll]'", 0, "left: retracted, ", ""),
    "all": ("True", 3, "left: NOT retracted: left at ", CLOSED),
}


@pytest.mark.timeout(300)
@pytest.mark.parametrize("name", CASES)
def test_run_with_closed_files_ends_with_message(tmp_path: Path, name: str) -> None:
    which, code, last, cause = CASES[name]
    (tmp_path / "c.toml").write_text(CONFIG)
    serving = [sys.executable, "-m", "hil_bridge", "emulate", "cell", "c.toml", "--json"]
    cell = subprocess.Popen(serving, cwd=tmp_path, stdout=subprocess.PIPE, text=True)
    try:
        assert cell.stdout is not None
        where = json.loads(cell.stdout.readline())
        devices = {
            device: where[device].rpartition("://")[2].partition("?")[0] for device in ("robot", "sensor")
        }
        program = CLOSES.format(which=which.format(**devices))
        options = [
            text for device, value in where.items() for text in (f"--{device}", value) if device != "panel"
        ]
        run = subprocess.run(
            [sys.executable, "-c", program, "run", "c.toml", *options, *RUN],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
    finally:
        cell.kill()
        cell.communicate()
    text = run.stderr + run.stdout
    assert run.returncode == code, text
    assert text.splitlines()[-1].startswith(last), text
    assert cause in text
    assert "Traceback" not in text
    if name != "all":  # there the record's own file is closed too
        assert read(tmp_path / "run.mcap").end
