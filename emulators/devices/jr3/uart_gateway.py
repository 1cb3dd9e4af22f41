"""Microcontroller between a JR3 sensor's serial link and a serial line.

It behaves as the firmware roboticslab-uc3m/jr3-mbed-firmware-usb, which was read for facts only. The firmware
misreads its input in characteristic ways, and a client has to cope with that. It reads all bytes at once, writes
them over the bytes of the previous read, and executes the first frame in the result. Then it sleeps for a second,
whatever the frame was.
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
"""Maximum number of bytes in one read. Source: firmware."""
_PAYLOAD_SIZE = 14
"""Maximum number of command bytes that fit the firmware's memory. Further bytes overrun it. Assumed: they are lost."""


@dataclass(frozen=True)
class UartGatewayProfile(FirmwareProfile):
    """Timing of a gateway."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    boot_s: float = setting(
        5.0, Mark.OBSERVED, "time without response after power-up", at_least(0.0), unit="s"
    )
    deaf_s: float = setting(
        1.0, Mark.OBSERVED, "time without reception after every read", at_least(0.0), unit="s"
    )
    kept_bytes: int = setting(
        0,
        Mark.ASSUMED,
        "bytes buffered during that time, which are read after it; 0: all are lost; 256 is the "
        "driver's default",
        between(0, 65536),
    )
    shortest_period_us: float = setting(
        DATA_FRAME_S * 1e6,
        Mark.DERIVED,
        "shortest period of the stream: a frame of 18 bytes at 115200 baud",
        above(0.0),
        unit="µs",
    )


class _State(Enum):
    BOOTING = "booting, received bytes are lost"
    BUSY = "executing a command that takes time"
    LISTENING = "waiting for bytes"
    DEAF = "asleep after a read"


class UartGateway(AnyGateway[bytes]):
    """Endpoint of the gateway. It receives and sends bytes and has no events."""

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
        """Command in progress. It is None while the gateway reads the calibration at power-up."""

    # --- endpoint

    def receive(self, data: bytes, now: float) -> None:
        """Receive bytes. Bytes that arrive while the gateway is not reading are buffered if there is room, or else
        lost.
        """
        self.handle_deadline(now)
        if not data:
            return
        if self._state is _State.LISTENING:
            self._read(data[:_READ_SIZE], now)
            data = data[_READ_SIZE:]
        if self._state is not _State.BOOTING:
            self._kept += data[: self._profile.kept_bytes - len(self._kept)]

    def data_to_send(self, now: float) -> bytes:
        """Return frames that are due."""
        data, self._out = bytes(self._out), bytearray()
        return data

    def next_deadline(self) -> float | None:
        """Return the end of the current action, or the time of the next frame or block of samples, s."""
        due = self._firmware.next_deadline()
        until = self._ends_at()
        return until if due is None else due if until is None else min(until, due)

    def handle_deadline(self, now: float) -> None:
        """Send every frame that is due up to and including now."""
        while (at := self._ends_at()) is not None and at <= now:
            self._send_due(at)
            self._enter_next_state(at)
        self._send_due(now)
        self._firmware.catch_up(now)

    # --- its states one after another

    def _ends_at(self) -> float | None:
        """Return the time at which the gateway enters the next state, s; None while it waits for bytes or for a
        sensor.
        """
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

    def _enter_next_state(self, at: float) -> None:
        """Enter the next state."""
        match self._state:
            case _State.BOOTING if self._firmware.plugged:
                self._begin(None, (Step.READ_CALIBRATION,), at)
                return
            case _State.BUSY:
                self._finish(at)
                return
            case _:  # after the sleep, or after the boot without a sensor
                self._listen(at)

    def _listen(self, at: float) -> None:
        self._state = _State.LISTENING
        if self._kept:
            data = bytes(self._kept[:_READ_SIZE])
            del self._kept[:_READ_SIZE]
            self._read(data, at)

    def _read(self, data: bytes, at: float) -> None:
        """Read once. The bytes overwrite those of earlier reads, and all bytes up to the first `>` are interpreted
        as a command.
        """
        self._enter(_State.DEAF, at + self._profile.deaf_s)
        self._read_over[: len(data)] = data
        text, closing, _ = self._read_over.partition(b">")
        if not closing:
            return  # the firmware then reads beyond the buffer. Assumed: this has no effect
        text = text.replace(b"<", b"")
        # Any character counts as a digit. Missing digits keep their values from the previous command.
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
        """Complete the command in progress if it has waited long enough. The gateway then sleeps for `deaf_s`."""
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
            case _:  # the steps have already executed it, or it requires only an acknowledgement
                pass
        self._acknowledge(command.op)
        self._enter(_State.DEAF, at + self._profile.deaf_s)

    def _acknowledge(self, op: Op) -> None:
        scales = self._firmware.full_scales if op is Op.GET_FULL_SCALES else None
        self._out += encode_acknowledge(Acknowledge(self._firmware.state, scales))

    def _send_due(self, now: float) -> None:
        for sample in self._firmware.due_samples(now):
            self._out += encode_data(sample.counts, sample.counter)
