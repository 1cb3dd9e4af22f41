"""Execution of a program without an arm while the real one is stopped, so that the client's orders after a stop can
be observed.

Registers keep their last values. A program that is executed after a stop uses these values.
"""

from collections.abc import Iterator

from emulators.devices.rtde.controller import Controller
from emulators.devices.rtde.kinematics import Joints
from emulators.devices.rtde.script_host import ControllerHost
from emulators.devices.rtde.urscript import CompiledProgram, Machine, Message, Profile, Socket
from emulators.devices.rtde.urscript.failures import RuntimeFailure, SyntaxFailure
from protocol.geometry import Pose


class DryHost(ControllerHost):
    """Robot in its actual state. The program has no effect on it, but its motions are reported."""

    # --- messages and outputs

    def tell(self, message: Message, text: str, title: str = "") -> None:
        """Ignore the message."""

    def report_failure(self, failure: RuntimeFailure | SyntaxFailure) -> None:
        """Ignore the failure."""

    def report_tagged(self, function: str, detail: str) -> None:
        """Ignore the call."""

    def write_register(self, kind: str, number: int, value: float) -> None:
        """Leave the register unchanged."""

    def watch_input(self, name: str, frequency_hz: float, action: str) -> None:
        """Start no watchdog."""

    def write_digital(self, number: int, on: bool) -> None:
        """Leave the output unchanged."""

    def write_analog(self, number: int, share: float) -> None:
        """Leave the output unchanged."""

    def set_flag(self, number: int, on: bool) -> None:
        """Leave the flag unchanged."""

    def open_socket(self, address: str, port: int) -> Socket | None:
        return None

    # --- the arm

    def servo(self, joints: Joints, time: float, lookahead: float, gain: float) -> int:
        self._motions.report_servo(joints)
        return 1

    def speed(self, speeds: Joints, acceleration: float) -> None:
        self._motions.report_speed("speedj", speeds)

    def speed_line(self, velocity: Joints, acceleration: float) -> bool:
        self._motions.report_speed("speedl", velocity)
        return True

    def brake(self, deceleration: float) -> None:
        """Do nothing: there is no arm to decelerate."""

    def brake_line(self, deceleration: float) -> None:
        """Do nothing: there is no arm to decelerate."""

    @property
    def still(self) -> bool:
        return True

    def line(self, goal: Pose, profile: Profile) -> Iterator[object] | None:
        self._motions.report_move("move along a line", goal)
        return iter((None,))

    def swing(self, goal: Joints, profile: Profile) -> Iterator[object] | None:
        self._motions.report_move("move in joints", self.forward(goal))
        return iter((None,))

    def arc(self, via: Pose, goal: Pose, profile: Profile) -> Iterator[object] | None:
        self._motions.report_move("move along an arc", goal)
        return iter((None,))

    def set_tcp(self, tcp: Pose) -> None:
        """Leave the tool unchanged."""

    def set_payload(self, mass: float, centre: tuple[float, ...]) -> None:
        """Leave the payload unchanged."""

    def zero_force(self) -> None:
        """Leave the zero unchanged."""

    def force_mode(
        self, frame: Pose, compliant: tuple[bool, ...], wrench: Joints, kind: int, limits: Joints
    ) -> None:
        """Start no force mode."""

    def freedrive(self, frame: Pose, free: tuple[bool, ...]) -> None:
        """Start no freedrive."""

    def end_force_mode(self, freedrive: bool) -> None:
        """Do nothing: no force mode is active."""

    def set_damping(self, damping: float) -> None:
        """Leave the damping unchanged."""

    def set_gain_scaling(self, scaling: float) -> None:
        """Leave the gain scaling unchanged."""

    def enable_external_force(self, enable: bool) -> None:
        """Leave the force sensor unchanged."""

    def protective_stop(self, why: str) -> None:
        """Do nothing: there is no arm to stop."""

    def power_off(self) -> None:
        """Do nothing: there is no arm."""


class Rehearsal:
    """Rehearsal of a program that depends on its inputs, in the cycles in which the program does not run."""

    def __init__(self, controller: Controller, compiled: CompiledProgram) -> None:
        self._controller, self._compiled = controller, compiled
        self._machine: Machine | None = None
        self._since = 0
        """Value of `Motions.news` at the start of the rehearsal."""

    def cycle(self) -> None:
        """Run one cycle. The rehearsal restarts after each stop, with the inputs at that time."""
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
