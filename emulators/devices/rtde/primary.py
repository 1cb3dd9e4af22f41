"""Primary and secondary interface: the controller's state ten times a second, its messages, and program text.

The secondary interface sends the version first and then only states, without other messages. Source: Universal
Robots' guide to its client interfaces. A read-only interface accepts no text. A connection made in local control
accepts none either.
"""

import math
import zlib
from collections.abc import Callable, Mapping, Sequence

from emulators.devices.rtde.controller import Controller
from emulators.devices.rtde.running import ProgramMessage
from emulators.devices.rtde.script import ScriptPort
from emulators.devices.rtde.state import Snapshot, getter
from emulators.devices.rtde.targets import SUDDEN_CHANGE
from emulators.devices.rtde.urscript import ORDERED
from emulators.devices.rtde.urscript import Message as Kind
from protocol.devices.rtde import primary
from protocol.devices.rtde.primary import MessageKind, Part, ReportLevel
from protocol.devices.rtde.rotation import six_of
from protocol.devices.rtde.states import RobotMode, Runtime, SafetyMode
from protocol.devices.rtde.wires import Port

MESSAGE_DELAY_MAX_S = 0.02
"""Maximum delay of a message, s. Chosen."""
BUILT = "02-02-2022, 00:00:00"
"""Build date of the software. Chosen."""
_JOINT_ACCELERATION = 40.0
"""Acceleration limit of each joint, rad/s². Observed (URSim 5, frames of the C++ client library's tests)."""
_JOINT_RANGE = 6.3355451848
"""Range limit of each joint, rad; the arm itself stops at two turns. Observed (URSim 5, frames of the C++ client
library's tests).
"""
_DEFAULTS = (math.radians(60.0), math.radians(80.0), 0.25, 1.2, 0.25)
"""Default speed and acceleration of joints and of the tool, and equivalent radius. Observed (URSim 5, frames of the
C++ client library's tests).
"""
_BOARD = (6, 4)
"""Version of the masterboard, and type of the control box. Observed (URSim 5, frames of the C++ client library's
tests).
"""
_TYPES = {"ur5e": (1, 3), "ur5": (1, 1), "ur10e": (2, 3), "ur10": (2, 1)}
"""Type of an arm, from the C++ client library, and its sub-type. The sub-type is observed for a UR5e and assumed
for other arms.
"""
_HALF_TURN = math.pi / 2
_CODES = {SUDDEN_CHANGE: primary.SUDDEN_CHANGE, ORDERED: primary.ORDERED}
"""Codes of protective stops by reason."""
_EMERGENCY = (SafetyMode.SYSTEM_EMERGENCY_STOP, SafetyMode.ROBOT_EMERGENCY_STOP)
_SPEED_LIMIT = 1.0
"""Speed limit. Observed (URSim 5, frames of the C++ client library's tests)."""
_READ_ONLY = (Port.READ_ONLY, Port.SECONDARY_READ_ONLY)

Values = Sequence[float]


def _read(name: str, snapshot: Snapshot) -> tuple[float, ...]:
    return getter(name)(snapshot)


def _robot_mode(controller: Controller, snapshot: Snapshot) -> Values:
    powered = snapshot.mode >= RobotMode.POWER_ON
    return (
        round(snapshot.time * 1e9),
        1,
        1,
        powered,
        snapshot.safety in _EMERGENCY,
        snapshot.safety == SafetyMode.PROTECTIVE_STOP,
        snapshot.runtime in (Runtime.PLAYING, Runtime.PAUSED),
        snapshot.runtime == Runtime.PAUSED,
        snapshot.mode,
        0,
        snapshot.scaling,
        snapshot.scaling,
        _SPEED_LIMIT,
        0,
    )


def _joints(controller: Controller, snapshot: Snapshot) -> Values:
    mode = _read("joint_mode", snapshot)
    temperatures, voltages = _read("joint_temperatures", snapshot), _read("actual_joint_voltage", snapshot)
    places, currents = (snapshot.joints, snapshot.target, snapshot.speeds), _read("actual_current", snapshot)
    rows = zip(*places, currents, voltages, temperatures, mode, strict=True)
    return [part for q, to, qd, i, v, t, at in rows for part in (q, to, qd, i, v, t, t, int(at))]


