"""The robot as a program knows it: all that functions of the table ask and order. The controller implements it.

Lengths are m, angles rad, times s, forces N, moments N·m. Poses are the tool's in the base frame, by the tool
centre point that the program has set, unless a word says otherwise.
"""

from collections.abc import Iterator, Set
from enum import StrEnum
from typing import NamedTuple, Protocol

from emulators.devices.rtde.urscript.failures import RuntimeFailure, SyntaxFailure
from protocol.geometry import Pose, Vector

Six = tuple[float, float, float, float, float, float]


ORDERED = "ordered by a program"
"""Reason of a protective stop that a program orders."""


class Message(StrEnum):
    """Kinds of messages of a program."""

    TEXT = "text"
    POPUP = "popup"
    SYNTAX = "syntax error"
    RUNTIME = "runtime error"
    STARTED = "program started"
    STOPPED = "program stopped"


class Profile(NamedTuple):
    """How fast a move goes."""

    speed: float
    """m/s along a path, rad/s in joints."""
    acceleration: float
    time: float = 0.0
    """Of the whole move, s; it rules where it is not 0."""


class Socket(Protocol):
    """A connection that a program has opened."""

    @property
    def opening(self) -> bool:
        """Whether the server has not answered yet."""

    @property
    def open(self) -> bool:
        """Whether the other end is there."""

    def take(self, count: int) -> bytes | None:
        """So many bytes that have come; None while there are fewer."""

    def take_until(self, end: bytes) -> bytes | None:
        """Bytes up to an end, that included; all that is there for an empty end. None while it has not come."""

    def send(self, data: bytes) -> bool:
        """Send; False where the other end has gone."""

    def hang_up(self) -> None:
        """Close it."""


class Host(Protocol):
    """The robot."""

    @property
    def period(self) -> float:
        """Of a cycle, s."""

    # --- messages

    def tell(self, message: Message, text: str, title: str = "") -> None:
        """Show a message of the program; `title` is that of a pop-up."""

    @property
    def popup_open(self) -> bool:
        """Whether a pop-up stands on the pendant."""

    def report_failure(self, failure: RuntimeFailure | SyntaxFailure) -> None:
        """Report a program that failed, or did not start."""

    def report_tagged(self, function: str, detail: str) -> None:
        """Report a call of a function without an effect here; `detail` is its treatment."""

    # --- time and registers

    def clock(self) -> float:
        """Since the controller started, s."""

    def random(self) -> float:
        """Return a random number, 0 … 1."""

    def read_register(self, direction: str, kind: str, number: int) -> float:
        """`direction` is input or output, `kind` int, double or bit. Raises ScriptError for a number of none."""

    def write_register(self, kind: str, number: int, value: float) -> None:
        """Write a register. Raises ScriptError for a number without a register."""

    def watch_input(self, name: str, frequency_hz: float, action: str) -> None:
        """Require an input to arrive at this rate."""

    def read_digital(self, direction: str, number: int) -> bool:
        """0 to 7 standard, 8 to 15 configurable, 16 and 17 the tool's."""

    def write_digital(self, number: int, on: bool) -> None:
        """Write a digital output, numbered as in `read_digital`."""

    def read_analog(self, direction: str, number: int) -> float:
        """0 or 1; a share of its range, 0 … 1."""

    def write_analog(self, number: int, share: float) -> None:
        """Write an analogue output."""

    @property
    def flags(self) -> Set[int]:
        """Numbers of the flags that are set."""

    def set_flag(self, number: int, on: bool) -> None:
        """Set a flag. Flags outlive their program."""

    def open_socket(self, address: str, port: int) -> Socket | None:
        """Open a connection to a server, which is made in later cycles; None if none is available."""

    # --- the arm

    @property
    def joints(self) -> Six:
        """As they are."""

    @property
    def target(self) -> Six:
        """Joints that are wanted."""

    @property
    def speeds(self) -> Six:
        """Of the joints as measured, rad/s."""

    @property
    def target_speeds(self) -> Six:
        """That the controller wants of the joints, rad/s."""

    @property
    def speed_scaling(self) -> float:
        """Share of its speed that a motion has by the speed slider, 0 … 1."""

    @property
    def tcp(self) -> Pose:
        """Tool in the flange."""

    @property
    def payload(self) -> tuple[float, ...]:
        """Mass, kg, and its centre in the flange, m."""

    @property
    def still(self) -> bool:
        """Whether the arm stands."""

    def forward(self, joints: Six, tcp: Pose | None = None) -> Pose:
        """Pose of a tool at these joints."""

    def solve(self, pose: Pose, near: Six | None = None, tcp: Pose | None = None) -> Six | None:
        """Joints that hold a tool in a pose; None if there are none."""

    def output(self, name: str) -> tuple[float, ...]:
        """Return an output of RTDE as it is sent now. Raises ScriptError for an unknown name."""

    def servo(self, joints: Six, time: float, lookahead: float, gain: float) -> int:
        """servoj; for how many cycles it holds. It may be refused by a protective stop."""

    def speed(self, speeds: Six, acceleration: float) -> None:
        """Joint speeds for this cycle."""

    def brake(self, deceleration: float) -> None:
        """Joints slow down in this cycle, rad/s²."""

    def brake_line(self, deceleration: float) -> None:
        """Brake in the same way, by the tool's deceleration, m/s²."""

    def speed_line(self, velocity: Six, acceleration: float) -> bool:
        """Set the tool's velocity, base axes, for this cycle; False if no joints follow."""

    def line(self, goal: Pose, profile: Profile) -> Iterator[object] | None:
        """Return a motion along a line, one item a cycle; None if its values are not numbers."""

    def swing(self, goal: Six, profile: Profile) -> Iterator[object] | None:
        """Return the same motion, straight in joints."""

    def arc(self, via: Pose, goal: Pose, profile: Profile) -> Iterator[object] | None:
        """Return the same motion along a circle through three places."""

    def set_tcp(self, tcp: Pose) -> None:
        """Set the tool in the flange."""

    def set_payload(self, mass: float, centre: tuple[float, ...]) -> None:
        """Set the payload."""

    # --- force and stops

    def zero_force(self) -> None:
        """Take the present force as zero."""

    def enable_external_force(self, enable: bool) -> None:
        """Take `external_force_torque` for the force sensor, or the arm's own."""

    def force_mode(
        self, frame: Pose, compliant: tuple[bool, ...], wrench: Six, kind: int, limits: Six
    ) -> None:
        """Force mode by `wrench`, N and N·m, in a frame of the base frame, `kind` 1 to 3; it changes one that is on.
        `limits` are m/s and rad/s of compliant axes, m and rad of the others.
        """

    def freedrive(self, frame: Pose, free: tuple[bool, ...]) -> None:
        """Let the axes of a frame yield to the force on the tool."""

    def end_force_mode(self, freedrive: bool) -> None:
        """End force mode, or freedrive."""

    @property
    def damping(self) -> float:
        """Of force mode, 0 … 1."""

    @property
    def gain_scaling(self) -> float:
        """Of force mode, 0 … 2."""

    def set_damping(self, damping: float) -> None:
        """Of force mode."""

    def set_gain_scaling(self, scaling: float) -> None:
        """Of force mode."""

    def steps_since_contact(self, direction: Vector, threshold_n: float) -> int:
        """Cycles back to just before the tool's contact; 0 for none. A threshold of 0 stands for the usual one."""

    def joints_before(self, steps: int) -> Six:
        """Joints of so many cycles ago, as far as they are kept."""

    def protective_stop(self, why: str) -> None:
        """Stop the arm at once."""

    def power_off(self) -> None:
        """Remove the arm's power."""
