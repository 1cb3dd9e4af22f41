"""Harmless part of the suites, for a real device or a device emulated by another process: no orders are sent."""

import asyncio
import itertools
import math
from collections.abc import Sequence

import pytest

from hil_bridge.clock import Clock, run_real
from hil_bridge.devices.device_log import CallbackLog, NullLog
from hil_bridge.devices.kinds import DeviceKind
from hil_bridge.devices.robots.seam import RobotLink
from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.devices.wiring import Wiring
from hil_bridge.testing.cases import RobotCase, SensorCase
from hil_bridge.testing.naming import Finding
from protocol.geometry import angle_between
from protocol.wrench import AXES, WrenchFrame

WATCHED_S = 2.0
"""Time for which reports or frames are read, s. Chosen."""
PATIENCE_S = 30.0
"""Longest wait for the first report or frame, s. Chosen."""
STANDING_M = 1e-3
"""Reported motion below which a robot counts as stationary, m. Chosen."""
RATE_PART = 0.2
"""Relative tolerance of the rate that the device reports. Chosen."""


def _wire(kind: DeviceKind, urls: Sequence[str]) -> str:
    """Return the link URL for this device kind. Skips the test if there is none."""
    for url in urls:
        if url.startswith(f"{kind.name}+"):
            return url.removeprefix(f"{kind.name}+")
    pytest.skip(f"no real device; specify one with --hil-live {kind.name}+URL")


def check_live_robot(case: RobotCase, urls: Sequence[str]) -> None:
    """Check that reports arrive at the robot's rate, are finite and numbered, and show a stationary robot."""
    url = _wire(case.kind, urls)

    async def main() -> None:
        clock = Clock.running()
        wiring = Wiring("robot", clock, NullLog())
        link: RobotLink = await case.kind.connect(url, case.given, wiring)
        try:
            link.start()
            async with asyncio.timeout(PATIENCE_S):
                reports = [await link.report()]
            ends = clock.now() + WATCHED_S
            while clock.now() < ends:
                reports.append(await link.report())
        finally:
            await link.aclose()
            clock.close()
        first, last = reports[0], reports[-1]
        if any(b.sequence <= a.sequence for a, b in itertools.pairwise(reports)):
            raise Finding("the sequence number of a report does not increase")
        for report in reports:
            if not all(map(math.isfinite, (*report.pose.position, *report.pose.quaternion))):
                raise Finding(f"a report contains the invalid pose {report.pose}")
        distance = math.dist(first.pose.position, last.pose.position)
        turned = angle_between(first.pose.quaternion, last.pose.quaternion)
        if distance > STANDING_M or turned > 0.01:
            raise Finding(f"without orders, the robot moved by {distance * 1e3:.1f} mm")
        cycle = link.facts.cycle_s
        if cycle:
            period = (last.received_at - first.received_at) / (last.sequence - first.sequence)
            _check_rate("the robot's packets", period, cycle)

    run_real(main)


def check_live_sensor(case: SensorCase, urls: Sequence[str]) -> None:
    """Check that frames arrive at the reported rate, are finite, and are about 0 after zeroing."""
    url = _wire(case.kind, urls)

    async def main() -> None:
        clock = Clock.running()
        frames: list[WrenchFrame] = []
        wiring = Wiring("sensor", clock, NullLog())
        wire, client = await case.kind.connect(url, case.given, wiring)
        sensor = ForceSensor(wire, client, clock, CallbackLog(frame=frames.append))
        try:
            sensor.start()
            async with asyncio.timeout(PATIENCE_S):
                facts = await sensor.ready()
                await sensor.frame()
            frames.clear()
            await asyncio.sleep(WATCHED_S)
            sensor.check()
            received = list(frames)
            async with asyncio.timeout(PATIENCE_S):
                await sensor.tare()
            frames.clear()
            await asyncio.sleep(WATCHED_S / 4.0)
            zeroed = list(frames)
        finally:
            await sensor.aclose()
            clock.close()
        if len(received) < 2 or not zeroed:
            raise Finding(
                f"{len(received)} frames arrived within {WATCHED_S:g} s, {len(zeroed)} after the zero"
            )
        if any(b.sequence <= a.sequence for a, b in itertools.pairwise(received)):
            raise Finding("the sequence number of a frame does not increase")
        if facts.period is not None:
            _check_rate("frames", (received[-1].at - received[0].at) / (len(received) - 1), facts.period)
        mean = [
            math.fsum(frame.values[k] for frame in zeroed) / len(zeroed) * facts.scales[k] for k in range(6)
        ]
        for axis, value in enumerate(mean):
            full = (facts.full_scales or facts.range or (math.inf,) * 6)[axis]
            if not abs(value) <= 4.0 * case.noise * full:
                raise Finding(f"after a zero {AXES[axis]} is {value:.3g} on an unloaded sensor")

    run_real(main)


def _check_rate(what: str, period: float, expected: float) -> None:
    if abs(period - expected) > RATE_PART * expected:
        raise Finding(
            f"{what} arrive every {period * 1e3:.2f} ms, but the client reports {expected * 1e3:.2f} ms"
        )
