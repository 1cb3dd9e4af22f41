"""Emulated SCHUNK FTS with IFB-EN: commands of several clients over TCP, and one stream of packets over UDP.

The stream goes to the client that has requested it most recently. The sensor is emulated from the end of its boot on;
a reset and a power cycle boot it again. Tare, tool setting and filter are properties of the sensor, not of a client.
"""

import math
from array import array
from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from emulators.faults.ledger import Handler, Injection
from emulators.faults.own import OwnFaults
from emulators.faults.packets import SENSOR_WIRE, StampedPackets
from emulators.seams import WrenchSource
from emulators.sensing import Converter, MeasuredWrench
from emulators.sensing.settings import per_axis, unrest
from emulators.unmodelled import Unmodelled
from hil_schunk.connection import Connection
from hil_schunk.messages import (
    COUNTERS,
    FILTERS,
    FIRMWARE,
    HARDWARE,
    INVALID,
    MECHANICAL,
    PACKET_IDS,
    PRODUCT_NAME,
    PRODUCT_NUMBER,
    RATE_HZ,
    READY,
    TOOLS,
    UNITS,
    USER,
    Answer,
    Command,
    ErrorCode,
    Packet,
    Parameter,
    decode_parameter,
    encode_answer,
    encode_packet,
    error_words,
)
from hil_schunk.profile import FtsProfile
from hil_schunk.running_mean import RunningMean
from protocol.datagram import Datagram
from protocol.endpoint import RemoteProtocolError
from protocol.geometry import Wrench

_MOST_AT_ONCE = 64
"""Maximum number of packets sent at once. Chosen: after a pause of the computer, more would overrun a reader."""
_CUTS = ("off", "mute", "deaf")
"""Faults of the wire that affect the commands too."""
_NOTHING: Wrench = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(slots=True)
class _Stream:
    """Active request for packets."""

    next: int
    """Number of the next sample to report."""
    owner: Connection


