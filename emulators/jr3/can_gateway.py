"""A microcontroller between a JR3 sensor's serial link and CAN.

Behaves as the firmware roboticslab-uc3m/jr3-mbed-firmware-can does, which was read for facts only.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

from emulators.faults.ledger import Handler
from emulators.faults.wire import FRAMES, FaultyWire
from emulators.jr3.firmware import Firmware
from emulators.jr3.late import Sample
from emulators.jr3.sensor import Jr3Sensor
from emulators.quantiles import check_quantiles
from protocol.can.frame import CanFrame
from protocol.endpoint import RemoteProtocolError
from protocol.jr3 import (
    Acknowledge,
    Command,
    Op,
    decode_command,
    encode_acknowledge,
    encode_sample,
    identifier,
)
from protocol.marks import Mark, check_settings, setting

_QUEUE = 32
"""Commands that the gateway keeps while it reads the calibration; more are lost. Source: firmware."""


@dataclass(frozen=True)
class GatewayProfile:
    """Times of a gateway."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    node: int = setting(1, Mark.OBSERVED, "node number", minimum=1, maximum=127)
    boot_s: float = setting(2.0, Mark.OBSERVED, "deaf and silent after power-up", unit="s", minimum=0.0)
    calibration_s: float = setting(
        0.033, Mark.DERIVED, "reading the calibration: 256 bytes, one per sample", unit="s", minimum=0.0
    )
    sample_period_us: float = setting(
        128.5, Mark.OBSERVED, "between samples taken from the sensor", unit="µs", above=0.0
    )
    shortest_period_us: float = setting(
        260.0,
        Mark.DERIVED,
        "shortest period of the stream, that is two frames of 8 bytes at 1 Mbit/s",
        unit="µs",
        above=0.0,
    )
    delay_ms: tuple[float, ...] = setting(
        (),
        Mark.CHOSEN,
        "measured delay of the stream's frames above the least, as evenly spaced quantiles, least first and largest "
        "last; empty: none",
        unit="ms",
        minimum=0.0,
    )

    def __post_init__(self) -> None:
        check_settings(self)
        check_quantiles(self, "delay_ms")


class Gateway:
    """Endpoint of the gateway: takes and gives sequences of CAN frames, tells no events."""

    def __init__(self, profile: GatewayProfile, sensor: Jr3Sensor, powered_at: float, seed: int = 0) -> None:
        self.jr3 = sensor
        """The sensor behind it."""
        self._profile = profile
        self._firmware = Firmware(
            sensor, profile.sample_period_us, profile.shortest_period_us, profile.delay_ms, seed
        )
        self._hears_from = powered_at + profile.boot_s
        self._wire: FaultyWire[Sequence[CanFrame]] = FaultyWire(FRAMES, f"{seed} frames")
        self._out: list[CanFrame] = []
        self._waiting: deque[Command] = deque()
        connected = sensor.profile.connected
        self._busy_with: Op | None = Op.BOOT_UP if connected else None
        self._busy_until = self._hears_from + profile.calibration_s

    @property
    def handlers(self) -> Mapping[str, Mapping[str, Handler]]:
        """Faults of the receiver and the sensor, by target, for a ledger."""
        own = self._firmware.handlers
        return {
            **own,
            "frames": {**self._wire.handlers, **own["frames"]},
            "signal": self.jr3.signal.handlers,
        }

    @property
    def endpoint(self) -> Self:
        """The gateway itself is the end of its wire."""
        return self

    # --- endpoint

    def receive(self, data: Sequence[CanFrame], now: float) -> None:
        """Take frames; those of other nodes, unknown ops and anything during boot get no answer."""
        if self._wire.bad:
            data = self._wire.incoming(data, now)
        self.handle_deadline(now)
        self._take(data, now)

    def _take(self, data: Sequence[CanFrame], now: float) -> None:
        """Take frames that have come through the wire."""
        if now < self._hears_from:
            return
        for frame in data:
            if frame.extended or frame.remote or frame.error:
                continue
            try:
                command = decode_command(frame)
            except RemoteProtocolError:
                continue
            if command.op is Op.SYNC:
                self._on_sync(now)
            elif command.node != self._profile.node:
                continue
            elif self._busy_with is None:
                self._on_command(command, now)
            elif len(self._waiting) < _QUEUE:
                self._waiting.append(command)

    def next_event(self) -> None:
        """A gateway tells nothing."""

    def data_to_send(self, now: float) -> Sequence[CanFrame]:
        """Frames whose time has come."""
        frames, self._out = self._out, []
        return self._wire.outgoing(frames, now) if self._wire.bad else frames

    def next_deadline(self) -> float | None:
        """End of reading the calibration, the next frame of the stream, or the next block of samples."""
        due = self._firmware.next_deadline()
        if self._busy_with is not None:
            due = self._busy_until if due is None else min(due, self._busy_until)
        return self._wire.next_deadline(due) if self._wire.bad else due

    def handle_deadline(self, now: float) -> None:
        """Emit every frame that is due up to and including now."""
        if self._wire.bad and (frames := self._wire.arrived(now)):
            self._take(frames, now)
        if self._busy_with is not None and now >= self._busy_until:
            self._on_calibration_read(self._busy_with)
        self._send_due(now)
        self._firmware.catch_up(now)

    def sampled_at(self, counter: int) -> float | None:
        """The truth: when the sensor measured the newest sample sent with this counter, s; None if there is none."""
        return self._firmware.sampled_at(counter)

    # --- commands

    def _on_command(self, command: Command, now: float) -> None:
        firmware = self._firmware
        if not firmware.initialised:
            self._acknowledge(command.op)
            return
        match command.op:
            case Op.START_SYNC:
                firmware.start(command.cutoff_centihertz, now)
            case Op.START_ASYNC:
                firmware.start_stream(command.cutoff_centihertz, command.period_us, now)
                self._send_due(now)
            case Op.STOP:
                firmware.stop()
            case Op.ZERO:
                firmware.zero(now)
            case Op.SET_FILTER:
                firmware.set_filter(command.cutoff_centihertz, now)
            case Op.RESET:
                firmware.reset()
                self._busy_with, self._busy_until = Op.RESET, now + self._profile.calibration_s
                return
            case _:  # the queries only want the acknowledge
                pass
        self._acknowledge(command.op)

    def _on_sync(self, now: float) -> None:
        if (sample := self._firmware.sample(now)) is not None:
            self._send(sample)

    def _on_calibration_read(self, why: Op) -> None:
        self._busy_with, self._firmware.initialised = None, True
        if why is Op.BOOT_UP:
            self._out.append(CanFrame(identifier(Op.BOOT_UP, self._profile.node)))
        else:
            self._acknowledge(why)
        at = self._busy_until
        while self._waiting and self._busy_with is None:
            self._on_command(self._waiting.popleft(), at)

    def _acknowledge(self, op: Op) -> None:
        words = None
        if op in (Op.GET_FORCE_FULL_SCALES, Op.GET_MOMENT_FULL_SCALES):
            fx, fy, fz, mx, my, mz = self._firmware.full_scales
            words = (fx, fy, fz) if op is Op.GET_FORCE_FULL_SCALES else (mx, my, mz)
        self._out.append(encode_acknowledge(self._profile.node, Acknowledge(self._firmware.state, words)))

    def _send_due(self, now: float) -> None:
        for sample in self._firmware.due_samples(now):
            self._send(sample)

    def _send(self, sample: Sample) -> None:
        self._out.extend(encode_sample(self._profile.node, sample.counts, sample.counter))
