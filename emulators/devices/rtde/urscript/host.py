"""Interface through which programs query and command the robot. The controller implements it.

Lengths are in m, angles in rad, times in s, forces in N, moments in N·m. Unless stated otherwise, poses are those
of the tool in the base frame, with the tool centre point set by the program.
"""

from collections.abc import Iterator, Set
from enum import StrEnum
from typing import NamedTuple, Protocol

from emulators.devices.rtde.urscript.failures import RuntimeFailure, SyntaxFailure
from protocol.geometry import Pose, Vector

Six = tuple[float, float, float, float, float, float]


ORDERED = "ordered by a program"
"""Reason of a protective stop that a program commands."""


class Message(StrEnum):
    """Kinds of messages from a program, or about a program."""

    TEXT = "text"
    POPUP = "popup"
    SYNTAX = "syntax error"
    RUNTIME = "runtime error"
    STARTED = "program started"
    STOPPED = "program stopped"


class Profile(NamedTuple):
    """Speed and acceleration of a move."""

    speed: float
    """Speed, m/s along a path or rad/s of a joint."""
    acceleration: float
    time: float = 0.0
    """Duration of the move, s. Unless it is 0, it takes precedence over speed and acceleration."""


class Socket(Protocol):
    """Connection opened by a program."""

    @property
    def opening(self) -> bool:
        """Whether the connection is being opened: the server has not answered yet."""

    @property
    def open(self) -> bool:
        """Whether the connection is open at both ends."""

    def take(self, count: int) -> bytes | None:
        """Return this many received bytes; None if fewer bytes have been received."""

    def take_until(self, end: bytes) -> bytes | None:
        """Return the received bytes up to and including a terminator; None if it has not been received.

        With an empty terminator, return everything received.
        """

    def send(self, data: bytes) -> bool:
        """Send bytes. Return False if the other end has closed the connection."""

    def hang_up(self) -> None:
        """Close the connection."""


