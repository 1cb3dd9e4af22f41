"""Client that supplies a controller with an external force. It reads the pose and writes `external_force_torque`.

Source: Universal Robots' guides and its C++ client library, which has an example of exactly this.
"""

import math
from typing import NamedTuple, TypeAlias

from protocol.devices.rtde import packets
from protocol.devices.rtde.fields import IN_USE, NOT_FOUND, Recipe
from protocol.devices.rtde.packets import Kind, Packet, Reader
from protocol.devices.rtde.program import force_program_text
from protocol.devices.rtde.rotation import pose_of
from protocol.devices.rtde.wires import Piece, Pieces, Port
from protocol.endpoint import RemoteProtocolError
from protocol.geometry import Pose, Vector, Wrench, inverse, rotate
from protocol.outbox import Mailbox

OUTPUTS = ("timestamp", "actual_TCP_pose", "actual_TCP_speed", "tcp_offset")
LOADED_OUTPUTS = (*OUTPUTS, "payload", "payload_cog")
"""Names of the outputs for controllers from version 5.5.1 on."""
INPUTS = ("external_force_torque",)
_TYPES = {
    OUTPUTS: ("DOUBLE", *("VECTOR6D",) * 3),
    LOADED_OUTPUTS: ("DOUBLE", *("VECTOR6D",) * 3, "DOUBLE", "VECTOR3D"),
    INPUTS: ("VECTOR6D",),
}
PATIENCE_S = 1.0
"""Time limit for the next packet of the controller, s. Source: the time-out of UR's own Python client."""
NO_FORCE: Wrench = (0.0,) * 6
GRAVITY = 9.82
"""Gravity with which a controller computes the weight of its payload, m/s². Observed: 1 kg weighs 9.82 N in
Universal Robots' forum, thread 2053.
"""


class Seen(NamedTuple):
    """State of the tool as reported by the controller."""

    stamp: float
    """Time on the controller's clock, s."""
    pose: Pose
    """Tool pose in the base frame, m."""
    velocity: Vector
    """Tool velocity along the base axes, m/s."""
    tip: Pose
    """Pose of the tool centre point in the flange frame."""
    payload: tuple[float, Vector] = (0.0, (0.0, 0.0, 0.0))
    """Configured payload: mass, kg, and centre of gravity in the flange frame, m. Zeros before version 5.5.1, which
    does not report the payload.
    """


class Lost(NamedTuple):
    """The connection can no longer be used."""

    text: str
    """Reason for the loss of the connection."""
    remedy: str = ""
    """Remedy for an operator; empty if none is known."""


Event: TypeAlias = Seen | Lost


