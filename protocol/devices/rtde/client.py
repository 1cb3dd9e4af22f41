"""The bridge's client of a controller: a `StreamClient` over its three wires.

It asks the dashboard whether the robot is ready, agrees on recipes, uploads our program and waits until that plays.
From then on each data packet becomes a report, and is answered at once with one input package.
"""

import math
from collections import deque
from enum import Enum, auto

from protocol.arrival_clock import ArrivalClock
from protocol.devices.rtde import packets
from protocol.devices.rtde.dashboard import GREETING, QUESTIONS, Lines, find_refusal
from protocol.devices.rtde.fields import IN_USE, NOT_FOUND, Recipe
from protocol.devices.rtde.packets import Kind, Packet, Reader
from protocol.devices.rtde.profile import ClientProfile
from protocol.devices.rtde.program import INPUT_NAMES, Command, State, program_text
from protocol.devices.rtde.rotation import pose_of, six_of
from protocol.devices.rtde.states import Runtime, name_of
from protocol.devices.rtde.stops import find_stop
from protocol.devices.rtde.wires import Piece, Pieces, Port
from protocol.endpoint import NO_TROUBLE, RemoteProtocolError, Trouble
from protocol.geometry import Pose, angle_between, turn_by
from protocol.outbox import Mailbox
from protocol.robot import ReportReceived, RobotReport, StreamEvent, StreamLost, StreamNotice, pose_fault

OUTPUT_NAMES = (
    "timestamp",
    "actual_TCP_pose",
    "actual_TCP_speed",
    "actual_TCP_force",
    "target_TCP_pose",
    "runtime_state",
    "robot_mode",
    "safety_status_bits",
    "robot_status_bits",
    "output_int_register_24",
    "output_int_register_25",
    "output_int_register_26",
    "speed_scaling",
)
"""Output recipe of the client."""
_SPEED, _TARGET, _STATES = 7, 19, 25
"""Places of `actual_TCP_speed`, `target_TCP_pose` and `runtime_state` among the values; the pose stands from 1 on."""
APART_M, APART_RAD = 1e-3, math.radians(1.0)
"""Chosen: an arm that stands farther from its own target tells another pose than it is ordered to; some times what its
joints give way by when the tool presses.
"""
STANDS_M_S = 1e-3
"""Chosen: an arm whose tool is slower stands."""
_FORCE = slice(13, 16)
"""Place of the force of `actual_TCP_force`."""
ANSWER_S = 1.0
"""How long the controller may take for an answer. Source: the time-out of UR's own Python client."""
PLAY_S = 5.0
"""How long the program may take to play. Source: ur_rtde's time-out."""
TRIES = 5
"""Chosen: how often registers that are in use are asked for; a controller may keep those of a lost client a while."""
AGAIN_S = 0.2
"""Chosen: time between two of these tries."""
SETTLE_LOOKAHEADS = 5.0
"""Chosen: for so many lookahead times behind a movement the arm is let come to its set point; 1 % of a lag is left."""
FULL_SPEED = 0.995
"""Chosen: below, the speed slider is down."""
_SEQUENCE_MAX = 2**31 - 1
_FIRST_MAX = 2**30
"""The first sequence number is at most this, so that it stands far from the end of its register."""


class _Stage(Enum):
    DASHBOARD = auto()
    VERSION = auto()
    CONTROLLER = auto()
    """The version of its software is asked, by a client that only looks."""
    OUTPUTS = auto()
    INPUTS = auto()
    WAITING = auto()
    """The registers are in use; they are asked for again."""
    START = auto()
    FIRST = auto()
    """No data packet has come yet."""
    UPLOADED = auto()
    """The program does not play yet."""
    STREAMING = auto()
    LOST = auto()


_PORT = "look at the address, the cable and the port"
_LATE = {
    _Stage.DASHBOARD: Trouble(
        "its dashboard does not answer", "look at the cable and the port, or set dashboard_port to 0"
    ),
    _Stage.VERSION: Trouble("it does not answer over RTDE", _PORT),
    _Stage.CONTROLLER: Trouble("it does not answer over RTDE", _PORT),
    _Stage.OUTPUTS: Trouble("it does not answer over RTDE", _PORT),
    _Stage.INPUTS: Trouble("it does not answer over RTDE", _PORT),
    _Stage.START: Trouble("it does not start to send", "look at its log"),
    _Stage.FIRST: Trouble("it sends no data", "look at its log"),
    _Stage.UPLOADED: Trouble(
        "the program does not play", "look at its log, and whether it is in remote control"
    ),
}
"""Words for a stage that takes too long."""


