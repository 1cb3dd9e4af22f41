"""Execution of faults of the emulated controller."""

from collections.abc import Callable, Mapping
from typing import Protocol

import numpy as np

from emulators.arm.reported_pose import ReportedPose
from emulators.devices.rtde.controller import Controller
from emulators.devices.rtde.faults import DROPPED, POSE_FAULTS, PROGRAM_WIRE
from emulators.devices.rtde.kinematics import compose, invert
from emulators.devices.rtde.safety import BY_FAULT, Stimulus
from emulators.devices.rtde.state import Snapshot
from emulators.faults.ledger import Handler, Injection
from emulators.faults.own import OwnFaults
from emulators.faults.packets import WIRE
from emulators.seams import Handlers
from protocol.devices.rtde.program import INPUT_NAMES
from protocol.geometry import Pose

_IN_USE, _SILENT = "in-use", "primary-silent"


class Closable(Protocol):
    """Connection that can be closed."""

    closing: bool


class Disturbance:
    """Active and pending faults. `handlers` executes the faults listed in `faults`."""

    def __init__(
        self, controller: Controller, wire: Mapping[str, Handler], program_wire: Mapping[str, Handler]
    ) -> None:
        """Create the fault handlers, given those for the cable's faults and for the faults of programs' connections."""
        self._controller = controller
        self.connections: list[Closable] = []
        """Connections to the RTDE port."""
        self._own = own = OwnFaults()
        self._reported_pose = ReportedPose(self._pose_measured_at, POSE_FAULTS)
        acts = {
            "protective-stop": lambda: controller.protective_stop(BY_FAULT),
            "program-stopped": lambda: controller.player.stop(controller.now),
            "program-paused": controller.player.pause,
            "motors-off": controller.power_off,
        }
        self.handlers: Handlers = {
            "robot": {
                **own.striking({name: self._at(act) for name, act in acts.items()}),
                "emergency-stop": self._while(
                    controller.emergency_stop, controller.state.release_emergency_stop
                ),
                "safeguard-stop": self._while(
                    controller.open_safeguard, lambda: controller.state.apply(Stimulus.SAFEGUARD_CLOSED)
                ),
                "local-control": self._while(lambda: self._control(False), lambda: self._control(True)),
                "slider": Handler(self._slide, lambda injection, now: self._slide_to(1.0, now)),
                **own.held((_IN_USE, _SILENT)),
            },
            "pose": self._reported_pose.handlers,
            WIRE: {**wire, **own.striking({DROPPED: self._at(self._drop)})},
            PROGRAM_WIRE: program_wire,
            "witness": controller.force.own.handlers,
        }

    # --- begin and end

    def _at(self, act: Callable[[], object]) -> Callable[[float], None]:
        """Return the action, delayed until the controller has reached the time."""

        def strike(now: float) -> None:
            self._controller.advance(now)
            act()

        return strike

    def _while(self, act: Callable[[], object], back: Callable[[], object]) -> Handler:
        """Return a handler with one action at the start of a fault and another at its end."""

        def begin(injection: Injection) -> None:
            self._at(act)(injection.injected_at)
            injection.struck += 1

        return Handler(begin, lambda injection, now: self._at(back)(now))

    def _control(self, remote: bool) -> None:
        self._controller.state.remote = remote

    def _slide(self, injection: Injection) -> None:
        self._slide_to(injection.number("percent") / 100.0, injection.injected_at)
        injection.struck += 1

    def _slide_to(self, share: float, now: float) -> None:
        self._controller.advance(now)
        self._controller.io.slider = share

    def _drop(self) -> None:
        for connection in self.connections:
            connection.closing = True

    # --- effects

    def _pose_measured_at(self, time: float) -> Pose:
        """Return the pose that was reported at a past time, s, without noise."""
        path, manipulator, at = self._controller.path, self._controller.manipulator, np.array([time])
        x, y, z = path.trajectory(at)[0][0].tolist()
        ((_, quaternion),) = path.orientations(at)
        return compose(compose(Pose((x, y, z), quaternion), invert(manipulator.tool)), manipulator.tcp)

    def in_use(self, name: str) -> bool:
        """Return whether a fault lets another client hold an input."""
        return name in INPUT_NAMES and self._own.under_way(_IN_USE, self._controller.now) is not None

    def silences(self, now: float) -> bool:
        """Return whether a fault silences the primary interface at a time, s."""
        return self._own.under_way(_SILENT, now) is not None

    def reported(self, snapshot: Snapshot) -> Snapshot:
        """Return the state that the controller reports under the active faults."""
        pose = self._reported_pose.told(snapshot.pose, self._controller.now)
        assert pose is not None, "a recipe has it"
        return snapshot if pose is snapshot.pose else snapshot._replace(pose=pose)
