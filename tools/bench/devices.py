"""Both devices of a cell at the benchmark's end of real wires, answering at once, with the time of every answer.

The robot understands status, mode and move and is where it was sent in the same instant; what it touches is a spring.
One blocking thread plays both, so that nothing of an event loop is in the times.
"""

import os
import random
import select
import socket
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from protocol.can.frame import CanFrame
from protocol.devices.jr3 import can_gateway, uart_gateway
from protocol.devices.s3.adlp import Block, BlockFormat, Control, encode_block
from protocol.devices.s3.arap import FunctionCode, Move, MoveKind, Status, Telegram, position_words, response

START = (0.9, 0.0, 0.6)
"""Where the tool is at first, base frame, m."""
TOOL_DOWN_WORDS = (0, 16384, 0, 0)
SURFACE_M = 0.599
"""Height of the surface."""
STIFFNESS = 5000.0
"""N/m: the paper's sponge."""
FULL_SCALES = (115, 111, 185, 56, 52, 61)
"""Full scales as the gateway tells them, N and N·m×10. Source: ratings seen in the field."""
NODE = 1
PERIOD_MS = 2.0
"""Period of the sensor's stream while the robot stands still, and as the client asks for."""
PATIENCE_S = 20.0
"""Longest wait for the next byte of the other side, s: a Python program has to start."""
LOOK_MS = 200.0
"""How often it is looked whether the other side still runs, while nothing comes."""
FROM_PC = BlockFormat("off", ("whole",), 128)
_CAN_FRAME = struct.Struct("=IB3x8s")
"""struct can_frame. Source: Linux, linux/can.h."""


class PeerSilent(Exception):
    """The other side did not say what was awaited."""


class SensorPeer(Protocol):
    """The sensor's gateway on some wire."""

    @property
    def fd(self) -> int:
        """File descriptor from which commands come."""

    def commands(self) -> bool:
        """Read and answer what came; False when the wire has ended."""

    def send(self, counts: tuple[int, ...]) -> None:
        """Send one sample."""

    streaming: bool
    """The client has asked for samples."""
    zeroed: bool
    """The client has set the offsets, so that its checks of the sensor are over."""


@dataclass
class UartSensor:
    """A UART gateway on a byte wire."""

    fd: int
    streaming: bool = False
    zeroed: bool = False
    counter: int = 0
    _reader: uart_gateway.Reader = field(default_factory=lambda: uart_gateway.Reader(uart_gateway.COMMANDS))

    def commands(self) -> bool:
        """As in SensorPeer."""
        data = read_some(self.fd)
        self._reader.feed(data)
        while (frame := self._reader.next_frame()) is not None:
            scales = FULL_SCALES if frame.op is uart_gateway.Op.GET_FULL_SCALES else None
            os.write(self.fd, uart_gateway.encode_acknowledge(uart_gateway.Acknowledge(0, scales)))
            if frame.op in (uart_gateway.Op.START, uart_gateway.Op.STOP):
                self.streaming = frame.op is uart_gateway.Op.START
            self.zeroed |= frame.op is uart_gateway.Op.ZERO
        return bool(data)

    def send(self, counts: tuple[int, ...]) -> None:
        """As in SensorPeer."""
        self.counter = (self.counter + 16) & 0xFFFF
        os.write(self.fd, uart_gateway.encode_data(counts, self.counter))


@dataclass
class CanSensor:
    """A CAN gateway on a SocketCAN interface."""

    wire: socket.socket
    streaming: bool = False
    zeroed: bool = False
    counter: int = 0

    @classmethod
    def on(cls, interface: str) -> "CanSensor":
        """A gateway on this interface. Raises OSError where there is none."""
        wire = socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        wire.bind((interface,))
        return cls(wire)

    @property
    def fd(self) -> int:
        """As in SensorPeer."""
        return self.wire.fileno()

    def commands(self) -> bool:
        """As in SensorPeer."""
        op = can_gateway.Op
        identifier, size, data = _CAN_FRAME.unpack(self.wire.recv(_CAN_FRAME.size))
        command = can_gateway.decode_command(CanFrame(identifier, data[:size]))
        scales = {op.GET_FORCE_FULL_SCALES: FULL_SCALES[:3], op.GET_MOMENT_FULL_SCALES: FULL_SCALES[3:]}
        answer = can_gateway.Acknowledge(0, scales.get(command.op))
        self._put(can_gateway.encode_acknowledge(NODE, answer))
        if command.op in (op.START_ASYNC, op.STOP):
            self.streaming = command.op is op.START_ASYNC
        self.zeroed |= command.op is op.ZERO
        return True

    def send(self, counts: tuple[int, ...]) -> None:
        """As in SensorPeer."""
        self.counter = (self.counter + 16) & 0xFFFF
        for frame in can_gateway.encode_sample(NODE, counts, self.counter):
            self._put(frame)

    def _put(self, frame: CanFrame) -> None:
        self.wire.send(_CAN_FRAME.pack(frame.identifier, len(frame.data), frame.data.ljust(8, b"\0")))


