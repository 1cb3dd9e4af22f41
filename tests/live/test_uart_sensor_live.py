"""Test of a sensor behind its UART gateway on a pseudo-terminal, in real time."""

import asyncio
import itertools

import pytest

from hil_bridge.clock import Clock, run_real
from hil_bridge.devices.device_log import CallbackLog
from hil_bridge.devices.wiring import Wiring
from hil_bridge.runs.compose import connect_sensor, emulated_cell
from hil_bridge.runs.setup import Listen, Setup
from hil_bridge.settings.configuration import read_config
from protocol.wrench import WrenchFrame

pytestmark = pytest.mark.live

QUICK = {
    "cell": {"jr3": {"uart": {"boot_s": 0.2, "deaf_s": 0.2}}},
    "sensor": {"jr3": {"uart": {"pause_s": 0.3, "ack_timeout_s": 0.5, "period_ms": 4.0}}},
}
"""Settings that make the same session shorter."""


def test_sensor_on_pseudo_terminal() -> None:
    config = read_config(QUICK)
    frames: list[WrenchFrame] = []

    def failed(cause: BaseException) -> None:
        raise cause

    async def main() -> None:
        clock = Clock.running()
        try:
            async with emulated_cell(Setup(config, Listen(None, "jr3-uart+pty:")), clock, failed) as ports:
                assert ports.sensor is not None
                url = ports.sensor.named_url
                assert url.startswith("jr3-uart+serial:///dev/pts/")
                assert url.endswith("?baudrate=115200&parity=N&stopbits=1")
                sensor = await connect_sensor(
                    ports.sensor, Wiring("sensor", clock, CallbackLog(frames.append))
                )
                sensor.start()
                async with asyncio.timeout(30.0):
                    assert (await sensor.ready()).full_scales == (115.0, 111.0, 185.0, 5.6, 5.2, 6.1)
                    await sensor.tare()
                    await clock.sleep_until(clock.now() + 0.5)
                await sensor.aclose()
        finally:
            clock.close()

    run_real(main)
    assert len(frames) > 50
    # The emulator leaves out nothing, and a pseudo-terminal loses nothing.
    assert {later.sequence - earlier.sequence for earlier, later in itertools.pairwise(frames)} == {31, 32}
    assert max(map(abs, frames[-1].values)) <= 4
