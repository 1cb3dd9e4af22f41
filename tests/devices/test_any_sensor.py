"""Force sensor of the bridge with a plug-in client: SI values, no full scales, zero on the host."""

import math
import struct
from collections import deque
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field

import pytest

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.control import Peaks
from hil_bridge.devices.device_log import NullLog
from hil_bridge.devices.sensors.axis_watch import DEAD_AFTER_S
from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.errors import DeviceError
from hil_bridge.runs.zeroing import wrist
from hil_bridge.settings.configuration import Config
from hil_bridge.transports import connect_bytes, listen_bytes
from protocol.wrench import (
    HostTare,
    SensorEvent,
    SensorFacts,
    SensorReady,
    SensorStatistics,
    SensorStopped,
    WrenchFrame,
    Zeroed,
)

SAMPLE = struct.Struct("<6dB")
"""Six values in N and N·m, and a status byte with a bit for every saturated axis."""
FACTS = SensorFacts("plain 6, number 1", (1.0,) * 6, None, None, 0.001, 0.0, "host")


class PlainClient:
    """Endpoint of a sensor that streams from the start and accepts no orders."""

    stop_patience = 0.0

    def __init__(self) -> None:
        self.statistics = SensorStatistics()
        self._tare = HostTare(samples=3)
        self._samples = 0
        self._events: deque[SensorEvent] = deque([SensorReady(FACTS)])
        self.zero = self._tare.zero

    def receive(self, data: bytes, now: float) -> None:
        for *raw, status in SAMPLE.iter_unpack(data):
            self._samples += 1
            number = self._samples
            self._events.append(WrenchFrame(self._tare.values(raw), number, number, now, status))
            if self._tare.took:
                self._events.append(Zeroed())

    def stop(self) -> None:
        self._events.append(SensorStopped())

    def next_event(self) -> SensorEvent | None:
        return self._events.popleft() if self._events else None

    def data_to_send(self, now: float) -> bytes:
        return b""

    def next_deadline(self) -> float | None:
        return None

    def handle_deadline(self, now: float) -> None:
        raise AssertionError("it sets no deadline")


@dataclass
class Frames(NullLog):
    """Log that stores all frames and notices."""

    frames: list[WrenchFrame] = field(default_factory=list)
    notices: list[str] = field(default_factory=list)

    def frame(self, frame: WrenchFrame) -> None:
        self.frames.append(frame)

    def notice(self, kind: str, text: str) -> None:
        self.notices.append(text)


SendSample = Callable[..., Awaitable[None]]


def with_sensor(script: Callable[[ForceSensor, SendSample, Clock], Awaitable[None]]) -> Frames:
    """Run a script with a sensor whose samples it sets: six values and a status each."""
    log = Frames()

    async def main() -> None:
        clock = Clock.running()
        device = (await listen_bytes("memory:plain", clock)).transport
        device.start(lambda data: None, lambda cause: None)
        sensor = ForceSensor(await connect_bytes("memory:plain", clock), PlainClient(), clock, log)
        sensor.start()

        async def send_sample(*values: float, status: int = 0) -> None:
            device.send(SAMPLE.pack(*values, status))
            await clock.sleep_until(clock.now() + 0.001)

        try:
            await script(sensor, send_sample, clock)
        finally:
            await sensor.aclose()
            await device.aclose()

    run_virtual(main)
    return log


def test_sensor_si_values_are_used_as_wrench() -> None:
    async def script(sensor: ForceSensor, send_sample: SendSample, clock: Clock) -> None:
        assert not sensor.is_ready or sensor.facts == FACTS
        assert await sensor.ready() == FACTS
        await send_sample(1.5, -2.25, 3.0, 0.5, -0.25, 0.125)
        assert sensor.newest is not None
        assert sensor.wrench(sensor.newest) == (1.5, -2.25, 3.0, 0.5, -0.25, 0.125)
        assert (sensor.saturated, sensor.dead) == ((), ())

    assert [frame.values for frame in with_sensor(script).frames] == [(1.5, -2.25, 3.0, 0.5, -0.25, 0.125)]


def test_sensor_saturation_bits_reach_guard() -> None:
    """A saturation between two decisions counts, even if the axis has recovered."""

    async def script(sensor: ForceSensor, send_sample: SendSample, clock: Clock) -> None:
        await sensor.ready()
        down, sideways = (0.0, 0.0, -1.0), (1.0, 0.0, 0.0)
        turned = wrist(Config()).at_orientation((1.0, 0.0, 0.0, 0.0), None, down, sideways)
        sensor.peaks = Peaks(turned, sensor.facts.scales)
        await send_sample(0.0, 0.0, 400.0, 0.0, 0.0, 0.0, status=0b000100)
        assert sensor.saturated == ("fz",)
        await send_sample(0.0, 0.0, 1.0, 0.0, 0.0, 0.0, status=0b100001)
        assert sensor.saturated == ("fx", "mz")
        await send_sample(0.0, 0.0, 0.5, 0.0, 0.0, 0.0)
        assert sensor.saturated == ()
        assert sensor.peaks.take() == (400.0, 400.0, 0.0, True)
        assert sensor.peaks.take()[3] is False

    with_sensor(script)


def test_sensor_counts_identical_frames_from_first_one() -> None:
    async def script(sensor: ForceSensor, send_sample: SendSample, clock: Clock) -> None:
        await sensor.ready()
        began = 0.0
        for fz, repeated in ((1.0, 0), (1.0, 1), (1.0, 2), (2.0, 0), (1.0, 0), (1.0, 1)):
            await send_sample(0.0, 0.0, fz, 0.0, 0.0, 0.0)
            assert sensor.newest is not None
            began = sensor.newest.at if repeated == 0 else began
            assert (sensor.repeated, sensor.unchanged_since) == (repeated, began)

    with_sensor(script)


def test_sensor_host_zero_discards_earlier_frames() -> None:
    async def script(sensor: ForceSensor, send_sample: SendSample, clock: Clock) -> None:
        await sensor.ready()
        await send_sample(5.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        tare = clock.loop.create_task(sensor.tare())
        await clock.sleep_until(clock.now() + 0.001)
        for force in (5.0, 6.0, 7.0):
            await send_sample(force, 0.0, 0.0, 0.0, 0.0, 0.0)
        await tare
        assert sensor.newest is None
        assert sensor.zeroed_from is not None
        assert sensor.zeroed_from.values[0] == 7.0
        await send_sample(8.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        assert sensor.window(0.0) == [(2.0, 0.0, 0.0, 0.0, 0.0, 0.0)]

    with_sensor(script)


def test_sensor_dead_axis_is_detected_without_full_scales() -> None:
    async def script(sensor: ForceSensor, send_sample: SendSample, clock: Clock) -> None:
        await sensor.ready()
        for k in range(round(DEAD_AFTER_S / 0.001) + 2):
            await send_sample(
                0.03 * k, 0.01 * (k % 2), 0.0, 0.001 * (k % 3), 0.001 * (k % 2), 0.001 * (k % 5)
            )
        assert sensor.dead == (2,)

    with_sensor(script)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_sensor_nan_value_ends_stream(value: float) -> None:
    """NaN would satisfy every limit of the guard."""

    async def script(sensor: ForceSensor, send_sample: SendSample, clock: Clock) -> None:
        await sensor.ready()
        await send_sample(0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
        await send_sample(0.0, 0.0, value, 0.0, 0.0, 0.0)
        with pytest.raises(DeviceError, match="reported a value that is not a number"):
            sensor.check()

    log = with_sensor(script)
    assert len(log.frames) == 1
    assert len(log.notices) == 1
