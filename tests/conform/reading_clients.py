"""Sensor clients in this process and in virtual time: ours, printing each frame as a line, with a mistake."""

import asyncio
from collections.abc import Callable
from typing import Any, NamedTuple

from hil_bridge.clock import Clock
from hil_bridge.devices.device_log import NullLog
from hil_bridge.devices.wiring import Wiring
from hil_bridge.errors import BridgeError
from hil_bridge.lab.conform.client import Where
from hil_bridge.runs.compose import connect_sensor
from hil_bridge.settings.configuration import load_config
from hil_bridge.settings.devices import sensor_at

POUND_FORCE_N = 4.4482216152605
EVERY_S = 0.02
"""Interval at which all clients print, s. Chosen."""


class Reader:
    """Client that prints the newest frame of our own sensor client every `EVERY_S`, as long as that client trusts
    it.
    """

    output = ""
    on_output: Callable[[bytes], object] | None = None

    def __init__(self, kind: str, mistake: str = "") -> None:
        self.kind, self.mistake = kind, mistake
        self._task: asyncio.Task[None] | None = None
        self._line = b""

    def start(self, where: Where) -> None:
        self._task = asyncio.get_running_loop().create_task(self._run(where.url))

    async def _run(self, url: str) -> None:
        clock = Clock.running()
        config = load_config(None, {"sensor.emulated": self.kind})
        sensor = await connect_sensor(sensor_at(config, url), Wiring("sensor", clock, NullLog()))
        try:
            sensor.start()
            await sensor.ready()
            zero = sensor.wrench(await sensor.frame()) if "zero" in self.mistake else (0.0,) * 6
            while True:
                await clock.sleep_until(clock.now() + EVERY_S)
                if self.mistake != "blind":
                    sensor.check()
                    if sensor.stands or sensor.saturated:
                        raise BridgeError("the sensor reports no values")
                frame = await sensor.frame()
                if self.mistake not in ("stale", "blind") and clock.now() - frame.at > 0.2:
                    raise BridgeError("the sensor is silent")
                now = self._spoil(sensor.wrench(frame))
                now = [a - b for a, b in zip(now, zero, strict=True)]
                self._publish(now)
        finally:
            await sensor.aclose()

    def _spoil(self, wrench: Any) -> list[float]:
        fx, fy, fz, mx, my, mz = wrench
        match self.mistake:
            case "pounds":
                return [part / POUND_FORCE_N for part in wrench]
            case "swapped":
                return [fy, fx, fz, mx, my, mz]
            case "sign":
                return [fx, fy, -fz, mx, my, mz]
            case "moments first":
                return [mx, my, mz, fx, fy, fz]
            case "newton millimetres":
                return [fx, fy, fz, mx * 1e3, my * 1e3, mz * 1e3]
            case "mean":
                return [(fx + fy) / 2.0] * 2 + [fz, mx, my, mz]
            case _:
                return list(wrench)

    def _publish(self, wrench: list[float]) -> None:
        assert self.on_output is not None
        self.on_output(b"reading\n" + " ".join(f"{part:.4f}" for part in wrench).encode() + b"\n")

    def poll(self) -> int | None:
        if self._task is None or not self._task.done():
            return None
        if self._task.cancelled():
            return -15
        return 1 if isinstance(self._task.exception(), BridgeError) else -6

    def ask_to_end(self) -> None:
        assert self._task is not None
        self._task.cancel()

    def kill(self) -> None:
        if self._task is not None:
            self._task.cancel()


class PlantedReading(NamedTuple):
    """Mistake of a sensor client, and how it is detected."""

    kind: str
    mistake: str
    words: str
    scenario: str
    reason: str
    declares_zero: bool = False


PLANTED_READINGS = (
    PlantedReading(
        "netft", "pounds", "pounds of force are reported as newtons", "nominal", "were reported as fx +2.25"
    ),
    PlantedReading("ft300", "swapped", "two axes are exchanged", "nominal", "on fx were reported as fy +"),
    PlantedReading("ati-can", "sign", "fz has the wrong sign", "nominal", "on fz were reported as fz -"),
    PlantedReading(
        "jr3", "moments first", "moments come before forces", "nominal", "on fx were reported as mx +"
    ),
    PlantedReading(
        "jr3-uart",
        "newton millimetres",
        "moments are reported in N·mm",
        "nominal",
        "is neither the load nor zero",
    ),
    PlantedReading("netft", "mean", "two axes have their mean", "nominal", "on fx were reported as"),
    PlantedReading(
        "netft",
        "",
        "its reading without load is not zero, as declared",
        "nominal",
        "is not zero, as declared",
        True,
    ),
    PlantedReading(
        "netft",
        "stale",
        "the last value is still reported while no frames arrive",
        "cut",
        "while the link was cut",
    ),
    PlantedReading("netft", "blind", "it ignores the status", "status", "reported them as invalid"),
    PlantedReading("jr3", "blind", "it ignores the counter", "status", "reported them as invalid"),
)
