"""Faults of the emulated controller carried out."""

import math
from collections.abc import Callable
from typing import Protocol

from emulators.faults.ledger import Handler, Injection
from emulators.rtde.controller import Controller
from emulators.rtde.state import Snapshot
from emulators.seams import Handlers
from protocol.geometry import Pose
from protocol.rtde.program import INPUT_NAMES
from protocol.rtde.states import SafetyMode

_LATE_MAX = 4096
"""Chosen: packets that are kept back at a time; eight seconds of them."""


class Closable(Protocol):
    """A connection that can be closed."""

    closing: bool


class Disturbance:
    """What goes wrong, now or next. Its `handlers` are those of `faults`."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self.connections: list[Closable] = []
        """Connections to the RTDE port."""
        self._lasting: dict[str, Injection] = {}
        """Faults of connection and pose that hold, or wait for their moment, by name."""
        self._frozen: Pose | None = None
        stop, program = SafetyMode.ROBOT_EMERGENCY_STOP, controller.stop_program
        self.handlers: Handlers = {
            "robot": {
                "protective-stop": self._once(lambda: controller.protective_stop("as a fault")),
                "emergency-stop": self._while(
                    lambda: controller.emergency_stop(stop), controller.release_emergency_stop
                ),
                "safeguard-stop": self._while(
                    lambda: controller.safeguard(True), lambda: controller.safeguard(False)
                ),
                "local-control": self._while(lambda: self._control(False), lambda: self._control(True)),
                "program-stopped": self._once(program),
                "program-paused": self._once(controller.pause),
                "power-off": self._once(controller.power_off),
                "slider": Handler(self._slide, lambda injection, now: self._slide_back()),
            },
            "connection": {
                "dropped": self._once(self._drop),
                **{name: Handler(self._begin, self._end) for name in ("mute", "deaf", "late", "in-use")},
                "lost": Handler(self._begin),
            },
            "pose": {name: Handler(self._begin, self._end) for name in ("nan", "frozen", "offset")},
        }

    # --- begin and end

    def _once(self, act: Callable[[], object]) -> Handler:
        def begin(injection: Injection) -> None:
            self._controller.advance(injection.injected_at)
            act()
            injection.struck += 1
            injection.finish(injection.injected_at)

        return Handler(begin)

    def _while(self, act: Callable[[], object], back: Callable[[], object]) -> Handler:
        def begin(injection: Injection) -> None:
            self._controller.advance(injection.injected_at)
            act()
            injection.struck += 1

        def end(injection: Injection, now: float) -> None:
            self._controller.advance(now)
            back()

        return Handler(begin, end)

    def _control(self, remote: bool) -> None:
        self._controller.remote = remote

    def _slide(self, injection: Injection) -> None:
        self._controller.advance(injection.injected_at)
        self._controller.slider = injection.number("percent") / 100.0
        injection.struck += 1

    def _slide_back(self) -> None:
        self._controller.slider = 1.0

    def _drop(self) -> None:
        for connection in self.connections:
            connection.closing = True

    def _begin(self, injection: Injection) -> None:
        self._lasting[injection.fault] = injection

    def _end(self, injection: Injection, now: float) -> None:
        if self._lasting.get(injection.fault) is injection:
            del self._lasting[injection.fault]
            if injection.fault == "frozen":
                self._frozen = None

    # --- effects

    def _holds(self, name: str) -> Injection | None:
        """The fault of this name that holds now, with one more effect; or None."""
        found = self._lasting.get(name)
        if found is not None:
            found.struck += 1
        return found

    @property
    def deaf(self) -> bool:
        """Whether an input package is lost."""
        return self._holds("deaf") is not None

    def in_use(self, name: str) -> bool:
        """Whether another client holds this input."""
        return name in INPUT_NAMES and self._holds("in-use") is not None

    def outgoing(self, packet: bytes, late: list[tuple[float, bytes]], now: float) -> list[bytes]:
        """Packets to be sent now in the place of one; a late one is put to the others that are."""
        if self._holds("mute"):
            return []
        if lost := self._holds("lost"):
            if lost.struck >= lost.number("count"):
                lost.finish(now)
                del self._lasting["lost"]
            return []
        delay = self._holds("late")
        if delay is not None or late:
            at = now + (0.0 if delay is None else delay.number("ms") / 1000.0)
            if len(late) < _LATE_MAX:
                late.append((max([at, *(when for when, _ in late[-1:])]), packet))
            return []
        return [packet]

    def shown(self, snapshot: Snapshot) -> Snapshot:
        """The state as it is told."""
        if not self._lasting:
            return snapshot
        if self._holds("nan"):
            return snapshot._replace(pose=Pose((math.nan,) * 3, snapshot.pose.quaternion))
        if self._holds("frozen"):
            self._frozen = self._frozen or snapshot.pose
            return snapshot._replace(pose=self._frozen)
        if off := self._holds("offset"):
            x, y, z = (
                place + off.number(f"{axis}_mm") / 1000.0
                for place, axis in zip(snapshot.pose.position, "xyz", strict=True)
            )
            return snapshot._replace(pose=Pose((x, y, z), snapshot.pose.quaternion))
        return snapshot
