"""A microcontroller between a JR3 sensor's serial link and a serial line.

Behaves as the firmware roboticslab-uc3m/jr3-mbed-firmware-usb does, which was read for facts only. It misreads its
input in its own ways, and a client has to live with that. It reads all bytes in one go, lays them over those of the
read before, takes the first frame in it and sleeps for a second, whatever that frame was.
"""

import math
from dataclasses import dataclass
from enum import Enum
from typing import Any, ClassVar

from emulators.devices.jr3.firmware import Step
from emulators.devices.jr3.firmware_profile import FirmwareProfile
from emulators.devices.jr3.gateway import AnyGateway
from emulators.devices.jr3.sensor import Jr3Sensor
from emulators.faults.packets import BYTES, Packets
from protocol.devices.jr3.uart_gateway import (
    DATA_FRAME_S,
    Acknowledge,
    Command,
    Frame,
    Op,
    decode_command,
    encode_acknowledge,
    encode_data,
)
from protocol.endpoint import RemoteProtocolError
from protocol.marks import Mark, above, at_least, between, setting

_READ_SIZE = 32
"""Bytes that one read takes at most. Source: firmware."""
_PAYLOAD_SIZE = 14
"""Bytes of a command that the firmware has room for; it overruns its memory by more. Assumed: they are lost."""


@dataclass(frozen=True)
class UartGatewayProfile(FirmwareProfile):
    """How a gateway behaves in time."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    boot_s: float = setting(5.0, Mark.OBSERVED, "deaf and silent after power-up", at_least(0.0), unit="s")
    deaf_s: float = setting(1.0, Mark.OBSERVED, "deaf after every read", at_least(0.0), unit="s")
    kept_bytes: int = setting(
        0,
        Mark.ASSUMED,
        "bytes that wait while it is deaf, to be read after it; 0 loses them all, 256 is its driver's default",
        between(0, 65536),
    )
    shortest_period_us: float = setting(
        DATA_FRAME_S * 1e6,
        Mark.DERIVED,
        "shortest period of the stream, that is a frame of 18 bytes at 115200 baud",
        above(0.0),
        unit="µs",
    )


class _State(Enum):
    BOOTING = "deaf, what arrives is lost"
    BUSY = "carrying out a command that takes time"
    LISTENING = "waiting for bytes"
    DEAF = "asleep after a read"


class UartGateway(AnyGateway[bytes]):
    """Endpoint of the gateway: takes and gives bytes, tells no events."""

    def __init__(
        self, profile: UartGatewayProfile, sensor: Jr3Sensor, powered_at: float, seed: int = 0
    ) -> None:
        super().__init__(profile, sensor, seed)
        self.endpoint = Packets(self, BYTES, f"{seed} frames")
        self._profile = profile
        self._out = bytearray()
        self._kept = bytearray()
        self._read_over = bytearray(_READ_SIZE)
        self._op = 0
        self._state = _State.BOOTING
        self._until = powered_at + profile.boot_s
        self._under_way: Command | None = None
        """The command that takes time; None of it for the calibration read at power-up."""

    # --- endpoint

    def receive(self, data: bytes, now: float) -> None:
        """Take bytes; what arrives while it is deaf is lost, or waits as far as there is room."""
        self.handle_deadline(now)
        if not data:
            return
        if self._state is _State.LISTENING:
            self._read(data[:_READ_SIZE], now)
            data = data[_READ_SIZE:]
        if self._state is not _State.BOOTING:
            self._kept += data[: self._profile.kept_bytes - len(self._kept)]

    def data_to_send(self, now: float) -> bytes:
        """Frames whose time has come."""
        data, self._out = bytes(self._out), bytearray()
        return data

    def next_deadline(self) -> float | None:
        """Return the end of the present action, or the time of the next frame or block of samples."""
        due = self._firmware.next_deadline()
        until = self._ends_at()
        return until if due is None else due if until is None else min(until, due)

    def handle_deadline(self, now: float) -> None:
        """Emit every frame that is due up to and including now."""
        while (at := self._ends_at()) is not None and at <= now:
            self._send_due(at)
            self._go_on(at)
        self._send_due(now)
        self._firmware.catch_up(now)

    # --- its states one after another

    def _ends_at(self) -> float | None:
        """When it continues with the next state, s; None while it waits for bytes, or for a sensor."""
        match self._state:
            case _State.LISTENING:
                return None
            case _State.BUSY:
                until = self._firmware.busy_until
                return until if until < math.inf else None
            case _:
                return self._until

    def _enter(self, state: _State, until: float) -> None:
        self._state, self._until = state, until

    def _go_on(self, at: float) -> None:
        """Begin the next state."""
        match self._state:
            case _State.BOOTING if self._firmware.plugged:
                self._begin(None, (Step.READ_CALIBRATION,), at)
                return
            case _State.BUSY:
                self._finish(at)
                return
            case _:  # awake, or never to have a sensor
                self._listen(at)

    def _listen(self, at: float) -> None:
        self._state = _State.LISTENING
        if self._kept:
            data = bytes(self._kept[:_READ_SIZE])
            del self._kept[:_READ_SIZE]
            self._read(data, at)

    def _read(self, data: bytes, at: float) -> None:
        """One read: the bytes lie over those of earlier reads, and all up to the first `>` is taken for a command."""
        self._enter(_State.DEAF, at + self._profile.deaf_s)
        self._read_over[: len(data)] = data
        text, closing, _ = self._read_over.partition(b">")
        if not closing:
            return  # it reads on through its memory. Assumed: nothing comes of that
        text = text.replace(b"<", b"")
        # Any character counts as a digit, and digits that are not there are those of the command before.
        zero = ord("0")
        if text:
            self._op = (text[0] - zero) * 10
        if len(text) > 1:
            self._op += text[1] - zero
        try:
            command = decode_command(self._op, bytes(text[2 : 2 + _PAYLOAD_SIZE]))
        except RemoteProtocolError:
            return
        self._on_command(command, at)

    def _on_command(self, command: Command, now: float) -> None:
        steps = self.steps_of(command.op.name)
        if steps is None:
            self._acknowledge(command.op)
            return
        self._begin(command, steps, now)

    def _begin(self, command: Command | None, steps: tuple[Step, ...], now: float) -> None:
        self._under_way = command
        self._firmware.begin(steps, now)
        self._enter(_State.BUSY, now)
        self._finish(now)

    def _finish(self, now: float) -> None:
        """Carry out what is under way, if it has waited long enough; the deaf second begins behind it."""
        at = self._firmware.finish(now)
        if at is None:
            return
        command = self._under_way
        if command is None:
            self._out += bytes(Frame(Op.BOOT_UP))
            self._listen(at)
            return
        match command.op:
            case Op.START:
                self._firmware.start_stream(command.cutoff_centihertz, command.period_us, at)
                self._send_due(at)
            case Op.ZERO:
                self._firmware.zero(at)
            case Op.SET_FILTER:
                self._firmware.set_filter(command.cutoff_centihertz, at)
            case _:  # the steps have done it all, or the queries only want the acknowledge
                pass
        self._acknowledge(command.op)
        self._enter(_State.DEAF, at + self._profile.deaf_s)

    def _acknowledge(self, op: Op) -> None:
        scales = self._firmware.full_scales if op is Op.GET_FULL_SCALES else None
        self._out += encode_acknowledge(Acknowledge(self._firmware.state, scales))

    def _send_due(self, now: float) -> None:
        for sample in self._firmware.due_samples(now):
            self._out += encode_data(sample.counts, sample.counter)
