"""A package of toys that fail on purpose: `FAILS` says which part, how, and from which call on."""

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


class OfItsOwn(BaseException):
    """No Exception: `except Exception` does not take it."""


RAISES: dict[str, BaseException] = {
    "raise": ValueError("it is broken\nin two lines"),
    "exit": SystemExit(0),
    "keyboard": KeyboardInterrupt(),
    "own": OfItsOwn("all is over"),
    "generator": GeneratorExit(),
    "cancelled": asyncio.CancelledError(),
    "group": BaseExceptionGroup("two at once", [KeyboardInterrupt(), KeyError("other")]),
}
ANSWERS: dict[str, Any] = {"nothing": None, "nan": math.nan}
"""Answers in place of the right one."""
calls: dict[str, int] = {}


def how(part: str) -> str:
    """How a part fails now; empty while it does not. Raises what it is to raise."""
    calls[part] = calls.get(part, 0) + 1
    if part != FAILS["part"] or calls[part] < FAILS["after"]:
        return ""
    if FAILS["how"] in RAISES:
        raise RAISES[FAILS["how"]]
    if FAILS["how"] == "callback":
        asyncio.get_running_loop().call_soon(stray)
        return ""
    if FAILS["how"] == "cancels":
        asyncio.tasks.current_task().cancel()  # type: ignore[union-attr]
        return ""
    return str(FAILS["how"])


def stray() -> None:
    """Leave the loop as no exception of a callback should."""
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
        return answers[how("law")]


class FailingArmClient(ArmClient):
    def receive(self, data: Any, now: float) -> None:
        how("arm-client")
        super().receive(data, now)


class FailingLink(StreamedLink[Any]):
    async def report(self, *, soon: bool = False) -> Any:
        how("link")
        return await super().report(soon=soon)

    async def aclose(self) -> None:
        await super().aclose()
        how("link-close")


class FailingArm(Arm):
    def handle_deadline(self, now: float) -> None:
        how("arm")
        super().handle_deadline(now)


class FailingLoadClient(LoadClient):
    def receive(self, data: Any, now: float) -> None:
        how("load-client")
        super().receive(data, now)


class FailingLoad(LoadCell):
    def handle_deadline(self, now: float) -> None:
        how("load")
        super().handle_deadline(now)


class FailingSpring(Spring):
    def force(self, positions: Any, velocities: Any, times: Any) -> Any:
        force = super().force(positions, velocities, times)
        answers = {"": force, "nothing": None, "nan": math.nan * force, "shape": force[:, :2]}
        return answers[how("spring")]


def weave(kind: Any, part: str) -> None:
    """Let each method and property of a class fail as the part `part.method`."""
    for name in dir(kind):
        found, key = inspect.getattr_static(kind, name), f"{part}.{name}"
        if name.startswith("_") and name != "__init__":
            continue
        if isinstance(found, property):
            setattr(kind, name, property(woven(found.fget, key), found.fset))
        elif inspect.isfunction(found):
            setattr(kind, name, woven(found, key))


def woven(function: Any, key: str) -> Any:
    """A function that may fail."""

    def call(*values: Any, **options: Any) -> Any:
        said = how(key)
        return function(*values, **options) if not said else ANSWERS[said]

    async def wait(*values: Any, **options: Any) -> Any:
        said = how(key)
        return await function(*values, **options) if not said else ANSWERS[said]

    return wait if inspect.iscoroutinefunction(function) else call


class FailingMotion(StreamedMotion[Any]):
    """The movement of the failing link."""


weave(Law, "Law")
weave(FailingArmClient, "ArmClient")
weave(FailingArm, "Arm")
weave(FailingLoadClient, "LoadClient")
weave(FailingLink, "Link")
weave(FailingMotion, "Motion")


class MovingLink(FailingLink):
    """The failing link with a movement that fails."""

    @asynccontextmanager
    async def motion(self, limits: Any) -> Any:
        async with super().motion(limits) as motion:
            how("Link.enter")
            motion.__class__ = FailingMotion
            yield motion
        how("Link.leave")


async def connect_arm(url: str, settings: Any, wiring: Any) -> Any:
    if how("connect"):
        return None
    wire = await wiring.datagrams(url)
    return MovingLink(wire, FailingArmClient(wiring.clock.now()), FACTS, wiring.clock, wiring.log)


async def connect_load(url: str, settings: Any, wiring: Any) -> Any:
    if how("connect-load"):
        return None
    return await wiring.datagrams(url), FailingLoadClient(wiring.clock.now())


def make_arm(settings: Any) -> Any:
    how("make")
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
