"""Package of toys that fail on purpose: `FAILS` selects the part, the failure and the first failing call."""

import asyncio
import dataclasses
import inspect
import math
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any, ClassVar

from toy_robot.emulator import Arm
from toy_robot.room import FACTS
from toy_robot.room import ROBOT as ARM
from toy_robot.wire import ArmClient
from toy_sensor.emulator import LoadCell
from toy_sensor.room import SENSOR as LOAD
from toy_sensor.wire import LoadClient
from toy_surface.surface import SURFACE as SPRING
from toy_surface.surface import Spring

from hil_bridge import Command, Measurement
from hil_bridge.devices.robots.streamed import StreamedLink
from hil_bridge.devices.robots.streamed_motion import StreamedMotion

FAILS: dict[str, Any] = {"part": "", "how": "", "after": 0}


class PluginExit(BaseException):
    """BaseException that `except Exception` does not catch."""


RAISES: dict[str, BaseException] = {
    "raise": ValueError("it is broken\nin two lines"),
    "exit": SystemExit(0),
    "keyboard": KeyboardInterrupt(),
    "own": PluginExit("unrecoverable"),
    "generator": GeneratorExit(),
    "cancelled": asyncio.CancelledError(),
    "group": BaseExceptionGroup("two at once", [KeyboardInterrupt(), KeyError("other")]),
}
ANSWERS: dict[str, Any] = {"nothing": None, "nan": math.nan, "past": 0.0}
"""Invalid return values that replace the valid one."""
calls: dict[str, int] = {}


def failure_of(part: str) -> str:
    """Return the failure of a part, empty for none, or raise the selected exception."""
    calls[part] = calls.get(part, 0) + 1
    if part != FAILS["part"] or calls[part] < FAILS["after"]:
        return ""
    if FAILS["how"] in RAISES:
        raise RAISES[FAILS["how"]]
    if FAILS["how"] == "callback":
        asyncio.get_running_loop().call_soon(raise_in_loop)
        return ""
    if FAILS["how"] == "cancels":
        asyncio.tasks.current_task().cancel()  # type: ignore[union-attr]
        return ""
    return str(FAILS["how"])


def raise_in_loop() -> None:
    """Raise an exception that leaves the event loop."""
    FAILS["how"] = ""
    raise SystemExit(1)


@dataclass(frozen=True)
class Law:
    name: ClassVar[str] = "failing"

    def initial(self) -> None:
        return None

    def step(self, state: None, measurement: Measurement, reference: float) -> Any:
        move = 1e-4 * (reference - measurement.force)
        answers = {
            "": (None, Command(measurement.commanded + move, move)),
            "nothing": None,
            "nan": (None, Command(math.nan, 0.0)),
        }
        return answers[failure_of("law")]


class FailingArmClient(ArmClient):
    def receive(self, data: Any, now: float) -> None:
        failure_of("arm-client")
        super().receive(data, now)


class FailingLink(StreamedLink[Any]):
    async def report(self, *, soon: bool = False) -> Any:
        failure_of("link")
        return await super().report(soon=soon)

    async def aclose(self) -> None:
        await super().aclose()
        failure_of("link-close")


class FailingArm(Arm):
    def handle_deadline(self, now: float) -> None:
        failure_of("arm")
        super().handle_deadline(now)


class FailingLoadClient(LoadClient):
    def receive(self, data: Any, now: float) -> None:
        failure_of("load-client")
        super().receive(data, now)


class FailingLoad(LoadCell):
    def handle_deadline(self, now: float) -> None:
        failure_of("load")
        super().handle_deadline(now)


class FailingSpring(Spring):
    def force(self, positions: Any, velocities: Any, times: Any) -> Any:
        force = super().force(positions, velocities, times)
        answers = {"": force, "nothing": None, "nan": math.nan * force, "shape": force[:, :2]}
        return answers[failure_of("spring")]


def weave(kind: Any, part: str) -> None:
    """Make each method and property of a class fail as the part `part.method`."""
    for name in dir(kind):
        attribute, key = inspect.getattr_static(kind, name), f"{part}.{name}"
        if name.startswith("_") and name != "__init__":
            continue
        if isinstance(attribute, property):
            setattr(kind, name, property(may_fail(attribute.fget, key), attribute.fset))
        elif inspect.isfunction(attribute):
            setattr(kind, name, may_fail(attribute, key))


def may_fail(function: Any, key: str) -> Any:
    """Return a function that may fail."""

    def call(*values: Any, **options: Any) -> Any:
        failure = failure_of(key)
        return function(*values, **options) if not failure else ANSWERS[failure]

    async def wait(*values: Any, **options: Any) -> Any:
        failure = failure_of(key)
        return await function(*values, **options) if not failure else ANSWERS[failure]

    return wait if inspect.iscoroutinefunction(function) else call


class FailingMotion(StreamedMotion[Any]):
    """Movement of the failing link."""


weave(Law, "Law")
weave(FailingArmClient, "ArmClient")
weave(FailingArm, "Arm")
weave(FailingLoadClient, "LoadClient")
weave(FailingLink, "Link")
weave(FailingMotion, "Motion")


class MovingLink(FailingLink):
    """Failing link with a failing movement."""

    @asynccontextmanager
    async def motion(self, limits: Any) -> Any:
        async with super().motion(limits) as motion:
            failure_of("Link.enter")
            motion.__class__ = FailingMotion
            yield motion
        failure_of("Link.leave")


async def connect_arm(url: str, settings: Any, wiring: Any) -> Any:
    if failure_of("connect"):
        return None
    wire = await wiring.datagrams(url)
    return MovingLink(wire, FailingArmClient(wiring.clock.now()), FACTS, wiring.clock, wiring.log)


async def connect_load(url: str, settings: Any, wiring: Any) -> Any:
    if failure_of("connect-load"):
        return None
    return await wiring.datagrams(url), FailingLoadClient(wiring.clock.now())


def make_arm(settings: Any) -> Any:
    failure_of("make")
    return lambda start, now, seed: FailingArm(settings.emulated, start, now)


def make_load(settings: Any) -> Any:
    return lambda source, now, seed: FailingLoad(settings.emulated, source, seed)


def changed(kind: Any, name: str, connect: Any, make: Any) -> Any:
    emulation = dataclasses.replace(kind.emulation, make=make)
    return dataclasses.replace(kind, name=name, connect=connect, emulation=emulation)


ROBOT = changed(ARM, "failarm", connect_arm, make_arm)
SENSOR = changed(LOAD, "failload", connect_load, make_load)
SURFACE = dataclasses.replace(
    SPRING, name="failspring", make=lambda settings: lambda since: FailingSpring(settings, since)
)
