"""Link to the robot of a plug-in. Any exception or invalid return value of the plug-in becomes an error that ends
the run.

One proxy wraps the link, another one its movement. Each proxy forwards all attributes of the wrapped object. The
last gate checks each target of the movement.
"""

import inspect
from collections.abc import AsyncIterator, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager
from types import NoneType
from typing import Any, cast

from hil_bridge.clock import Clock
from hil_bridge.devices.robots.gate import Bounds, Gate
from hil_bridge.devices.robots.seam import Motion, MotionLimits, RobotFacts, RobotLink, RobotReport, Sent
from hil_bridge.errors import BridgeError, GateStop
from hil_bridge.errors.cancelling import raise_if_interrupt
from hil_bridge.errors.failures import RAISED, WrongAnswer, blame, code_failed, involves_plugin, link_cause
from protocol.geometry import Pose

_AWAITED: Mapping[str, type | None] = {
    "ready": RobotReport,
    "report": RobotReport,
    "release": None,
    "aclose": None,
    "to": Sent,
    "settled": None,
    "halt": Sent,
}
"""Coroutine methods of a link and of a movement, with the type of the result, or None if the result is not used."""

_READ: Mapping[str, tuple[type, ...]] = {
    "facts": (RobotFacts,),
    "counters": (Mapping,),
    "ordered": (bool,),
    "halted": (bool,),
    "abandoned": (bool,),
    "commanded": (tuple, NoneType),
}
"""Attributes that a run reads, with their types."""


class _PluginProxy:
    """Proxy of an object that a plug-in provides."""

    def __init__(self, thing: Any, name: str) -> None:
        """Wrap `thing`. `name` is the name of the robot's wire."""
        self.__dict__.update(_thing=thing, _name=name)

    def __getattr__(self, attribute: str) -> Any:
        """Return the attribute of the wrapped object. Its methods raise only BridgeErrors and the exceptions that
        cancel a task.
        """
        with self._convert_errors(attribute):
            value = getattr(self._thing, attribute)
            kinds = _READ.get(attribute)
            if kinds is not None and not isinstance(value, kinds):
                raise WrongAnswer(self._thing, attribute, value, kinds[0].__name__)
        if attribute in _AWAITED:
            value = self._await(attribute, value)
        elif inspect.isroutine(value):
            value = self._call(attribute, value)
        else:
            return value
        self.__dict__[attribute] = value
        return value

    def __setattr__(self, attribute: str, value: Any) -> None:
        with self._convert_errors(attribute):
            setattr(self._thing, attribute, value)

    def _await(self, attribute: str, method: Any) -> Any:
        kind = _AWAITED[attribute]

        async def ask(*values: Any, **options: Any) -> Any:
            with self._convert_errors(attribute):
                answer = method(*values, **options)
                if inspect.isawaitable(answer):
                    answer = await answer
                elif kind is None:
                    raise WrongAnswer(self._thing, attribute, answer, "an awaitable")
                if kind is not None and not (isinstance(answer, kind) and _has_pose(answer)):
                    raise WrongAnswer(self._thing, attribute, answer, f"a {kind.__name__}")
                return answer

        return ask

    def _call(self, attribute: str, method: Any) -> Any:
        def call(*values: Any, **options: Any) -> Any:
            with self._convert_errors(attribute):
                return method(*values, **options)

        return call

    @contextmanager
    def _convert_errors(self, attribute: str) -> Iterator[None]:
        """Convert exceptions to BridgeError, except those that cancel the task, and AttributeErrors for missing
        attributes.
        """
        try:
            yield
        except RAISED as error:
            if (
                isinstance(error, AttributeError)
                and not involves_plugin(error)
                and not hasattr(type(self._thing), attribute)
            ):
                raise
            self._raise(error, attribute)

    def _raise(self, error: BaseException, attribute: str) -> None:
        raise_if_interrupt(error)
        blame(error, self._thing, attribute)
        raise code_failed(f"robot link {self._name}", error, link_cause(error)) from error


class _PluginLink(_PluginProxy):
    """Proxy of a plug-in's link."""

    def __init__(self, link: RobotLink, name: str, clock: Clock) -> None:
        super().__init__(link, name)
        self.__dict__["_clock"] = clock

    @asynccontextmanager
    async def motion(self, limits: MotionLimits) -> AsyncIterator["_PluginMotion"]:
        """Return a movement; see `RobotLink.motion`."""
        inside: BaseException | None = None
        try:
            async with self._thing.motion(limits) as motion:
                try:
                    yield _PluginMotion(motion, self._name, limits, self._clock)
                except BaseException as error:
                    inside = error
                    raise
        except RAISED as error:
            if error is inside:  # the run's own exception, passing through
                raise
            self._raise(error, "motion")


class _PluginMotion(_PluginProxy):
    """Proxy of a plug-in's movement."""

    def __init__(self, motion: Motion, name: str, limits: MotionLimits, clock: Clock) -> None:
        super().__init__(motion, name)
        ask, gate = self._await("to", motion.to), Gate(limits.bounds or Bounds(), clock.now())

        async def to(target: Pose, *, soon: bool = False) -> Sent:
            """Order the next point; see `Motion.to`. Raises GateStop if the last gate stops the target."""
            if stopped := gate.judge(target, clock.now()):
                raise GateStop(stopped)
            try:
                return cast(Sent, await ask(target, soon=soon))
            except BridgeError:
                gate.take_back()
                raise

        self.__dict__["to"] = to


def _has_pose(answer: Any) -> bool:
    """Return whether a result is not a report, or is a report that contains a pose, which may be invalid."""
    return not isinstance(answer, RobotReport) or isinstance(answer.pose, Pose)


def wrap_plugin_link(link: RobotLink, url: str, clock: Clock) -> RobotLink:
    """Wrap the link to a plug-in's robot. `url` is the URL of the robot's wire."""
    return cast(RobotLink, _PluginLink(link, url, clock))
