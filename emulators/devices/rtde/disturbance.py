"""Faults of the emulated controller carried out."""

import math
from collections.abc import Callable
from typing import Protocol

from emulators.devices.rtde.controller import BY_FAULT, Controller
from emulators.devices.rtde.faults import CONNECTION_FAULTS, POSE_FAULTS
from emulators.devices.rtde.state import Snapshot
from emulators.faults.ledger import Handler, Injection
from emulators.faults.own import OwnFaults
from emulators.seams import Handlers
from protocol.devices.rtde.program import INPUT_NAMES
from protocol.geometry import Pose

_LATE_MAX = 4096
"""Chosen: packets that are kept back at a time; eight seconds of them."""
_DROPPED = "dropped"
_AXES = "xyz"


class Closable(Protocol):
    """A connection that can be closed."""

    closing: bool


class Disturbance:
    """Faults that are under way, or come next. Its `handlers` are those of `faults`."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self.connections: list[Closable] = []
        """Connections to the RTDE port."""
        self._own = own = OwnFaults()
        self._frozen: Pose | None = None
        """Pose that is told while it stays as it is."""
        acts = {
            "protective-stop": lambda: controller.protective_stop(BY_FAULT),
            "program-stopped": controller.stop_program,
            "program-paused": controller.pause,
            "power-off": controller.power_off,
        }
        self.handlers: Handlers = {
            "robot": {
                **own.striking({name: self._at(act) for name, act in acts.items()}),
                "emergency-stop": self._while(controller.emergency_stop, controller.release_emergency_stop),
                "safeguard-stop": self._while(
                    lambda: controller.safeguard(True), lambda: controller.safeguard(False)
                ),
                "local-control": self._while(lambda: self._control(False), lambda: self._control(True)),
                "slider": Handler(self._slide, lambda injection, now: self._slide_to(1.0, now)),
            },
            "connection": {
                **own.striking({_DROPPED: self._at(self._drop)}),
                **own.held(name for name in CONNECTION_FAULTS if name != _DROPPED),
            },
            "pose": {**own.held(POSE_FAULTS), **own.ended_by("frozen", self._thaw)},
            "witness": controller.own_force.handlers,
        }

    # --- begin and end

    def _at(self, act: Callable[[], object]) -> Callable[[float], None]:
        """The act, once the controller has come to the time."""

        def strike(now: float) -> None:
            self._controller.advance(now)
            act()

        return strike

    def _while(self, act: Callable[[], object], back: Callable[[], object]) -> Handler:
        """One act at the begin, another at the end."""

        def begin(injection: Injection) -> None:
            self._at(act)(injection.injected_at)
            injection.struck += 1

        return Handler(begin, lambda injection, now: self._at(back)(now))

    def _control(self, remote: bool) -> None:
        self._controller.remote = remote

    def _slide(self, injection: Injection) -> None:
        self._slide_to(injection.number("percent") / 100.0, injection.injected_at)
        injection.struck += 1

    def _slide_to(self, share: float, now: float) -> None:
        self._controller.advance(now)
        self._controller.slider = share

    def _drop(self) -> None:
        for connection in self.connections:
            connection.closing = True

    def _thaw(self, now: float) -> None:
        self._frozen = None

    # --- effects

    def _holds(self, name: str) -> Injection | None:
        """The fault of this name that holds in this cycle, with one more effect; or None."""
        return self._own.under_way(name, self._controller.now)

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
        pose = snapshot.pose
        if self._holds("nan"):
            pose = Pose((math.nan,) * 3, pose.quaternion)
        elif self._holds("frozen"):
            pose = self._frozen = self._frozen or pose
        elif off := self._holds("offset"):
            x, y, z = (
                place + off.number(f"{axis}_mm") / 1000.0
                for place, axis in zip(pose.position, _AXES, strict=True)
            )
            pose = Pose((x, y, z), pose.quaternion)
        else:
            return snapshot
        return snapshot._replace(pose=pose)
