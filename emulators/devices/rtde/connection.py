"""Connection to the RTDE port of the emulated controller, as an endpoint of bytes."""

import math
from collections.abc import Callable

from emulators.devices.rtde.controller import Controller
from emulators.devices.rtde.disturbance import Disturbance
from emulators.devices.rtde.state import Snapshot, getter, not_modelled
from emulators.orders import Act
from protocol.devices.rtde import packets
from protocol.devices.rtde.fields import IN_USE, INPUTS, NOT_FOUND, OUTPUTS, Recipe, type_of
from protocol.devices.rtde.packets import Kind, Level, Packet, Reader, Text, Types
from protocol.endpoint import LocalProtocolError, RemoteProtocolError

_RECIPES_MAX = 255
_SOURCE = "RTDE"
UNREAD_S = 10.0
"""Time after which a client that does not read is dropped, s. Source: RTDE_Python_Client_Library, issue 6."""


def has_room() -> bool:
    """Return True: a wire that accepts all data is never full."""
    return False


class Connection:
    """Connection of a client. `closing` states whether it is about to be closed."""

    def __init__(self, controller: Controller, disturbance: Disturbance, now: float) -> None:
        self._controller, self._disturbance = controller, disturbance
        self._reader = Reader()
        self._out: list[bytes] = []
        self._outputs: Recipe | None = None
        self._getters: list[Callable[[Snapshot], tuple[float, ...]]] = []
        self._every = 1
        """Number of cycles between two data packages."""
        self._started = False
        self._due = 0
        """Number of the next cycle in which data is sent."""
        self._version = packets.FIRST_VERSION
        """Protocol version in use. The client may request another."""
        self._inputs: dict[int, Recipe] = {}
        self._claimed: set[str] = set()
        self.closing = False
        self.is_full: Callable[[], bool] = has_room
        """Whether the wire still holds data that the client has not read."""
        self._unread_since: float | None = None
        """Time from which the wire has been full in every cycle of the stream, s."""
        disturbance.connections.append(self)

    # --- as an endpoint

    def receive(self, data: bytes, now: float) -> None:
        self._controller.advance(now)
        self._reader.feed(data)
        while not self.closing:
            try:
                packet = self._reader.next_packet()
                if packet is None:
                    return
                self._take(packet)
            except RemoteProtocolError as error:
                self._complain(str(error), Level.ERROR)
                self.closing = True

    def next_event(self) -> None:
        return None

    def data_to_send(self, now: float) -> bytes:
        out, self._out = self._out, []
        return b"".join(out)

    def next_deadline(self) -> float | None:
        return self._controller.path.cycle_at(self._due) if self._sends else None

    def handle_deadline(self, now: float) -> None:
        """Send the data of the newest cycle that is due, with the state in that cycle. Earlier cycles are skipped
        if this process is late.
        """
        path = self._controller.path
        newest = path.newest_by(now)
        cycle = newest - newest % self._every
        if self._sends and self._due <= cycle:
            self._controller.advance(path.cycle_at(cycle))
            if self._is_read(now):
                self._out.append(self._data())
            self._due = self._next(cycle)
        self._controller.advance(now)

    def close(self, now: float) -> None:
        """End the connection. Its inputs are released at once or after a delay."""
        self._started = False
        self._disturbance.connections.remove(self)
        controller, names = self._controller, self._claimed
        self._claimed = set()

        def free() -> None:
            for name in names:
                if controller.io.claims.get(name) is self:
                    del controller.io.claims[name]

        delay = controller.profile.release_delay_s
        if delay:
            controller.timers.add(controller.now + delay, free)
        else:
            free()

    # --- data

    @property
    def _sends(self) -> bool:
        return self._started and not self.closing

    def _is_read(self, now: float) -> bool:
        """Return whether the client reads its stream. A client that does not read receives no data, and is later
        dropped.
        """
        if not self.is_full():
            self._unread_since = None
            return True
        if self._unread_since is None:
            self._unread_since = now
        elif now - self._unread_since > UNREAD_S:
            self._controller.counts["clients dropped, not reading"] += 1
            self.closing = True
        return False

    def _next(self, cycle: int) -> int:
        """Return the number of the next cycle in which data is sent."""
        return cycle - cycle % self._every + self._every

    def _data(self) -> bytes:
        assert self._outputs is not None, "it has started"
        snapshot = self._disturbance.reported(self._controller.snapshots[0])
        values: list[float] = []
        for read in self._getters:
            values += read(snapshot)
        data = self._outputs.pack(*values)
        return packets.without_recipe(data) if self._version == packets.FIRST_VERSION else data

    # --- packets

    def _take(self, packet: Packet) -> None:
        match packet.kind:
            case Kind.DATA:
                self._take_data(packet.payload)
            case Kind.VERSION:
                version = packets.read_version_request(packet.payload)
                known = version in (packets.FIRST_VERSION, packets.PROTOCOL_VERSION)
                if known:
                    self._version = version
                else:
                    self._controller.report_order(Act.REFUSED, f"version {version} of the protocol", False)
                self._out.append(packets.accepted(Kind.VERSION, known))
            case Kind.CONTROLLER_VERSION:
                self._out.append(packets.controller_version(self._controller.version))
            case Kind.OUTPUTS:
                self._take_outputs(packet.payload)
            case Kind.INPUTS:
                self._take_inputs(packet.payload)
            case Kind.START:
                self._start()
            case Kind.PAUSE:
                self._started = False
                self._out.append(packets.accepted(Kind.PAUSE, True))
            case Kind.TEXT:
                self._controller.counts["texts"] += 1
            case _:
                self._complain(f"unknown type of packet {packet.kind}", Level.ERROR)

    def _complain(self, text: str, level: Level) -> None:
        """Send an error message to a client that receives data. A client that waits for an answer would mistake the
        message for the answer.
        """
        self._controller.counts["bad packets"] += 1
        self._controller.report_order(Act.UNREADABLE, text, False)
        if self._started:
            self._out.append(packets.text(Text(text, _SOURCE, level), self._version))

    def _start(self) -> None:
        if self._outputs is not None and not self._started:
            self._started = True
            self._due = self._next(self._controller.path.cycle)
        self._out.append(packets.accepted(Kind.START, self._outputs is not None))

    def _take_outputs(self, payload: bytes) -> None:
        frequency, names = packets.read_outputs_request(payload, self._version)
        controller = self._controller
        types = tuple(type_of(OUTPUTS, name, controller.version) for name in names)
        if not names or len(payload) - 8 > packets.NAMES_MAX:
            types = (NOT_FOUND,)
        self._report_missing(names, types)
        complete = NOT_FOUND not in types
        if complete:
            recipe = Recipe(1, names, types)
            if recipe.size + packets.HEADER.size > 0xFFFF:
                complete, types = False, (NOT_FOUND,)
            else:
                self._outputs, self._getters = recipe, [getter(name) for name in names]
                self._tag(names)
                rate = 1.0 / controller.period
                requested = frequency if math.isfinite(frequency) else rate
                self._every = max(1, math.floor(rate / min(max(requested, 1.0), rate) + 1e-6))
        self._out.append(packets.types_answer(Kind.OUTPUTS, Types(int(complete), types), self._version))

    def _take_inputs(self, payload: bytes) -> None:
        names, controller = packets.split_names(payload), self._controller
        types = tuple(self._input_type(name) for name in names)
        if not names or len(payload) > packets.NAMES_MAX:
            types = (NOT_FOUND,)
        self._report_missing(names, types)
        number = 0
        if not {NOT_FOUND, IN_USE} & set(types) and len(self._inputs) < _RECIPES_MAX:
            number = len(self._inputs) + 1
            self._inputs[number] = Recipe(number, names, types)
            self._claimed.update(names)
            self._tag(names)
            controller.io.claims.update(dict.fromkeys(names, self))
        self._out.append(packets.types_answer(Kind.INPUTS, Types(number, types)))

    def _report_missing(self, names: tuple[str, ...], types: tuple[str, ...]) -> None:
        """Report the variables that this controller does not have."""
        if missing := [name for name, kind in zip(names, types, strict=False) if kind == NOT_FOUND]:
            self._controller.report_order(Act.REFUSED, f"variable {missing[0]}", False)

    def _tag(self, names: tuple[str, ...]) -> None:
        """Report the variables of a recipe that the emulator does not model."""
        for name in names:
            if detail := not_modelled(name):
                self._controller.unmodelled.touch(f"variable {name}", detail)

    def _input_type(self, name: str) -> str:
        kind = type_of(INPUTS, name, self._controller.version)
        holder = self._controller.io.claims.get(name, self)
        if kind == NOT_FOUND:
            return kind
        return kind if holder is self and not self._disturbance.in_use(name) else IN_USE

    def _take_data(self, payload: bytes) -> None:
        recipe = self._inputs.get(payload[0]) if payload else None
        if recipe is None or len(payload) != recipe.size:
            self._controller.counts["bad inputs"] += 1
            self._controller.report_order(Act.UNREADABLE, "an input package that matches no recipe", False)
            self.closing = self._controller.profile.bad_input == "close"
            return
        try:
            values = recipe.values(recipe.unpack(payload))
        except (RemoteProtocolError, LocalProtocolError):
            self._controller.counts["bad inputs"] += 1
            return
        self._controller.write_inputs(recipe.names, values)
