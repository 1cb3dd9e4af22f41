"""Server of Stream Motion of the emulated controller: its peer, its buffer of set points, its answers to requests."""

from collections import Counter, deque
from collections.abc import Callable, Hashable

from emulators.unmodelled import Unmodelled
from hil_fanuc import alarms
from hil_fanuc.alarms import Alarms
from hil_fanuc.packets import (
    THRESHOLDS,
    Capability,
    Command,
    CommandPosition,
    ForceSensor,
    GpioRequest,
    GpioResult,
    Kind,
    Limit,
    Signal,
    Threshold,
    ThresholdRequest,
    ToClient,
    ToRobot,
    encode_to_client,
    is_finite,
    nine,
)
from hil_fanuc.profile import FanucProfile
from hil_fanuc.program import Program
from protocol.datagram import Datagram

OLD_VERSION = 2
"""Newest version of a session that begins with the start packet of version 1."""
OFFERS_CAPABILITY = 3
"""First version with a capability, an assignment of I/O, and data styles of two bytes."""
HAS_FORCE = 4
_AXES = 6
_BUILT_IN = 1


class StreamServer:
    """Session of Stream Motion."""

    def __init__(self, profile: FanucProfile, program: Program, on_end: Callable[[float], object]) -> None:
        """`on_end` is called when a session ends, with the time, s."""
        self._profile, self._program, self._on_end = profile, program, on_end
        self._alarms: Alarms = program.alarms
        self.peer: Hashable = None
        """Sender of the start packet."""
        self.is_open = False
        """Whether reports are sent."""
        self.version: int = profile.version
        """Version of the session."""
        self.sequence = 0
        """Number of the newest report."""
        self.start_move = 0
        self.reports_tcp = False
        self.sensor = 0
        """Selected force sensor; 0: none."""
        self.command_position: Callable[[float], CommandPosition] = _no_position
        """Function that returns the newest set point at a time, s."""
        self.zeroes = 0
        """Number of resets of the force."""
        self.buffer: deque[Command] = deque(maxlen=profile.packet_stack)
        self.received = False
        """Whether a command has arrived since the last report."""
        self.has_last = False
        """Whether the last command of a movement was received."""
        self.counts: Counter[str] = Counter()
        self._answered = -1
        """Number of the newest report that was answered."""
        self._out: list[bytes] = []
        self.unmodelled = Unmodelled("fanuc")

    def take_out(self) -> list[bytes]:
        """Return the answers to send."""
        out, self._out = self._out, []
        return out

    def handle(self, packet: ToRobot, side: Hashable, now: float) -> None:
        """Handle a packet of a client."""
        if self._program.hangs:
            return
        match packet:
            case Signal(kind):
                self._signal(kind, packet.version, side, now)
            case Command():
                self._command(packet, side, now)
            case ThresholdRequest():
                self._answer(self.threshold(packet), side)
            case Capability():
                self._capability(packet, side)
            case GpioRequest(_, lines):
                if any(line.command for line in lines):
                    self.unmodelled.touch(
                        "GPIO configuration", "answered as valid; I/O is neither read nor written"
                    )
                self._answer(GpioResult(0, 1), side)
            case ForceSensor():
                self._choose_sensor(packet, now)

    def _signal(self, kind: int, version: int, side: Hashable, now: float) -> None:
        if kind == Kind.VERSION:
            self._answer(Signal(Kind.VERSION, self._profile.version), side)
        elif kind == Kind.COMMAND_POSITION:
            self._answer(self.command_position(now), side)
        elif kind == Kind.STOP:
            self.counts["stops"] += 1
            is_own = side == self.peer
            self.counts["stops by a stranger"] += self.is_open and not is_own
            self._program.ended_by_client |= self.is_open and is_own
            self.end(now)
        elif kind == Kind.START and version > self._profile.version:
            text = f"{alarms.VERSION_PREFIX} PC {version}, Rob {self._profile.version}"
            self._alarms.raise_(text, now)
        elif not self.is_open:
            self.counts["sessions"] += 1
            newest = OLD_VERSION if kind == Kind.START_V1 else self._profile.version
            self.is_open, self.peer, self.version = True, side, min(version, newest, self._profile.version)
            self.sequence, self._answered, self.has_last, self.sensor = 0, -1, False, 0
            self.buffer.clear()
            self._program.start_stream(now)
        elif side == self.peer:
            self._alarms.raise_(alarms.NEW_START, now)
        else:
            self._alarms.raise_(alarms.SECOND_PEER, now)

    def end(self, now: float) -> None:
        """End the session: no more reports are sent."""
        if self.is_open:
            self.is_open = False
            self.buffer.clear()
            self._program.streams_since = float("inf")
            self._on_end(now)

    def _command(self, command: Command, side: Hashable, now: float) -> None:
        """Buffer a set point, unless it answers no report, or one that was answered."""
        if not self.is_open or side != self.peer:
            self.counts["commands by a stranger"] += 1
            return
        if not self._answered < command.sequence <= self.sequence:
            self.counts["commands that answer no report"] += 1
            if self._profile.wrong_numbers == "alarm":
                self._alarms.raise_(alarms.SEQUENCE, now)
            return
        self._answered = command.sequence
        self.received = True
        self.has_last = command.is_last or (self.has_last and not command.moves)
        if any(command.position[_AXES:]) and is_finite(command.position):
            self.unmodelled.touch("external axes", "ignored")
        if command.moves:
            if len(self.buffer) == self.buffer.maxlen:
                self.counts["commands beyond the buffer"] += 1
                return
            self.buffer.append(command)

    def _capability(self, request: Capability, side: Hashable) -> None:
        if self._profile.version < OFFERS_CAPABILITY:
            return
        if request.kind == Kind.SET_CAPABILITY:
            self.start_move, self.reports_tcp = min(request.start_move, 9), bool(request.reports_tcp)
        answer = request._replace(
            sampling_ms=self._profile.cycle_ms,
            start_move=self.start_move,
            available_version=self._profile.version,
            reports_tcp=int(self.reports_tcp),
        )
        self._answer(answer, side)

    def _choose_sensor(self, choice: ForceSensor, now: float) -> None:
        if self._profile.version < HAS_FORCE:
            self._alarms.raise_(alarms.SENSOR_REFUSED, now)
            return
        self.zeroes += bool(choice.reset)
        if choice.sensor not in (0, _BUILT_IN):
            self.unmodelled.touch("external force sensor", "reported as not available")
        self.sensor = choice.sensor

    @property
    def has_sensor(self) -> bool:
        """Whether the selected force sensor exists."""
        return self.sensor == _BUILT_IN

    def threshold(self, request: ThresholdRequest) -> Threshold:
        """Return the thresholds of an axis. External axes have none."""
        profile, axis = self._profile, request.axis
        tables = {
            Limit.SPEED: profile.speeds_deg_s,
            Limit.ACCELERATION: profile.accelerations_deg_s2,
            Limit.JERK: profile.jerks_deg_s3,
        }
        values = tables.get(request.limit)  # type: ignore[call-overload]
        value = values[axis - 1] if values is not None and 1 <= axis <= _AXES else 0.0
        loaded = value if request.limit == Limit.SPEED else value * profile.full_load_percent / 100.0
        return Threshold(
            request.version,
            axis,
            request.limit,
            profile.max_speed_mm_s,
            profile.cycle_ms,
            (value,) * THRESHOLDS,
            (loaded,) * THRESHOLDS,
        )

    def _answer(self, packet: ToClient, side: Hashable) -> None:
        self._out.append(Datagram(encode_to_client(packet), side=side))


def _no_position(now: float) -> CommandPosition:
    """Return a set point of zeros, because there is no arm yet."""
    return CommandPosition(0, 0.0, nine(()), nine(()))