@dataclass(frozen=True, slots=True)
class Turn:
    """One turnaround, s: from the write of a sensor sample, the end of the status answer right after it."""

    began: float
    """Begin, s on the monotonic clock."""
    bid: float
    """Until the bid for the next order, its first byte, was read."""
    order: float
    """Until the whole order was read; the acknowledge of the bid in between is at once."""
    cycle: float
    """Time from the turnaround before to this one."""


@dataclass
class Cell:
    """Robot and sensor until the other side has gone."""

    robot: int
    sensor: SensorPeer
    gone: Callable[[], bool]
    """Whether the other side has ended: not every wire tells."""
    moving: bool = False
    """From the first move behind the sensor's zero on samples come with the status answers alone, one each."""
    turns: list[Turn] = field(default_factory=list)
    _position: tuple[float, float, float] = START
    _noise: random.Random = field(default_factory=lambda: random.Random(1))
    _read_at: float = 0.0
    """When the robot's wire was read last."""
    _sample_due: float = 0.0
    """When the next sample that comes by itself is due."""

    def serve(self, enough: Callable[[int], bool]) -> None:
        """Answer until the wire ends. `enough` is asked after each turnaround with the number of them so far. Once it
        says so, nothing more is timed and samples come by themselves again.

        Raises PeerSilent when the other side falls silent.
        """
        timed, began, before = True, 0.0, 0.0
        try:
            self._expect(Control.ENQ)
            while True:
                bid = self._read_at
                self._write(Control.ACK)
                order = self._order()
                if began:
                    self.turns.append(Turn(began, bid - began, self._read_at - began, began - before))
                    before, began = began, 0.0
                    if enough(len(self.turns)):
                        timed = self.moving = False
                self._write(Control.ACK)
                self._expect(Control.EOT)
                answer = encode_block(self._answer(order, timed).encode())
                self._write(Control.ENQ)
                self._expect(Control.ACK)
                os.write(self.robot, answer)
                self._expect(Control.ACK)
                if self.moving and order.function == FunctionCode.READ_STATUS:
                    counts = self._counts()
                    began = time.perf_counter()
                    self.sensor.send(counts)
                self._write(Control.EOT)
                self._expect(Control.ENQ)
        except EOFError:
            return

    def _answer(self, order: Telegram, timed: bool) -> Telegram:
        if order.function == FunctionCode.READ_STATUS:
            words = position_words(self._position)
            return Status(words, TOOL_DOWN_WORDS, key_auto=True, operation=True).to_telegram()
        if order.function == FunctionCode.MOVE:
            move = Move.from_telegram(order)
            self.moving = timed and (self.moving or self.sensor.zeroed)
            if move.kind is not MoveKind.START:
                self._position = move.position
        return response(order)

    def _counts(self) -> tuple[int, ...]:
        """The next sample: the spring's force, and a count of noise on every axis."""
        force = STIFFNESS * max(0.0, SURFACE_M - self._position[2])
        pressed = (0, 0, -round(force * 16384 / FULL_SCALES[2]), 0, 0, 0)
        return tuple(count + self._noise.randint(-1, 1) for count in pressed)

    # --- bytes of the robot's wire

    def _write(self, control: Control) -> None:
        os.write(self.robot, bytes((control,)))

    def _expect(self, control: Control) -> None:
        data = self._read()
        if data != bytes((control,)):
            raise PeerSilent(f"the robot expected {control.name}, got {data.hex(' ').upper()}")

    def _order(self) -> Telegram:
        data = self._read()
        while not isinstance(found := FROM_PC.decode(data), Block):
            if found is not None:
                raise PeerSilent(f"the robot got a bad block: {found.text}")
            data += self._read()
        return Telegram.decode(found.telegram, from_robot=False)

    def _read(self) -> bytes:
        """Next bytes on the robot's wire; while nothing moves the sensor lives beside it.

        Raises EOFError at the wire's end.
        """
        poll = select.poll()
        poll.register(self.robot, select.POLLIN)
        if not self.moving:
            poll.register(self.sensor.fd, select.POLLIN)
        ends = time.perf_counter() + PATIENCE_S
        while time.perf_counter() < ends:
            if not self.moving and self.sensor.streaming and time.perf_counter() >= self._sample_due:
                self._sample_due = time.perf_counter() + PERIOD_MS / 1e3
                self.sensor.send(self._counts())
            fds = [fd for fd, _ in poll.poll(LOOK_MS if self.moving else PERIOD_MS)]
            if self.robot in fds:
                data = read_some(self.robot)
                self._read_at = time.perf_counter()
                if not data:
                    raise EOFError
                return data
            if self.sensor.fd in fds:
                if not self.sensor.commands():
                    poll.unregister(self.sensor.fd)
            elif self.gone():
                raise EOFError
        raise PeerSilent(f"nothing came from the other side within {PATIENCE_S:g} s")


def read_some(fd: int) -> bytes:
    """Bytes that are there; none at the end. A pseudo-terminal's end is an error to Linux."""
    try:
        return os.read(fd, 4096)
    except OSError:
        return b""