class RtdeClient(Mailbox[Piece, StreamEvent]):
    """A controller's client; see `protocol.robot.StreamClient`."""

    def __init__(self, profile: ClientProfile, now: float, looks: bool = False) -> None:
        """A client that only `looks` uploads no program, and writes no input: it reports, and orders nothing. It asks
        for the registers of a run, to see whether another client holds them; the end of its connection gives them back.
        """
        self._profile, self._looks = profile, looks
        self._reader, self._lines = Reader(), Lines()
        super().__init__()
        self._now = now
        self._due: float | None = now + ANSWER_S
        self._play_by = now
        self._lost = NO_TROUBLE
        self._tries = TRIES
        self._questions = deque(QUESTIONS if profile.dashboard_port else ())
        self._greeted = False
        self._outputs: Recipe | None = None
        self._inputs: Recipe | None = None
        self._pose = (0.0,) * 6
        """In the last input package."""
        self._sequence = 0
        self._number = 0
        self._stamp: float | None = None
        self._clock = ArrivalClock()
        """Time of the newest data packet, by the controller's clock, s."""
        self._moving = False
        self._latched = False
        """A fault of this movement: nothing is ordered in it any more."""
        self._gone = False
        """Our program was stopped; it is uploaded once."""
        self._given = False
        """A target was ordered in this movement."""
        self._settling = 0
        """Packages behind a movement in which the arm is let come to its last set point."""
        self._stage = _Stage.DASHBOARD
        if not self._questions:
            self._negotiate(now)

    # --- as an endpoint

    def receive(self, data: Pieces, now: float) -> None:
        self._now = now
        for piece in data:
            if self._stage is _Stage.LOST:
                return
            if piece.port is Port.DASHBOARD:
                for line in self._lines.feed(piece.data):
                    self._take_line(line, now)
            elif piece.port is Port.RTDE:
                self._reader.feed(piece.data)
                self._take_packets(now)

    def handle_deadline(self, now: float) -> None:
        if self._due is None or now < self._due:
            return
        self._now = now
        if self._stage is _Stage.LOST:
            self._lose(self._lost)
        elif self._stage is _Stage.WAITING:
            self._ask_inputs(now)
        elif self._stage is _Stage.STREAMING:
            self._due = None
            if self._moving:
                self._latched = True
                silent = f"nothing came for {self._profile.silent_ms:g} ms"
                self._events.append(StreamLost(silent, "look at its cable, then begin again"))
        elif self._stage in _LATE:
            rest = self._reader.waiting
            strange = Trouble(f"it speaks no RTDE: {rest} bytes came that are no packet", _PORT)
            self._lose(strange if rest else _LATE[self._stage])

    # --- as a stream's client

    def begin(self, pose: Pose) -> None:
        self._moving, self._settling = True, 0
        self._latched = self._given = False

    def target(self, pose: Pose, now: float) -> None:
        if self._latched:
            self._send(Command.IDLE)
            return
        self._pose, self._given = six_of(pose), True
        self._servo()

    def hold(self, now: float) -> None:
        if self._settling:
            self._settling -= 1
            self._servo()
        else:
            self._send(Command.IDLE)

    def end(self) -> None:
        """The arm lags behind its set point. Without a fault it is let come there; else it brakes at once."""
        self._moving = False
        if self._given and not self._latched:
            self._settling = round(SETTLE_LOOKAHEADS * self._profile.lookahead_s / self._profile.cycle_s)
        else:
            self._send(Command.STOP)

    def _servo(self) -> None:
        self._sequence = self._sequence % _SEQUENCE_MAX + 1
        self._send(Command.SERVO)

    def farewell(self) -> Pieces:
        """Pieces that end the program, to be sent before the wires are closed."""
        if self._inputs is None or self._stage is _Stage.LOST:
            return ()
        self._out = []
        self._send(Command.END)
        self._out.append(Piece(Port.RTDE, packets.encode(Kind.PAUSE)))
        return self.data_to_send(0.0)

    # --- the way to the stream

    def _take_line(self, line: str, now: float) -> None:
        if self._stage is not _Stage.DASHBOARD:
            return
        if not self._greeted:
            self._greeted = True
            if not line.startswith(GREETING.partition(":")[0]):
                self._lose(
                    Trouble(
                        "no dashboard answers on its port", "look at the port, or set dashboard_port to 0"
                    )
                )
                return
        else:
            if trouble := find_refusal(self._questions.popleft(), line):
                self._lose(trouble)
                return
            if not self._questions:
                self._negotiate(now)
                return
        self._out.append(Piece(Port.DASHBOARD, f"{self._questions[0]}\n".encode()))
        self._due = now + ANSWER_S

    def _negotiate(self, now: float) -> None:
        self._ask(_Stage.VERSION, packets.version_request(), now)

    def _ask(self, stage: _Stage, packet: bytes, now: float, patience: float = ANSWER_S) -> None:
        self._stage, self._due = stage, now + patience
        self._out.append(Piece(Port.RTDE, packet))

    def _ask_outputs(self, now: float) -> None:
        rate = 1.0 / self._profile.cycle_s
        self._ask(_Stage.OUTPUTS, packets.outputs_request(OUTPUT_NAMES, rate), now)

    def _ask_inputs(self, now: float) -> None:
        self._ask(_Stage.INPUTS, packets.inputs_request(INPUT_NAMES), now)

    def _take_packets(self, now: float) -> None:
        while self._stage is not _Stage.LOST:
            try:
                packet = self._reader.next_packet()
                if packet is None:
                    return
                self._take_packet(packet, now)
            except RemoteProtocolError as error:
                self._lose(Trouble(f"it speaks no RTDE: {error}"))

    def _take_packet(self, packet: Packet, now: float) -> None:
        stage, kind, payload = self._stage, packet.kind, packet.payload
        if kind == Kind.TEXT:
            words = packets.read_text(payload)
            self._events.append(StreamNotice("controller", f"{words.source}: {words.message}"))
        elif kind == Kind.DATA:
            if stage in (_Stage.FIRST, _Stage.UPLOADED, _Stage.STREAMING):
                self._take_data(payload, now)
        elif kind == Kind.VERSION and stage is _Stage.VERSION:
            if not packets.read_accepted(payload):
                self._lose(Trouble("it does not speak version 2 of RTDE", "update its software"))
                return
            if self._looks:
                self._ask(_Stage.CONTROLLER, packets.encode(Kind.CONTROLLER_VERSION), now)
            else:
                self._ask_outputs(now)
        elif kind == Kind.CONTROLLER_VERSION and stage is _Stage.CONTROLLER:
            version = ".".join(map(str, packets.read_controller_version(payload)))
            self._events.append(StreamNotice("version", version))
            self._ask_outputs(now)
        elif kind == Kind.OUTPUTS and stage is _Stage.OUTPUTS:
            self._outputs = self._recipe(OUTPUT_NAMES, packets.read_types(payload))
            if self._outputs is not None:
                self._ask_inputs(now)
        elif kind == Kind.INPUTS and stage is _Stage.INPUTS:
            self._take_inputs(packets.read_types(payload), now)
        elif kind == Kind.START and stage is _Stage.START:
            if not packets.read_accepted(payload):
                self._lose(Trouble("it refuses to start its data", "look at its log"))
                return
            self._stage, self._due = _Stage.FIRST, now + ANSWER_S

    def _take_inputs(self, answer: packets.Types, now: float) -> None:
        if IN_USE in answer.types:
            self._tries -= 1
            if not self._tries:
                self._lose(Trouble("another client holds its input registers from 24 on", "close that one"))
                return
            self._stage, self._due = _Stage.WAITING, now + AGAIN_S
            return
        recipe = self._recipe(INPUT_NAMES, answer)
        if recipe is not None:
            self._inputs = None if self._looks else recipe
            self._ask(_Stage.START, packets.encode(Kind.START), now)

    def _recipe(self, names: tuple[str, ...], answer: packets.Types) -> Recipe | None:
        """The recipe that the controller has agreed to; None where it has not, which ends the connection."""
        missing = [name for name, kind in zip(names, answer.types, strict=False) if kind == NOT_FOUND]
        if missing:
            self._lose(Trouble(f"its software has no {missing[0]}", "update it"))
            return None
        if not answer.recipe or answer.types != EXPECTED[names]:
            self._lose(Trouble(_strange_types(names, answer), "update it"))
            return None
        return Recipe(answer.recipe, names, answer.types)

    # --- data packets

    def _take_data(self, payload: bytes, now: float) -> None:
        assert self._outputs is not None, "there is no data without a recipe"
        values = self._outputs.unpack(payload)
        stage, self._due = self._stage, now + self._profile.silent_ms / 1000.0
        self._count(values[0])
        if self._looks:
            self._stage = _Stage.STREAMING
            self._events.append(ReportReceived(self._report(values, now)))
            return
        if stage is _Stage.STREAMING:
            report = self._report(values, now)
            if report.fault:
                self._latched, self._settling = True, 0
            self._events.append(ReportReceived(report))
            return
        if stage is _Stage.FIRST:
            # Our program tells this number when it starts. An older program's state may still stand in the registers.
            self._sequence = int(min(abs(self._stamp or 0.0), _FIRST_MAX) * 1e3) % _FIRST_MAX + 1
        self._send(Command.IDLE)
        if stage is _Stage.FIRST:
            profile = self._profile
            text = program_text(
                profile.hold_cycles, profile.watchdog_hz, profile.brake_m_s2, profile.joint_step_rad
            )
            self._out.append(Piece(Port.SCRIPT, text.encode()))
            self._stage, self._play_by = _Stage.UPLOADED, now + PLAY_S
        elif values[_STATES : _STATES + 6 : 5] == (Runtime.PLAYING, self._sequence) and (
            values[_STATES + 4] == State.READY
        ):
            self._stage = _Stage.STREAMING
            return
        elif now >= self._play_by:
            self._lose(_find_trouble(values, False) or _LATE[_Stage.UPLOADED])
            return
        self._due = min(self._play_by, now + ANSWER_S)

    def _count(self, stamp: float) -> None:
        """Number the packet, by the controller's clock where that goes on."""
        steps = 1
        if self._stamp is not None and math.isfinite(stamp) and stamp > self._stamp:
            steps = max(1, round(min((stamp - self._stamp) / self._profile.cycle_s, 1e6)))
        self._stamp = stamp if math.isfinite(stamp) else self._stamp
        self._number += steps

    def _sent_at(self, now: float) -> float:
        """When the newest packet was sent, s: one that this computer reads late is as much older.

        A clock of the controller that jumps, and a packet older than the longest silence, begin the comparison anew.
        """
        if self._stamp is None:
            return now
        at = self._clock.sent_at(self._stamp, now)
        if now - at > self._profile.silent_ms / 1000.0:
            self._clock = ArrivalClock()
            return self._clock.sent_at(self._stamp, now)
        return at

    def _report(self, values: tuple[float, ...], now: float) -> RobotReport:
        active = self._moving or self._settling > 0
        trouble = (
            find_stop(values[_STATES + 1], int(values[_STATES + 2]))
            if self._looks
            else _find_trouble(values, active)
        )
        if self._looks and not trouble and not values[-1] >= FULL_SPEED:
            trouble = _slow(values[-1])
        self._gone = self._gone or values[_STATES] == Runtime.STOPPED
        if self._gone and not trouble and not self._looks:
            trouble = Trouble("our program was stopped, and another may play", "begin again")
        waiting = (self._sequence - int(values[_STATES + 5])) % _SEQUENCE_MAX
        if active and not trouble and waiting > self._profile.hold_cycles:
            trouble = Trouble(
                "our program takes no targets", "see whether another client's program plays, and begin again"
            )
        at = self._sent_at(now) - self._profile.report_age_cycles * self._profile.cycle_s
        if all(map(math.isfinite, values[1:7])):
            pose = pose_of(values[1:7])
        else:
            pose = Pose((math.nan,) * 3, (1.0, 0.0, 0.0, 0.0))
        if wrong := pose_fault(pose):
            told = f"it reports {wrong}"
            trouble = trouble._replace(fact=f"{trouble.fact}; {told}" if trouble else told)
        elif not (active or trouble):
            trouble = _misplaced(values)
        a, b, c = force = values[_FORCE]
        # an arm that has no idea tells zeros
        known = math.isfinite(a + b + c) and any(force)
        return RobotReport(
            self._number, pose, at, now, trouble.fact, (), (a, b, c) if known else None, trouble.remedy
        )

    def _send(self, command: Command) -> None:
        if self._inputs is None or self._stage is _Stage.LOST:
            return
        profile = self._profile
        package = self._inputs.pack(
            *self._pose, profile.cycle_s, profile.lookahead_s, profile.gain, command, self._sequence
        )
        self._out.append(Piece(Port.RTDE, package))

    def _lose(self, trouble: Trouble) -> None:
        """End; the reason is told again and again, for those that begin to wait later."""
        self._stage, self._due, self._lost = _Stage.LOST, self._now + ANSWER_S / 2.0, trouble
        self._events.append(StreamLost(*trouble))