class Host(Protocol):
    """Robot on which a program runs."""

    @property
    def period(self) -> float:
        """Cycle time, s."""

    # --- messages

    def tell(self, message: Message, text: str, title: str = "") -> None:
        """Show a message of the program; `title` is the title of a pop-up."""

    @property
    def popup_open(self) -> bool:
        """Whether the pendant shows a pop-up."""

    def report_failure(self, failure: RuntimeFailure | SyntaxFailure) -> None:
        """Report that a program failed or did not start."""

    def report_tagged(self, function: str, detail: str) -> None:
        """Report a call of a function that has no effect in the emulator. `detail` describes how the call was
        treated.
        """

    # --- time and registers

    def clock(self) -> float:
        """Time since the controller started, s."""

    def random(self) -> float:
        """Return a random number from 0 to 1."""

    def read_register(self, direction: str, kind: str, number: int) -> float:
        """Read a register. `direction` is input or output, `kind` is int, double or bit. Raises ScriptError if
        there is no such register.
        """

    def write_register(self, kind: str, number: int, value: float) -> None:
        """Write a register. Raises ScriptError if there is no such register."""

    def watch_input(self, name: str, frequency_hz: float, action: str) -> None:
        """Require that an input is updated at this rate."""

    def read_digital(self, direction: str, number: int) -> bool:
        """Read a digital input: 0 to 7 standard, 8 to 15 configurable, 16 and 17 of the tool."""

    def write_digital(self, number: int, on: bool) -> None:
        """Write a digital output, numbered as in `read_digital`."""

    def read_analog(self, direction: str, number: int) -> float:
        """Read analogue input 0 or 1 as a share of its range, 0 … 1."""

    def write_analog(self, number: int, share: float) -> None:
        """Write an analogue output."""

    @property
    def flags(self) -> Set[int]:
        """Numbers of all set flags."""

    def set_flag(self, number: int, on: bool) -> None:
        """Set a flag. Flags persist after the program ends."""

    def open_socket(self, address: str, port: int) -> Socket | None:
        """Open a connection to a server; it completes in later cycles. None if no more sockets are available."""

    # --- the arm

    @property
    def joints(self) -> Six:
        """Actual joint angles, rad."""

    @property
    def target(self) -> Six:
        """Target joint angles, rad."""

    @property
    def speeds(self) -> Six:
        """Measured joint speeds, rad/s."""

    @property
    def target_speeds(self) -> Six:
        """Target joint speeds, rad/s."""

    @property
    def speed_scaling(self) -> float:
        """Speed scaling set by the speed slider, 0 … 1."""

    @property
    def tcp(self) -> Pose:
        """Pose of the tool centre point in the flange frame."""

    @property
    def payload(self) -> tuple[float, ...]:
        """Payload: mass, kg, and centre of gravity in the flange frame, m."""

    @property
    def still(self) -> bool:
        """Whether the arm is stationary."""

    def forward(self, joints: Six, tcp: Pose | None = None) -> Pose:
        """Return the pose of a tool at these joint angles."""

    def solve(self, pose: Pose, near: Six | None = None, tcp: Pose | None = None) -> Six | None:
        """Return joint angles that hold a tool in a pose; None if there is no solution."""

    def output(self, name: str) -> tuple[float, ...]:
        """Return the current value of an RTDE output. Raises ScriptError for an unknown name."""

    def servo(self, joints: Six, time: float, lookahead: float, gain: float) -> int:
        """Command servoj; return the number of cycles for which it applies. A protective stop may refuse it."""

    def speed(self, speeds: Six, acceleration: float) -> None:
        """Command joint speeds for this cycle."""

    def brake(self, deceleration: float) -> None:
        """Decelerate the joints in this cycle, rad/s²."""

    def brake_line(self, deceleration: float) -> None:
        """Decelerate in this cycle, by the tool's deceleration, m/s²."""

    def speed_line(self, velocity: Six, acceleration: float) -> bool:
        """Command the tool's velocity in base axes for this cycle. Return False if there is no joint solution."""

    def line(self, goal: Pose, profile: Profile) -> Iterator[object] | None:
        """Return a linear motion of the tool, as a generator with one item per cycle; None if a value is not finite."""

    def swing(self, goal: Six, profile: Profile) -> Iterator[object] | None:
        """Return a motion that is linear in joint space, as a generator with one item per cycle; None if a value is
        not finite.
        """

    def arc(self, via: Pose, goal: Pose, profile: Profile) -> Iterator[object] | None:
        """Return a circular motion through three points, as a generator with one item per cycle; None if a value is
        not finite.
        """

    def set_tcp(self, tcp: Pose) -> None:
        """Set the tool centre point in the flange frame."""

    def set_payload(self, mass: float, centre: tuple[float, ...]) -> None:
        """Set the payload."""

    # --- force and stops

    def zero_force(self) -> None:
        """Zero the force sensor at the current force."""

    def enable_external_force(self, enable: bool) -> None:
        """Select the force sensor: `external_force_torque` or the arm's own sensor."""

    def force_mode(
        self, frame: Pose, compliant: tuple[bool, ...], wrench: Six, kind: int, limits: Six
    ) -> None:
        """Start or change force mode with `wrench`, N and N·m. `frame` is in the base frame; `kind` is 1 to 3.

        `limits` are in m/s and rad/s for compliant axes, and in m and rad for the other axes.
        """

    def freedrive(self, frame: Pose, free: tuple[bool, ...]) -> None:
        """Start freedrive: the selected axes of a frame yield to the force on the tool."""

    def end_force_mode(self, freedrive: bool) -> None:
        """End force mode or freedrive."""

    @property
    def damping(self) -> float:
        """Damping of force mode, 0 … 1."""

    @property
    def gain_scaling(self) -> float:
        """Gain scaling of force mode, 0 … 2."""

    def set_damping(self, damping: float) -> None:
        """Set the damping of force mode."""

    def set_gain_scaling(self, scaling: float) -> None:
        """Set the gain scaling of force mode."""

    def steps_since_contact(self, direction: Vector, threshold_n: float) -> int:
        """Return the number of cycles back to just before the tool's contact; 0 if there is no contact.

        A threshold of 0 selects the default.
        """

    def joints_before(self, steps: int) -> Six:
        """Return the joint angles this many cycles ago, or the oldest ones that are stored."""

    def protective_stop(self, why: str) -> None:
        """Trigger a protective stop."""

    def power_off(self) -> None:
        """Switch off the arm's power."""