def _tool(controller: Controller, snapshot: Snapshot) -> Values:
    (voltage,) = _read("actual_robot_voltage", snapshot)
    return (
        0,
        0,
        0.0,
        0.0,
        voltage,
        0,
        0.0,
        *_read("tool_temperature", snapshot),
        int(_read("tool_mode", snapshot)[0]),
    )


def _masterboard(controller: Controller, snapshot: Snapshot) -> Values:
    analog = [_read(f"standard_analog_output{number}", snapshot)[0] for number in (0, 1)]
    (voltage,), (current,) = _read("actual_robot_voltage", snapshot), _read("actual_robot_current", snapshot)
    (inputs,), (outputs,) = (
        _read(f"actual_digital_{direction}_bits", snapshot) for direction in ("input", "output")
    )
    temperature = _read("joint_temperatures", snapshot)[0]
    types = int(_read("analog_io_types", snapshot)[0])
    domains = (types >> 2 & 1, types >> 3 & 1)
    begin = (int(inputs) & 0xFFFFFFFF, int(outputs) & 0xFFFFFFFF, 1, 1, 0.0, 0.0, *domains, *analog)
    return (*begin, temperature, voltage, current, 0.0, snapshot.safety, 0, 0, 0, 1, 1, 1)


def _cartesian(controller: Controller, snapshot: Snapshot) -> Values:
    return (*six_of(snapshot.pose), *six_of(snapshot.tcp))


def _denavit_hartenberg(controller: Controller) -> Mapping[str, Values]:
    """Return the arm's lengths and angles by name, joint by joint. A real arm has calibrated values."""
    arm = controller.manipulator.lengths
    return {
        "theta": (0.0,) * 6,
        "a": (0.0, arm.a2, arm.a3, 0.0, 0.0, 0.0),
        "d": (arm.d1, 0.0, 0.0, arm.d4, arm.d5, arm.d6),
        "alpha": (_HALF_TURN, 0.0, 0.0, _HALF_TURN, -_HALF_TURN, 0.0),
    }


def _kinematics(controller: Controller, snapshot: Snapshot) -> Values:
    """Return the kinematics packet. Chosen: a joint's checksum is the checksum of its four numbers as text."""
    lengths = _denavit_hartenberg(controller)
    rows = zip(*lengths.values(), strict=True)
    return (
        *(zlib.crc32(repr(row).encode()) for row in rows),
        *(part for name in ("theta", "a", "d", "alpha") for part in lengths[name]),
        0,
    )


def _configuration(controller: Controller, snapshot: Snapshot) -> Values:
    lengths = _denavit_hartenberg(controller)
    return (
        *(-_JOINT_RANGE, _JOINT_RANGE) * 6,
        *(controller.profile.max_joint_speed_rad_s, _JOINT_ACCELERATION) * 6,
        *_DEFAULTS,
        *(part for name in ("a", "d", "alpha", "theta") for part in lengths[name]),
        *_BOARD,
        *_TYPES[controller.profile.model],
    )


def _force_mode(controller: Controller, snapshot: Snapshot) -> Values:
    return (*snapshot.force, 0.0)


_PARTS: Mapping[Part, Callable[[Controller, Snapshot], Values]] = {
    Part.ROBOT_MODE: _robot_mode,
    Part.JOINTS: _joints,
    Part.CARTESIAN: _cartesian,
    Part.KINEMATICS: _kinematics,
    Part.MASTERBOARD: _masterboard,
    Part.TOOL: _tool,
    Part.CONFIGURATION: _configuration,
    Part.FORCE_MODE: _force_mode,
    Part.ADDITIONAL: lambda controller, snapshot: (0, 0, 0, 0),
}


def encode_state(controller: Controller) -> bytes:
    """Encode the state of a controller as one packet."""
    snapshot = controller.snapshots[-1]
    return primary.encode(
        primary.PacketType.STATE,
        b"".join(
            primary.encode(part, layout.pack_row(*_PARTS[part](controller, snapshot)[: len(layout.fields)]))
            for part, layout in primary.parts_of(controller.version).items()
        ),
    )