class ForceClient(Mailbox[Piece, Event]):
    """Endpoint of `Piece`s, which are bytes with a port. The owner answers each `Seen` with `give`."""

    def __init__(self, frequency_hz: float, enable: bool, now: float) -> None:
        """Create a client. `enable` makes it upload the program with which the controller uses the force; the
        upload ends a running program.
        """
        self._frequency, self._enable = frequency_hz, enable
        self._reader = Reader()
        super().__init__()
        self._recipes: dict[tuple[str, ...], Recipe] = {}
        self._outputs: tuple[str, ...] = LOADED_OUTPUTS
        self._weight = NO_FORCE
        self._expected: Kind | None = Kind.VERSION
        self._due: float | None = now + PATIENCE_S
        self._lost = False
        self._put(packets.version_request())

    def receive(self, data: Pieces, now: float) -> None:
        for piece in data:
            if piece.port is not Port.RTDE or self._lost:
                continue
            self._reader.feed(piece.data)
            try:
                while (packet := self._reader.next_packet()) is not None:
                    self._process_packet(packet, now)
            except RemoteProtocolError as error:
                self._fail(f"it does not speak RTDE: {error}")

    def handle_deadline(self, now: float) -> None:
        if self._due is not None and now >= self._due:
            self._fail(f"nothing received for {PATIENCE_S:g} s", "check its cable and its power")

    def give(self, wrench: Wrench) -> None:
        """Send a contact wrench to the controller. Nothing is sent before the stream starts.

        The wrench is along the flange's axes and about the flange, N and N·m. The weight of the payload is added,
        because a sensor would measure it and the controller therefore subtracts it from an external force too.
        """
        if (recipe := self._recipes.get(INPUTS)) is not None:
            self._put(
                recipe.pack(*(contact + weight for contact, weight in zip(wrench, self._weight, strict=True)))
            )

    def farewell(self) -> Pieces:
        """Return the data that sets the contact wrench to zero. It must be sent before the connections are closed."""
        self._out = []
        self.give(NO_FORCE)
        return self.data_to_send(0.0)

    # --- packets

    def _put(self, packet: bytes) -> None:
        self._out.append(Piece(Port.RTDE, packet))

    def _process_packet(self, packet: Packet, now: float) -> None:
        if self._lost:
            return
        if packet.kind == Kind.DATA and self._expected is None:
            self._due = now + PATIENCE_S
            self._report_tool(packet.payload)
        elif packet.kind == self._expected:
            self._due = now + PATIENCE_S
            self._continue(packet)

    def _continue(self, packet: Packet) -> None:
        if packet.kind == Kind.OUTPUTS:
            if self._outputs is LOADED_OUTPUTS and NOT_FOUND in packets.read_types(packet.payload).types:
                self._outputs = OUTPUTS
                self._request(Kind.OUTPUTS, packets.outputs_request(OUTPUTS, self._frequency))
            elif self._set_recipe(self._outputs, packet.payload):
                self._request(Kind.INPUTS, packets.inputs_request(INPUTS))
        elif packet.kind == Kind.INPUTS:
            if self._set_recipe(INPUTS, packet.payload):
                self._request(Kind.START, packets.encode(Kind.START))
        elif not packets.read_accepted(packet.payload):
            self._fail("it refuses to speak version 2 of RTDE, or to start", "update its software")
        elif packet.kind == Kind.VERSION:
            self._request(Kind.OUTPUTS, packets.outputs_request(self._outputs, self._frequency))
        else:
            self._expected = None
            if self._enable:
                self._out.append(Piece(Port.SCRIPT, force_program_text(hold=False).encode()))

    def _request(self, kind: Kind, packet: bytes) -> None:
        self._expected = kind
        self._put(packet)

    def _set_recipe(self, names: tuple[str, ...], payload: bytes) -> bool:
        answer = packets.read_types(payload)
        if IN_USE in answer.types:
            self._fail(
                "another client holds external_force_torque",
                "close it (ur_rtde: create it with FLAG_NO_EXT_FT)",
            )
        elif NOT_FOUND in answer.types or not answer.recipe or answer.types != _TYPES[names]:
            self._fail(f"its software does not support all of {', '.join(names)}", "update it")
        else:
            self._recipes[names] = Recipe(answer.recipe, names, answer.types)
            return True
        return False

    def _report_tool(self, payload: bytes) -> None:
        values = self._recipes[self._outputs].unpack(payload)
        if not all(map(math.isfinite, values)):
            self._fail("it reports values that are not numbers", "check its log")
            return
        x, y, z = values[7:10]
        report = Seen(values[0], pose_of(values[1:7]), (x, y, z), pose_of(values[13:19]))
        if len(values) > 19:
            mass, *centre = values[19:]
            report = report._replace(payload=(mass, (centre[0], centre[1], centre[2])))
        self._weight = _weight(report)
        self._events.append(report)

    def _fail(self, fact: str, remedy: str = "") -> None:
        self._lost, self._due = True, None
        self._events.append(Lost(fact, remedy))


def _weight(report: Seen) -> Wrench:
    """Return the weight of the payload as a wrench along the flange's axes and about the flange, N and N·m."""
    mass, centre = report.payload
    down = rotate(inverse(report.pose.quaternion), (0.0, 0.0, -GRAVITY * mass))
    u, v, w = rotate(report.tip.quaternion, down)
    a, b, c = centre
    return u, v, w, b * w - c * v, c * u - a * w, a * v - b * u
