"""Client of a controller: a `StreamClient` over the controller's three connections.

It asks the dashboard whether the robot is ready, negotiates recipes, uploads the bridge's program and waits until
the program is playing. From then on, each data packet becomes a report and is answered at once with one input
package.
"""

from enum import Enum, auto

from protocol.devices.rtde import packets
from protocol.devices.rtde.dashboard import Questioning
from protocol.devices.rtde.data_packet import (
    EXPECTED,
    OUTPUT_NAMES,
    STATES,
    Values,
    describe_strange_types,
    find_pose_mismatch,
    find_slow,
    find_trouble,
    read_force,
    read_pose,
)
from protocol.devices.rtde.fields import IN_USE, NOT_FOUND, Recipe
from protocol.devices.rtde.movement import Movement
from protocol.devices.rtde.packet_clock import PacketClock
from protocol.devices.rtde.packets import Kind, Packet, Reader
from protocol.devices.rtde.profile import ClientProfile
from protocol.devices.rtde.program import INPUT_NAMES, Command, State, program_text
from protocol.devices.rtde.rotation import six_of
from protocol.devices.rtde.states import Runtime
from protocol.devices.rtde.stops import find_stop
from protocol.devices.rtde.wires import Piece, Pieces, Port
from protocol.endpoint import NO_TROUBLE, RemoteProtocolError, Trouble
from protocol.geometry import Pose
from protocol.outbox import Mailbox
from protocol.robot import ReportReceived, RobotReport, StreamEvent, StreamLost, StreamNotice, pose_fault

ANSWER_S = 1.0
"""Time limit for a response of the controller, s. Source: the time-out of UR's own Python client."""
PLAY_S = 5.0
"""Time limit from the upload until the program is playing, s. Source: ur_rtde's time-out."""
TRIES = 5
"""Number of requests for registers that are in use. Chosen: a controller may reserve the registers of a lost client
for a while.
"""
AGAIN_S = 0.2
"""Time between two requests for registers that are in use, s. Chosen."""
SETTLE_LOOKAHEADS = 5.0
"""Time for the arm to reach its set point after a movement, as a multiple of the lookahead time. Chosen: 1 % of the
lag remains.
"""
_SEQUENCE_MAX = 2**31 - 1
_FIRST_MAX = 2**30
"""Upper limit of the first sequence number, chosen to be far from the end of the register's range."""


class _Stage(Enum):
    DASHBOARD = auto()
    VERSION = auto()
    CONTROLLER = auto()
    """The software version is requested. Only a client that does not control the robot has this stage."""
    OUTPUTS = auto()
    INPUTS = auto()
    WAITING = auto()
    """The registers are in use and will be requested again."""
    START = auto()
    FIRST = auto()
    """No data packet has arrived yet."""
    UPLOADED = auto()
    """The program is not playing yet."""
    STREAMING = auto()
    LOST = auto()


_PORT = "check the address, the cable and the port"
_LATE = {
    _Stage.DASHBOARD: Trouble(
        "its dashboard does not respond", "check the cable and the port, or set dashboard_port to 0"
    ),
    _Stage.VERSION: Trouble("it does not respond over RTDE", _PORT),
    _Stage.CONTROLLER: Trouble("it does not respond over RTDE", _PORT),
    _Stage.OUTPUTS: Trouble("it does not respond over RTDE", _PORT),
    _Stage.INPUTS: Trouble("it does not respond over RTDE", _PORT),
    _Stage.START: Trouble("it does not start sending", "check its log"),
    _Stage.FIRST: Trouble("it sends no data", "check its log"),
    _Stage.UPLOADED: Trouble(
        "the program is not playing", "check its log, and whether it is in remote control"
    ),
}
"""Trouble to report for each stage that has timed out."""