class FtsSensor:
    """Sensor and its box: an endpoint that sends datagrams, and `Connection`s. An `EmulatedSensor`."""

    def __init__(self, profile: FtsProfile, source: WrenchSource, powered_at: float, seed: int) -> None:
        self.profile = profile
        self._steps = np.array((*(profile.resolution_n,) * 3, *(profile.resolution_nm,) * 3))
        ratings = np.array((*profile.ratings_n, *profile.ratings_nm))
        ends = ratings * profile.overload_share / self._steps
        noise = np.array((*per_axis(profile.noise_n), *per_axis(profile.noise_nm))) / self._steps
        converter = Converter(
            np.diag(1.0 / self._steps),
            noise,
            -ends,
            ends,
            unrest=unrest(profile, powered_at),
            full_scale=ratings,
        )
        self._measured = MeasuredWrench(source, RATE_HZ, converter, seed, "cell.schunk_fts.noise_n")
        self._mean = RunningMean(self._measured)
        self.endpoint = StampedPackets(self, f"{seed} packets")
        """Sensor's end of the packets."""
        self.unmodelled = Unmodelled("schunk-fts")
        self.ready_at = self._warm_at = powered_at
        """Times from which the sensor answers, and from which it is ready, s."""
        self.on_change: Callable[[], object] = lambda: None
        """Callback after a command, which may have changed the stream."""
        self._connections: list[Connection] = []
        self._stream: _Stream | None = None
        self._out: list[bytes] = []
        self._offset: Wrench = _NOTHING
        """Tare, N and N·m."""
        self._tool = 0
        self._counter = self._packet_id = -1
        """Counters of the newest packet."""
        self._values: Wrench = _NOTHING
        """Newest measurement, without tare and tool setting."""
        self._sampled = array("q", bytes(8 * COUNTERS))
        """Number of the sample in the newest packet with each counter."""
        self._cuts: list[Injection] = []
        self._faults = OwnFaults()
        self.handlers: Mapping[str, Mapping[str, Handler]] = self._handlers()

    def _handlers(self) -> Mapping[str, Mapping[str, Handler]]:
        held = ("unplugged", "slow", "frozen-counter", "status", "saturated", "refusing", "short-answers")
        striking = {"power-cycle": self.power_down, "tared": self._tare, "taken": self._stop}
        return {
            "signal": self._measured.signal.handlers,
            SENSOR_WIRE: {**self.endpoint.handlers, **dict.fromkeys(_CUTS, Handler(self._cut))},
            "sensor": {**self._faults.held(held), **self._faults.striking(striking)},
        }

    # --- connections

    def connect(self, side: Hashable, now: float) -> Connection | None:
        """Return the end of a new connection, whose client receives packets at `side`. None if the sensor boots, or
        serves as many clients as it can.
        """
        if now < self.ready_at or len(self._connections) >= self.profile.clients:
            return None
        connection = Connection(self, side)
        self._connections.append(connection)
        return connection

    def leave(self, connection: Connection, now: float) -> None:
        """Handle the end of a connection."""
        self._send_due(now)
        if connection in self._connections:
            self._connections.remove(connection)
        if self.profile.stops_with_connection and self._stream and self._stream.owner is connection:
            self._stop(now)

    def is_cut(self, faults: Collection[str], now: float) -> bool:
        """Return whether one of these faults of the wire is active."""
        return any(cut.fault in faults and cut.holds(now) for cut in self._cuts)

    def cut_short(self, answer: bytes, length: int, now: float) -> bytes:
        """Return an answer, or its beginning while the sensor cuts answers off."""
        return answer if self._faults.under_way("short-answers", now) is None else answer[:length]

    def _cut(self, injection: Injection) -> None:
        self._cuts.append(injection)
        self.endpoint.begin(injection)

    # --- commands

    def answer(self, payload: bytes, connection: Connection, now: float) -> bytes:
        """Carry out a command and return the payload of its answer; empty for an empty command, which is ignored
        (assumed).
        """
        if not payload:
            return b""
        self._send_due(now)
        command, values = payload[0], payload[1:]
        if (refusing := self._faults.under_way("refusing", now)) is not None:
            return encode_answer(Answer(command, int(refusing.number("error"))))
        if command in (Command.READ, Command.WRITE):
            return self._answer_parameter(command, values)
        return encode_answer(Answer(command, self._carry_out(command, values, connection, now)))

    def _carry_out(self, command: int, values: bytes, connection: Connection, now: float) -> ErrorCode:
        match command:
            case Command.START:
                self._stream = _Stream(self._measured.first_after(now), connection)
            case Command.STOP:
                self._stop(now)
            case Command.TARE:
                self._tare(now)
            case Command.UNDO_TARE:
                self._offset = _NOTHING
            case Command.SELECT_TOOL if values and values[0] < TOOLS:
                self._tool = values[0]
            case Command.SELECT_FILTER if values and values[0] < len(FILTERS):
                self._mean.length = FILTERS[values[0]]
            case Command.SELECT_TOOL | Command.SELECT_FILTER:
                return ErrorCode.OUT_OF_RANGE
            case Command.RESET:
                self.power_down(now)
            case Command.UNKNOWN_10 | Command.UNKNOWN_11:
                self.unmodelled.touch(f"command {command:02X}", "answered as done, without effect")
            case _:
                return ErrorCode.UNKNOWN_COMMAND
        return ErrorCode.NONE

    def _answer_parameter(self, command: int, data: bytes) -> bytes:
        try:
            parameter, _ = decode_parameter(data)
        except RemoteProtocolError:
            return encode_answer(Answer(command, ErrorCode.OUT_OF_RANGE))
        known = {
            PRODUCT_NAME: self.profile.product_name.encode("ascii", "replace"),
            PRODUCT_NUMBER: self.profile.product_number.encode("ascii", "replace"),
            FIRMWARE: self.profile.firmware.encode(),
            UNITS: b"\0",
        }
        if command == Command.READ and parameter in known:
            return encode_answer(Answer(command, ErrorCode.NONE, known[parameter]), parameter)
        self._touch(command, parameter)
        return encode_answer(Answer(command, self.profile.parameter_error), parameter)

    def _touch(self, command: int, parameter: Parameter) -> None:
        name = f"{Command(command).label} of parameter {parameter.main:04X}.{parameter.sub:02X}"
        self.unmodelled.touch(name, f"answered with {error_words(self.profile.parameter_error)}")

    def power_down(self, now: float) -> None:
        """Restart the sensor, as after a loss of power. Its clients do not notice until they send."""
        self.ready_at = now + self.profile.boot_s
        self._warm_at = self.ready_at + self.profile.warm_up_s
        for connection in self._connections:
            connection.is_dead = True
        self._connections.clear()
        if not self.profile.tare_persistent:
            self._offset = _NOTHING
        self._tool, self._mean.length = 0, FILTERS[0]
        self._counter = self._packet_id = -1
        self._out.clear()
        self._stop(now)

    def _tare(self, now: float) -> None:
        self._send_due(now)
        number = self._measured.number_at(now - self.profile.latency_s)
        self._offset = self._read(number)

    def _stop(self, now: float) -> None:
        self._stream = None

    # --- endpoint of the packets

    def receive(self, data: Sequence[bytes], now: float) -> None:
        """Ignore datagrams: the sensor sends only."""

    def next_event(self) -> None:
        """Return None: there are no events."""

    def data_to_send(self, now: float) -> Sequence[bytes]:
        """Return the packets that are due."""
        out, self._out = self._out, []
        return out

    def next_deadline(self) -> float | None:
        """Return the time at which the next packet is due, s."""
        return None if self._stream is None else self._stream.next / RATE_HZ + self.profile.latency_s

    def last_deadline(self, until: float) -> float:
        """Return the time at which the last packet up to `until` is due, s; `until` if there is no stream."""
        if self._stream is None:
            return until
        newest = self._measured.number_at(until - self.profile.latency_s)
        return min(newest / RATE_HZ + self.profile.latency_s, until)

    def handle_deadline(self, now: float) -> None:
        """Send every packet that is due. Each has the time at which it was due."""
        self._send_due(now, _MOST_AT_ONCE)

    def sampled_at(self, counter: int) -> float | None:
        """Return the time at which the sample in the newest packet with this counter was measured, s."""
        return self._sampled[counter] / RATE_HZ or None

    # --- samples

    def _send_due(self, now: float, most: int = COUNTERS) -> None:
        newest = self._measured.number_at(now - self.profile.latency_s)
        while (stream := self._stream) is not None and stream.next <= newest and most:
            self._send(stream, min(stream.next / RATE_HZ + self.profile.latency_s, now))
            most -= 1

    def _send(self, stream: _Stream, now: float) -> None:
        number, step = stream.next, 1
        if self._faults.any:
            if not self._faults.holds("unplugged", now):
                self._values = self._read(number)
            if (slow := self._faults.under_way("slow", now)) is not None:
                step = max(1, round(slow.number("factor")))
        else:
            self._values = self._read(number)
        if self._counter < 0 or self._faults.under_way("frozen-counter", now) is None:
            self._counter = (self._counter + 1) % COUNTERS
        self._packet_id = (self._packet_id + 1) % PACKET_IDS
        self._sampled[self._counter] = number
        stream.next += step
        wrench = self._reported(self._values)
        packet = Packet(self._counter, self._packet_id, self._status(number, wrench, now), wrench)
        self._out.append(Datagram(encode_packet(packet), now, stream.owner.side))

    def _read(self, number: int) -> Wrench:
        """Measure a sample, N and N·m."""
        fx, fy, fz, mx, my, mz = self._mean.read(number)
        n, nm = self.profile.resolution_n, self.profile.resolution_nm
        return fx * n, fy * n, fz * n, mx * nm, my * nm, mz * nm

    def _reported(self, values: Wrench) -> Wrench:
        """Return a measurement after tare and tool setting. Assumed: in this order."""
        fx, fy, fz, mx, my, mz = (value - zero for value, zero in zip(values, self._offset, strict=True))
        x, y, z = (one / 1000.0 for one in self.profile.tool_points_mm[self._tool])
        return fx, fy, fz, mx - (y * fz - z * fy), my - (z * fx - x * fz), mz - (x * fy - y * fx)

    def _status(self, number: int, wrench: Wrench, now: float) -> int:
        """Return the status that is sent with a sample."""
        if now < self._warm_at:
            return INVALID
        status, faults = READY, self._faults
        is_clipped = self._measured.last_at_end(number - self._mean.length + 1, number) is not None
        if is_clipped or (faults.any and faults.under_way("saturated", now)):
            status = MECHANICAL if self.profile.overload_clears_ready else status | MECHANICAL
        if self._exceeds_limits(wrench):
            status |= USER
        if not faults.any:
            return status
        if faults.under_way("unplugged", now):
            return HARDWARE | INVALID
        if (fault := faults.under_way("status", now)) is not None:
            bit = 1 << int(fault.number("bit"))
            status = status & ~READY if bit == READY else status | bit
        return status

    def _exceeds_limits(self, wrench: Wrench) -> bool:
        """Return whether the load is beyond the limits of the tool setting. Assumed: those of the magnitudes."""
        limits = self.profile.tool_limits_n[self._tool], self.profile.tool_limits_nm[self._tool]
        loads = math.hypot(*wrench[:3]), math.hypot(*wrench[3:])
        return any(limit and load > limit for load, limit in zip(loads, limits, strict=True))
