"""A program that plays on without an arm while the real one does not: so its client's orders are heard behind a stop.

Registers keep what was written last. A program that is played on after a stop goes by what they hold then.
"""

from collections.abc import Iterator

from emulators.devices.rtde.controller import Controller
from emulators.devices.rtde.kinematics import Joints
from emulators.devices.rtde.script_host import ControllerHost
from emulators.devices.rtde.urscript import CompiledProgram, Machine, Message, Profile, Socket
from emulators.devices.rtde.urscript.failures import RuntimeFailure, SyntaxFailure
from protocol.geometry import Pose


class DryHost(ControllerHost):
    """The robot as it is, on which nothing that the program does has an effect. Motions are told."""

    # --- messages and outputs

    def tell(self, message: Message, text: str, title: str = "") -> None:
        """Not said."""

    def report_failure(self, failure: RuntimeFailure | SyntaxFailure) -> None:
        """Not told."""

    def report_tagged(self, function: str, detail: str) -> None:
        """Not told."""

    def write_register(self, kind: str, number: int, value: float) -> None:
        """Not written."""

    def watch_input(self, name: str, frequency_hz: float, action: str) -> None:
        """Not watched."""

    def write_digital(self, number: int, on: bool) -> None:
        """Not written."""

    def write_analog(self, number: int, share: float) -> None:
        """Not written."""

    def set_flag(self, number: int, on: bool) -> None:
        """Not set."""

    def open_socket(self, address: str, port: int) -> Socket | None:
        return None

    # --- the arm

    def servo(self, joints: Joints, time: float, lookahead: float, gain: float) -> int:
        self._motions.hear_servo(joints)
        return 1

    def speed(self, speeds: Joints, acceleration: float) -> None:
        self._motions.hear_speed("speedj", speeds)

    def speed_line(self, velocity: Joints, acceleration: float) -> bool:
        self._motions.hear_speed("speedl", velocity)
        return True

    def brake(self, deceleration: float) -> None:
        """There is no arm to slow down."""

    def brake_line(self, deceleration: float) -> None:
        """There is no arm to slow down."""

    @property
    def still(self) -> bool:
        return True

    def line(self, goal: Pose, profile: Profile) -> Iterator[object] | None:
        self._motions.hear_move("move along a line", goal)
        return iter((None,))

    def swing(self, goal: Joints, profile: Profile) -> Iterator[object] | None:
        self._motions.hear_move("move in joints", self.forward(goal))
        return iter((None,))

    def arc(self, via: Pose, goal: Pose, profile: Profile) -> Iterator[object] | None:
        self._motions.hear_move("move along an arc", goal)
        return iter((None,))

    def set_tcp(self, tcp: Pose) -> None:
        """Keep the tool."""

    def set_payload(self, mass: float, centre: tuple[float, ...]) -> None:
        """Keep the payload."""

    def zero_force(self) -> None:
        """Keep the zero."""

    def force_mode(
        self, frame: Pose, compliant: tuple[bool, ...], wrench: Joints, kind: int, limits: Joints
    ) -> None:
        """Not begun."""

    def freedrive(self, frame: Pose, free: tuple[bool, ...]) -> None:
        """Not begun."""

    def end_force_mode(self, freedrive: bool) -> None:
        """Not ended."""

    def set_damping(self, damping: float) -> None:
        """Keep the damping."""

    def set_gain_scaling(self, scaling: float) -> None:
        """Keep the gain."""

    def enable_external_force(self, enable: bool) -> None:
        """Keep the sensor."""

    def protective_stop(self, why: str) -> None:
        """There is no arm to stop."""

    def power_off(self) -> None:
        """There is no arm."""


class Rehearsal:
    """A program that goes by its inputs, in the cycles in which it does not play."""

    def __init__(self, controller: Controller, compiled: CompiledProgram) -> None:
        self._controller, self._compiled = controller, compiled
        self._machine: Machine | None = None
        self._since = 0
        """News when it began."""

    def cycle(self) -> None:
        """Run a cycle. The rehearsal restarts after each stop, with the inputs of that time."""
        motions = self._controller.motions
        if self._controller.plays:
            self._machine = None
            return
        if self._machine is None:
            steps = self._controller.profile.script_steps
            self._machine = Machine(self._compiled, DryHost(self._controller), steps)
            self._since = motions.news
        motions.muted = motions.news == self._since
        self._machine.cycle()
        motions.muted = False