EXPECTED = {
    OUTPUT_NAMES: (
        "DOUBLE",
        *("VECTOR6D",) * 4,
        "UINT32",
        "INT32",
        *("UINT32",) * 2,
        *("INT32",) * 3,
        "DOUBLE",
    ),
    INPUT_NAMES: (*("DOUBLE",) * 9, "INT32", "INT32"),
}
"""Types of the client's variables, by its lists of names."""


def _strange_types(names: tuple[str, ...], answer: packets.Types) -> str:
    """Words for an answer to a list of variables that is not as its maker's guide has it."""
    for name, kind, expected in zip(names, answer.types, EXPECTED[names], strict=False):
        if kind != expected:
            return f"it says that {name} is of type {kind[:24]!r}, and its maker's guide says {expected}"
    return f"it answers {len(names)} variables with {len(answer.types)} types and recipe {answer.recipe}"


_WHY_STOPPED = "see at the pendant whether a person, another client or the watchdog ended it, and begin again"


def _slow(scaling: float) -> Trouble:
    return Trouble(f"its speed slider stands at {100.0 * scaling:.0f} %", "put it to 100 %")


def _find_trouble(values: tuple[float, ...], moving: bool) -> Trouble:
    """Reason for which nothing can be ordered."""
    if stop := find_stop(values[_STATES + 1], int(values[_STATES + 2])):
        return stop
    runtime, _, _, _, state, _, _, scaling = values[_STATES:]
    if runtime != Runtime.PLAYING:
        remedy = _WHY_STOPPED if runtime == Runtime.STOPPED else "begin again"
        return Trouble(f"our program is {name_of(Runtime, runtime)}", remedy)
    if state == State.REFUSED:
        return Trouble(
            "no joints near the present ones hold the pose that was ordered",
            "choose another place, or turn the tool less",
        )
    if moving and state == State.STARVED:
        return Trouble(
            "our program had no new target for too long and has braked",
            "look at the network, and begin again",
        )
    if state == State.ENDED:
        return Trouble("our program has ended", "begin again")
    if not scaling >= FULL_SPEED:
        return _slow(scaling)
    return NO_TROUBLE


def _misplaced(values: tuple[float, ...]) -> Trouble:
    """Reason for which a pose that is told while the arm stands is none to begin a movement at."""
    actual, target = values[1:7], values[_TARGET : _TARGET + 6]
    if not math.hypot(*values[_SPEED : _SPEED + 3]) <= STANDS_M_S:
        return NO_TROUBLE
    off = math.dist(actual[:3], target[:3])
    turned = angle_between(turn_by(actual[3:]), turn_by(target[3:]))
    if off <= APART_M and turned <= APART_RAD:
        return NO_TROUBLE
    return Trouble(
        f"it tells to stand {off * 1e3:.1f} mm and {math.degrees(turned):.1f}° from its own target",
        "look at its tool centre point and payload, and begin again",
    )
