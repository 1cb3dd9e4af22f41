"""Test of the CAN log of a recorded run, played by can-utils on a vcan interface into the bridge."""

import asyncio
import signal
import sys
from collections.abc import Callable
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import pytest

from hil_bridge.clock import Clock, run_real
from hil_bridge.record import read_with_traffic
from hil_bridge.record.export import export
from hil_bridge.record.export.traffic import WireFrame, can_frames
from hil_bridge.runs.outputs import Outputs
from hil_bridge.runs.session import execute
from hil_bridge.settings.configuration import read_config
from hil_bridge.transports import connect_can
from protocol.can.frame import CanFrame

pytestmark = pytest.mark.vcan

MONITOR = (sys.executable, "-c", "from hil_bridge.cli import main; main()", "monitor")
PATIENCE = 100.0
"""Maximum wait for any event on an emulated computer, s."""
CALL = CanFrame(0x1FFFFFFF, extended=True)
"""Identifier of no device; shows when the monitor listens."""
PLAYED = 1000
"""Number of frames of the log, start-up and stream, so that playing takes only seconds."""
LATE_S = 0.5
"""Maximum delay of the first or last frame on a busy machine, s."""


def test_played_log_reaches_bridge_frame_by_frame(
    vcan: Any, command: Callable[[str], str], tmp_path: Path
) -> None:
    record = tmp_path / "run.mcap"
    near = {"jr3": {"gateway": {"boot_s": 0.5}}, "start_position_mm": (900.0, -100.0, 592.0)}
    short = {"run": {"duration_s": 0.5}, "task": {"retract_mm": 1.0}}
    config = read_config({**short, "cell": near})
    assert execute(config, True, Outputs(record=record), view=False) == 0
    export(record, ("candump",), tmp_path)
    lines = (tmp_path / "run.log").read_text().splitlines(keepends=True)
    (tmp_path / "played.log").write_text("".join(lines[:PLAYED]))
    recorded = can_frames(read_with_traffic(record)[1].sensor)
    assert len(lines) == len(recorded) > PLAYED
    recorded = recorded[:PLAYED]
    received, displayed = run_real(lambda: play_log(vcan, command("canplayer"), tmp_path))

    assert [frame for _, frame in received] == [one.frame for one in recorded]
    assert len(displayed) == len(recorded)
    took, lasted = received[-1][0] - received[0][0], span(recorded)
    assert abs(took - lasted) <= LATE_S
    print(f"{len(received)} frames played in {took:.2f} s, recorded in {lasted:.2f} s")


def span(frames: list[WireFrame]) -> float:
    return frames[-1].at - frames[0].at


async def play_log(vcan: Any, canplayer: str, folder: Path) -> tuple[list[tuple[float, CanFrame]], list[str]]:
    """Return the frames that a wire of the bridge and `hil-bridge monitor` receive of `played.log`: frames with times,
    and rows.
    """
    received: list[tuple[float, CanFrame]] = []
    async with AsyncExitStack() as stack:
        clock = Clock.running()
        stack.callback(clock.close)
        wire = await connect_can(vcan.url, clock)
        stack.push_async_callback(wire.aclose)
        wire.start(lambda frames: received.extend((one.received_at or 0.0, one) for one in frames), print)
        output = stack.enter_context((folder / "monitor.txt").open("wb"))
        monitor = await asyncio.create_subprocess_exec(*MONITOR, f"jr3+{vcan.url}", stdout=output)
        stack.push_async_callback(monitor.wait)

        def end_monitor() -> None:
            if monitor.returncode is None:
                monitor.kill()

        stack.callback(end_monitor)

        def rows() -> list[str]:
            text = (folder / "monitor.txt").read_text()
            return [line for line in text.splitlines() if str(CALL) not in line]

        async def until(happened: Callable[[], bool], pause_s: float) -> None:
            async with asyncio.timeout(PATIENCE):
                while not happened():
                    await clock.sleep_until(clock.now() + pause_s)

        def listens() -> bool:
            wire.send([CALL])
            return (folder / "monitor.txt").stat().st_size > 0

        await until(listens, 0.1)
        player = await asyncio.create_subprocess_exec(
            canplayer, "-I", str(folder / "played.log"), f"{vcan.name}=can0"
        )
        async with asyncio.timeout(PATIENCE):
            assert await player.wait() == 0
        await until(lambda: len(received) >= PLAYED and len(rows()) >= PLAYED, 0.2)
        monitor.send_signal(signal.SIGINT)
        async with asyncio.timeout(PATIENCE):
            assert await monitor.wait() == 0
        return received, rows()