class RtdeClient(Mailbox[Piece, StreamEvent]):
    """Client of a controller: a `protocol.robot.StreamClient`."""

    def __init__(self, profile: ClientProfile, now: float, looks: bool = False) -> None:
        """Create a client. With `looks`, it only reports: it uploads no program and writes no input.

        It requests the registers that a run needs, to detect another client that holds them. Closing the connection
        releases the registers.
        """
        self._profile, self._read_only = profile, looks
        self._reader = Reader()
        super().__init__()
        self._now = now
        self._due: float | None = now + ANSWER_S
        self._play_by = now
        self._lost = NO_TROUBLE
        self._tries = TRIES
        self._dashboard = Questioning()
        self._outputs: Recipe | None = None
        self._inputs: Recipe | None = None
        self._pose = (0.0,) * 6
        """Pose in the last input package."""
        self._sequence = 0
        self._clock = PacketClock(profile)
        self._movement = Movement()
        self._was_stopped = False
        """Whether the bridge's program was stopped. The program is uploaded only once."""
        self._stage = _Stage.DASHBOARD
        if not profile.dashboard_port:
            self._negotiate(now)

    # --- Endpoint

    def receive(self, data: Pieces, now: float) -> None:
        self._now = now
        for piece in data:
            if self._stage is _Stage.LOST:
                return
            if piece.port is Port.DASHBOARD:
                self._process_lines(piece.data, now)
            elif piece.port is Port.RTDE:
                self._reader.feed(piece.data)
                self._process_packets(now)

    def handle_deadline(self, now: float) -> None:
        if self._due is None or now < self._due:
            return
        self._now = now
        if self._stage is _Stage.LOST:
            self._fail(self._lost)
        elif self._stage is _Stage.WAITING:
            self._ask_inputs(now)
        elif self._stage is _Stage.STREAMING:
            self._due = None
            if self._movement.moving:
                self._movement.latched = True
                silent = f"nothing received for {self._profile.silent_ms:g} ms"
                self._events.append(StreamLost(silent, "check its cable, then start again"))
        elif self._stage in _LATE:
            rest = self._reader.waiting
            strange = Trouble(f"it does not speak RTDE: {rest} bytes received that are not a packet", _PORT)
            self._fail(strange if rest else _LATE[self._stage])

    # --- StreamClient

    def begin(self, pose: Pose) -> None:
        self._movement.begin()

    def target(self, pose: Pose, now: float) -> None:
        if self._movement.latched:
            self._send(Command.IDLE)
            return
        self._pose, self._movement.given = six_of(pose), True
        self._servo()

    def hold(self, now: float) -> None:
        if self._movement.settle():
            self._servo()
        else:
            self._send(Command.IDLE)

    def end(self) -> None:
        """End the movement. Without a fault, the arm continues to its set point; otherwise it brakes at once."""
        packages = round(SETTLE_LOOKAHEADS * self._profile.lookahead_s / self._profile.cycle_s)
        if not self._movement.end(packages):
            self._send(Command.STOP)

    def _servo(self) -> None:
        self._sequence = self._sequence % _SEQUENCE_MAX + 1
        self._send(Command.SERVO)

    def farewell(self) -> Pieces:
        """Return the data that ends the program. It must be sent before the connections are closed."""
        if self._inputs is None or self._stage is _Stage.LOST:
            return ()
        self._out = []
        self._send(Command.END)
        self._out.append(Piece(Port.RTDE, packets.encode(Kind.PAUSE)))
        return self.data_to_send(0.0)

    # --- connection set-up

    def _process_lines(self, data: bytes, now: float) -> None:
        for line in self._dashboard.feed(data):
            if self._stage is not _Stage.DASHBOARD:
                continue
            if trouble := self._dashboard.take(line):
                self._fail(trouble)
            elif question := self._dashboard.question:
                self._out.append(Piece(Port.DASHBOARD, f"{question}\n".encode()))
                self._due = now + ANSWER_S
            else:
                self._negotiate(now)

    def _negotiate(self, now: float) -> None:
        self._request(_Stage.VERSION, packets.version_request(), now)

    def _request(self, stage: _Stage, packet: bytes, now: float, patience: float = ANSWER_S) -> None:
        self._stage, self._due = stage, now + patience
        self._out.append(Piece(Port.RTDE, packet))

    def _ask_outputs(self, now: float) -> None:
        rate = 1.0 / self._profile.cycle_s
        self._request(_Stage.OUTPUTS, packets.outputs_request(OUTPUT_NAMES, rate), now)

    def _ask_inputs(self, now: float) -> None:
        self._request(_Stage.INPUTS, packets.inputs_request(INPUT_NAMES), now)

    def _process_packets(self, now: float) -> None:
        while self._stage is not _Stage.LOST:
            try:
                packet = self._reader.next_packet()
                if packet is None:
                    return
                self._process_packet(packet, now)
            except RemoteProtocolError as error:
                self._fail(Trouble(f"it does not speak RTDE: {error}"))

    def _process_packet(self, packet: Packet, now: float) -> None:
        stage, kind, payload = self._stage, packet.kind, packet.payload
        if kind == Kind.TEXT:
            message = packets.read_text(payload)
            self._events.append(StreamNotice("controller", f"{message.source}: {message.message}"))
        elif kind == Kind.DATA:
            if stage in (_Stage.FIRST, _Stage.UPLOADED, _Stage.STREAMING):
                self._process_data(payload, now)
        elif kind == Kind.VERSION and stage is _Stage.VERSION:
            if not packets.read_accepted(payload):
                self._fail(Trouble("it does not speak version 2 of RTDE", "update its software"))
                return
            if self._read_only:
                self._request(_Stage.CONTROLLER, packets.encode(Kind.CONTROLLER_VERSION), now)
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
            self._process_inputs(packets.read_types(payload), now)
        elif kind == Kind.START and stage is _Stage.START:
            if not packets.read_accepted(payload):
                self._fail(Trouble("it refuses to start its data", "check its log"))
                return
            self._stage, self._due = _Stage.FIRST, now + ANSWER_S

    def _process_inputs(self, answer: packets.Types, now: float) -> None:
        if IN_USE in answer.types:
            self._tries -= 1
            if not self._tries:
                self._fail(
                    Trouble("another client holds its input registers from 24 on", "close the other client")
                )
                return
            self._stage, self._due = _Stage.WAITING, now + AGAIN_S
            return
        recipe = self._recipe(INPUT_NAMES, answer)
        if recipe is not None:
            self._inputs = None if self._read_only else recipe
            self._request(_Stage.START, packets.encode(Kind.START), now)

    def _recipe(self, names: tuple[str, ...], answer: packets.Types) -> Recipe | None:
        """Return the recipe that the controller accepted; None if it refused, in which case the session ends."""
        missing = [name for name, kind in zip(names, answer.types, strict=False) if kind == NOT_FOUND]
        if missing:
            self._fail(Trouble(f"its software has no {missing[0]}", "update it"))
            return None
        if not answer.recipe or answer.types != EXPECTED[names]:
            self._fail(Trouble(describe_strange_types(names, answer), "update it"))
            return None
        return Recipe(answer.recipe, names, answer.types)

    # --- data packets

    def _process_data(self, payload: bytes, now: float) -> None:
        assert self._outputs is not None, "there is no data without a recipe"
        values = self._outputs.unpack(payload)
        stage, self._due = self._stage, now + self._profile.silent_ms / 1000.0
        self._clock.take(values[0])
        if self._read_only:
            self._stage = _Stage.STREAMING
            self._events.append(ReportReceived(self._report(values, now)))
            return
        if stage is _Stage.STREAMING:
            report = self._report(values, now)
            if report.fault:
                self._movement.latch()
            self._events.append(ReportReceived(report))
            return
        if stage is _Stage.FIRST:
            # The bridge's program reports this number when it starts. Until then, the registers may hold an old state.
            self._sequence = int(min(abs(self._clock.stamp or 0.0), _FIRST_MAX) * 1e3) % _FIRST_MAX + 1
        self._send(Command.IDLE)
        if stage is _Stage.FIRST:
            profile = self._profile
            text = program_text(
                profile.hold_cycles, profile.watchdog_hz, profile.brake_m_s2, profile.joint_step_rad
            )
            self._out.append(Piece(Port.SCRIPT, text.encode()))
            self._stage, self._play_by = _Stage.UPLOADED, now + PLAY_S
        elif values[STATES : STATES + 6 : 5] == (Runtime.PLAYING, self._sequence) and (
            values[STATES + 4] == State.READY
        ):
            self._stage = _Stage.STREAMING
            return
        elif now >= self._play_by:
            self._fail(find_trouble(values, False) or _LATE[_Stage.UPLOADED])
            return
        self._due = min(self._play_by, now + ANSWER_S)

    def _report(self, values: Values, now: float) -> RobotReport:
        active = self._movement.active
        trouble = self._find_trouble(values, active)
        profile = self._profile
        at = self._clock.sent_at(now) - profile.report_age_cycles * profile.cycle_s
        pose = read_pose(values)
        if wrong := pose_fault(pose):
            fault = f"it reports {wrong}"
            trouble = trouble._replace(fact=f"{trouble.fact}; {fault}" if trouble else fault)
        elif not (active or trouble):
            trouble = find_pose_mismatch(values)
        force = read_force(values)
        return RobotReport(self._clock.number, pose, at, now, trouble.fact, (), force, trouble.remedy)

    def _find_trouble(self, values: Values, active: bool) -> Trouble:
        """Return the reason why no order can be given, derived from this packet and the previous ones."""
        self._was_stopped = self._was_stopped or values[STATES] == Runtime.STOPPED
        waiting = (self._sequence - int(values[STATES + 5])) % _SEQUENCE_MAX
        if self._read_only:
            trouble = find_stop(values[STATES + 1], int(values[STATES + 2])) or find_slow(values[-1])
        else:
            trouble = find_trouble(values, active)
        if self._was_stopped and not trouble and not self._read_only:
            trouble = Trouble("our program was stopped, and another one may be playing", "begin again")
        if active and not trouble and waiting > self._profile.hold_cycles:
            trouble = Trouble(
                "our program accepts no targets",
                "check whether another client's program is playing, and start again",
            )
        return trouble

    def _send(self, command: Command) -> None:
        if self._inputs is None or self._stage is _Stage.LOST:
            return
        profile = self._profile
        package = self._inputs.pack(
            *self._pose, profile.cycle_s, profile.lookahead_s, profile.gain, command, self._sequence
        )
        self._out.append(Piece(Port.RTDE, package))

    def _fail(self, trouble: Trouble) -> None:
        """End the session. The reason is reported repeatedly, for callers that start to wait later."""
        self._stage, self._due, self._lost = _Stage.LOST, self._now + ANSWER_S / 2.0, trouble
        self._events.append(StreamLost(*trouble))
