"""The client that gives a controller its external force: it reads the pose, and writes `external_force_torque`.

Source: Universal Robots' guides and its C++ client library, which has an example for exactly this.
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
"""The same of a controller from 5.5.1 on."""
INPUTS = ("external_force_torque",)
_TYPES = {
    OUTPUTS: ("DOUBLE", *("VECTOR6D",) * 3),
    LOADED_OUTPUTS: ("DOUBLE", *("VECTOR6D",) * 3, "DOUBLE", "VECTOR3D"),
    INPUTS: ("VECTOR6D",),
}
PATIENCE_S = 1.0
"""How long the controller may be silent. Source: the time-out of UR's own Python client."""
NO_FORCE: Wrench = (0.0,) * 6
GRAVITY = 9.82
"""By which a controller computes the weight of its payload, m/s². Observed: 1 kg is 9.82 N in Universal Robots' forum,
thread 2053."""


class Seen(NamedTuple):
    """The tool as the controller reports it."""

    stamp: float
    """By the controller's clock, s."""
    pose: Pose
    """In the base frame, m."""
    velocity: Vector
    """Along the base axes, m/s."""
    tip: Pose
    """The tool in the flange."""
    payload: tuple[float, Vector] = (0.0, (0.0, 0.0, 0.0))
    """Mass, kg, and its centre in the flange, m, as they are set; zeros before 5.5.1, which does not report them."""


class Lost(NamedTuple):
    """The connection is of no use any more."""

    text: str
    """The reason."""
    remedy: str = ""
    """Advice for an operator; empty where none is known."""


Event: TypeAlias = Seen | Lost


class ForceClient(Mailbox[Piece, Event]):
    """An endpoint of pieces. Each `Seen` is answered with `give`."""

    def __init__(self, frequency_hz: float, enable: bool, now: float) -> None:
        """`enable` uploads the program that lets the controller take the force; it ends a program that plays."""
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
                    self._take(packet, now)
            except RemoteProtocolError as error:
                self._lose(f"it speaks no RTDE: {error}")

    def handle_deadline(self, now: float) -> None:
        if self._due is not None and now >= self._due:
            self._lose(f"nothing came for {PATIENCE_S:g} s", "look at its cable, and whether it is powered")

    def give(self, wrench: Wrench) -> None:
        """Tell the controller this wrench of a contact; nothing before it streams.

        Along the flange's axes and about the flange, N and N·m. The weight of the payload is added, as a sensor would
        measure it: the controller takes it off an external force too.
        """
        if (recipe := self._recipes.get(INPUTS)) is not None:
            self._put(
                recipe.pack(*(contact + weight for contact, weight in zip(wrench, self._weight, strict=True)))
            )

    def farewell(self) -> Pieces:
        """Pieces that take the contact away, to be sent before the wires are closed."""
        self._out = []
        self.give(NO_FORCE)
        return self.data_to_send(0.0)

    # --- packets

    def _put(self, packet: bytes) -> None:
        self._out.append(Piece(Port.RTDE, packet))

    def _take(self, packet: Packet, now: float) -> None:
        if self._lost:
            return
        if packet.kind == Kind.DATA and self._expected is None:
            self._due = now + PATIENCE_S
            self._see(packet.payload)
        elif packet.kind == self._expected:
            self._due = now + PATIENCE_S
            self._go_on(packet)

    def _go_on(self, packet: Packet) -> None:
        if packet.kind == Kind.OUTPUTS:
            if self._outputs is LOADED_OUTPUTS and NOT_FOUND in packets.read_types(packet.payload).types:
                self._outputs = OUTPUTS
                self._ask(Kind.OUTPUTS, packets.outputs_request(OUTPUTS, self._frequency))
            elif self._agree(self._outputs, packet.payload):
                self._ask(Kind.INPUTS, packets.inputs_request(INPUTS))
        elif packet.kind == Kind.INPUTS:
            if self._agree(INPUTS, packet.payload):
                self._ask(Kind.START, packets.encode(Kind.START))
        elif not packets.read_accepted(packet.payload):
            self._lose("it refuses to speak version 2 of RTDE, or to start", "update its software")
        elif packet.kind == Kind.VERSION:
            self._ask(Kind.OUTPUTS, packets.outputs_request(self._outputs, self._frequency))
        else:
            self._expected = None
            if self._enable:
                self._out.append(Piece(Port.SCRIPT, force_program_text(hold=False).encode()))

    def _ask(self, kind: Kind, packet: bytes) -> None:
        self._expected = kind
        self._put(packet)

    def _agree(self, names: tuple[str, ...], payload: bytes) -> bool:
        answer = packets.read_types(payload)
        if IN_USE in answer.types:
            self._lose(
                "another client holds external_force_torque",
                "close it (ur_rtde: make it with FLAG_NO_EXT_FT)",
            )
        elif NOT_FOUND in answer.types or not answer.recipe or answer.types != _TYPES[names]:
            self._lose(f"its software has not all of {', '.join(names)}", "update it")
        else:
            self._recipes[names] = Recipe(answer.recipe, names, answer.types)
            return True
        return False

    def _see(self, payload: bytes) -> None:
        values = self._recipes[self._outputs].unpack(payload)
        if not all(map(math.isfinite, values)):
            self._lose("it reports values that are not numbers", "see its log")
            return
        x, y, z = values[7:10]
        seen = Seen(values[0], pose_of(values[1:7]), (x, y, z), pose_of(values[13:19]))
        if len(values) > 19:
            mass, *centre = values[19:]
            seen = seen._replace(payload=(mass, (centre[0], centre[1], centre[2])))
        self._weight = _weight(seen)
        self._events.append(seen)

    def _lose(self, fact: str, remedy: str = "") -> None:
        self._lost, self._due = True, None
        self._events.append(Lost(fact, remedy))


def _weight(seen: Seen) -> Wrench:
    """Of the payload, along the flange's axes and about the flange."""
    mass, centre = seen.payload
    down = rotate(inverse(seen.pose.quaternion), (0.0, 0.0, -GRAVITY * mass))
    u, v, w = rotate(seen.tip.quaternion, down)
    a, b, c = centre
    return u, v, w, b * w - c * v, c * u - a * w, a * v - b * u
