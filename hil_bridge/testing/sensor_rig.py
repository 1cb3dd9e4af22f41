"""Rig for an emulated force sensor in virtual time: its load and its clients."""

import math
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager
from typing import Any

from emulators.sensing import SteppedWrench
from hil_bridge.clock import Clock, run_virtual
from hil_bridge.devices.device_log import CallbackLog
from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.devices.wiring import Wiring
from hil_bridge.testing.cases import SensorCase
from hil_bridge.testing.naming import Finding
from hil_bridge.testing.rig import Rig, serving_in_memory
from protocol.geometry import Wrench
from protocol.wrench import SensorFacts, WrenchFrame, wrench_of

PATIENCE_S = 90.0
"""Longest wait for a call, s. Chosen: longer than any sensor takes to start, or its client to give up."""
MEAN_OF = 20
"""Number of frames that are averaged for a comparison. Chosen."""
NOTHING: Wrench = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class SensorRig(Rig):
    """Rig for an emulated sensor. `connect` creates any number of clients."""

    patience_s = PATIENCE_S

    def __init__(self, case: SensorCase, clock: Clock) -> None:
        super().__init__(clock, case.kind.emulation.faults if case.kind.emulation else {})
        self.case = case
        self.source = SteppedWrench(NOTHING)
        self.frames: list[WrenchFrame] = []
        """Frames reported by the clients, oldest first."""
        self.sensor: Any = None
        self.url = ""

    def push(self, wrench: Sequence[float]) -> None:
        """Apply a wrench to the sensor, N and N·m, sensor frame."""
        self.source.step(wrench, self.clock.now())

    async def connect(self) -> ForceSensor:
        """Return a client for the sensor, as a run uses it, that is not started yet."""
        log = CallbackLog(frame=self.frames.append)
        wiring = Wiring("sensor", self.clock, log, self.wrap)
        wire, client = await self.case.kind.connect(self.url, self.case.given, wiring)
        return ForceSensor(wire, client, self.clock, log)

    @asynccontextmanager
    async def started(self) -> AsyncIterator[ForceSensor]:
        """Provide a client that is ready, and close it on exit."""
        sensor = await self.connect()
        try:
            sensor.start()
            await self.within(sensor.ready(), "ready")
            yield sensor
        finally:
            await self.within(sensor.aclose(), "stop")

    # --- frames

    async def settled(self, sensor: ForceSensor) -> list[float]:
        """Return the mean wrench of the newest frames, N and N·m, once they have settled."""
        await self.wait(self.case.settle_s)
        period = sensor.facts.period or 0.02
        self.frames.clear()
        for _ in range(100):
            await self.wait(MEAN_OF * period)
            sensor.check()
            if len(self.frames) >= MEAN_OF:
                break
        else:
            raise Finding(f"{len(self.frames)} frames arrived within {100 * MEAN_OF * period:g} s")
        newest = self.frames[-MEAN_OF:]
        wrenches = [wrench_of(frame.values, sensor.facts.scales) for frame in newest]
        return [math.fsum(one[k] for one in wrenches) / MEAN_OF for k in range(6)]


def full_scales(case: SensorCase, facts: SensorFacts) -> Wrench:
    """Return the range of each axis, N and N·m: from the case, from the device, or else a typical range."""
    return case.full or facts.full_scales or facts.range or (200.0, 200.0, 200.0, 20.0, 20.0, 20.0)


@asynccontextmanager
async def sensor_rig(case: SensorCase, clock: Clock) -> AsyncIterator[SensorRig]:
    """Serve the emulated sensor of a case in memory."""
    given = case.given
    emulation = case.kind.emulation
    assert emulation is not None
    async with serving_in_memory(clock) as serving:
        rig = SensorRig(case, clock)
        rig.sensor = emulation.make(given)(rig.source, clock.now(), 1)
        for target, handlers in rig.sensor.handlers.items():
            rig.ledger.attach(target, handlers)
        rig.url = await emulation.serve(emulation.usual(given, True), rig.sensor, given, serving)
        rig.ledger.on_change.append(serving.wake)
        yield rig


def run_sensor(case: SensorCase, check: Callable[[SensorRig], Awaitable[None]]) -> None:
    """Run a check in virtual time, and fail if it leaves anything behind."""

    async def main() -> None:
        async with sensor_rig(case, Clock.running()) as rig:
            await check(rig)

    run_virtual(main)