class PrimaryPort:
    """Connection to the primary or secondary port, as an endpoint of bytes."""

    closing = False

    def __init__(
        self, controller: Controller, silences: Callable[[float], bool], now: float, port: Port = Port.PRIMARY
    ) -> None:
        """Open the connection. `silences` returns whether a fault silences the port at a time, s."""
        controller.advance(now)
        self._silences = silences
        self._controller = controller
        self._script = ScriptPort(controller)
        self._read_only = port in _READ_ONLY or not controller.state.remote
        self._has_messages = port in (Port.PRIMARY, Port.READ_ONLY)
        self._out: list[bytes] = []
        self._modes: list[tuple[SafetyMode, str]] = []
        """Safety modes that have not been reported yet, each with the reason of a stop."""
        self._state_at = self._next_check_at = now
        controller.console.listeners.append(self)
        self._put(MessageKind.VERSION, primary.version_body(controller.version, BUILT))

    def hear(self, program_message: ProgramMessage) -> None:
        """Queue a message from a program, or about one."""
        match program_message.message:
            case Kind.TEXT:
                self._say(MessageKind.TEXT, program_message.text.encode("utf-8", "replace"))
            case Kind.POPUP:
                self._say(MessageKind.POPUP, primary.popup_body(program_message.title, program_message.text))
            case Kind.SYNTAX | Kind.RUNTIME:
                body = primary.runtime_exception_body(
                    program_message.line, program_message.column, program_message.text
                )
                self._say(MessageKind.RUNTIME_EXCEPTION, body)
            case Kind.STARTED | Kind.STOPPED:
                key = f"PROGRAM_XXX_{program_message.message.name}"
                self._say(MessageKind.KEY, primary.key_body(key, program_message.text))

    def receive_safety_mode(self, mode: SafetyMode) -> None:
        """Queue a change of the safety mode."""
        self._modes.append((mode, self._controller.state.stop_reason))

    def _send_modes(self) -> None:
        """Report the safety modes that have begun. A state with the newest mode precedes them (assumed)."""
        self._out.append(encode_state(self._controller))
        for mode, reason in self._modes:
            self._say(MessageKind.SAFETY_MODE, primary.safety_mode_body(mode))
            if mode == SafetyMode.PROTECTIVE_STOP:
                body = primary.error_body(_CODES.get(reason, primary.NO_CODE), 0, ReportLevel.WARNING, reason)
                self._say(MessageKind.ERROR_CODE, body)
        self._modes.clear()

    def _say(self, kind: MessageKind, body: bytes) -> None:
        if self._has_messages:
            self._put(kind, body)

    def _put(self, kind: MessageKind, body: bytes) -> None:
        time_ns = round(self._controller.snapshots[-1].time * 1e9)
        self._out.append(primary.encode_message(primary.Message(time_ns, primary.NO_SOURCE, kind, body)))

    # --- as an endpoint

    def receive(self, data: bytes, now: float) -> None:
        if not self._read_only:
            self._script.receive(data, now)
        elif data.strip():
            self._controller.counts["text to a read-only interface"] += 1
            self._say(MessageKind.ERROR_CODE, primary.error_body(primary.READ_ONLY, 0, ReportLevel.WARNING))

    def next_event(self) -> None:
        return None

    def data_to_send(self, now: float) -> bytes:
        out, self._out = self._out, []
        return b"" if out and self._silences(now) else b"".join(out)

    def next_deadline(self) -> float | None:
        return self._next_check_at

    def handle_deadline(self, now: float) -> None:
        """Send the newest state that is due. A process that is late skips the states that it missed."""
        if now < self._next_check_at:
            return
        controller = self._controller
        controller.advance(now)
        if self._modes:
            self._send_modes()
        if now >= self._state_at:
            self._out.append(encode_state(controller))
            self._state_at += primary.STATE_PERIOD_S * (1 + (now - self._state_at) // primary.STATE_PERIOD_S)
        self._next_check_at = min(now + MESSAGE_DELAY_MAX_S, self._state_at)

    def close(self, now: float) -> None:
        """End the connection."""
        self._controller.console.listeners.remove(self)
