"""A microcontroller between a JR3 sensor's serial link and CAN.

Behaves as the firmware roboticslab-uc3m/jr3-mbed-firmware-can does, which was read for facts only. Its main program
looks for a SYNC, then for commands, then sleeps; an interrupt takes what the bus brings meanwhile.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from emulators.devices.jr3.firmware import Step
from emulators.devices.jr3.firmware_profile import FirmwareProfile
from emulators.devices.jr3.gateway import AnyGateway
from emulators.devices.jr3.late import Sample
from emulators.devices.jr3.sensor import Jr3Sensor
from emulators.faults.packets import FRAMES, Packets
from protocol.can.frame import CanFrame
from protocol.devices.jr3 import (
    Acknowledge,
    Command,
    Op,
    decode_command,
    encode_acknowledge,
    encode_sample,
    identifier,
    split,
)
from protocol.endpoint import RemoteProtocolError
from protocol.marks import Mark, SettingError, above, at_least, between, setting

_ROUNDING = 1e-6
"""Of the time between two looks: by so much a time may be off through rounding."""


@dataclass(frozen=True)
class GatewayProfile(FirmwareProfile):
    """How a gateway behaves in time."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    node: int = setting(1, Mark.OBSERVED, "node number", between(1, 127))
    boot_s: float = setting(2.0, Mark.OBSERVED, "deaf and silent after power-up", at_least(0.0), unit="s")
    loop_ms: float = setting(
        1.0,
        Mark.OBSERVED,
        "its main program looks for commands and for a SYNC so often, and answers all SYNCs since its last look once; "
        "0: everything at once",
        between(0.0, 1000.0),
        unit="ms",
    )
    buffer_commands: int = setting(32, Mark.OBSERVED, "commands that wait for it at most", between(1, 65536))
    buffer_loses: Literal["oldest", "newest"] = setting(
        "oldest", Mark.OBSERVED, "which command is lost when one more comes than can wait"
    )
    shortest_period_us: float = setting(
        260.0,
        Mark.DERIVED,
        "shortest period of the stream, that is two frames of 8 bytes at 1 Mbit/s",
        above(0.0),
        unit="µs",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.buffer_loses not in ("oldest", "newest"):
            raise SettingError("buffer_loses", f"must be oldest or newest, got {self.buffer_loses}")


class Gateway(AnyGateway[Sequence[CanFrame]]):
    """Endpoint of the gateway: takes and gives sequences of CAN frames, tells no events."""

    def __init__(self, profile: GatewayProfile, sensor: Jr3Sensor, powered_at: float, seed: int = 0) -> None:
        super().__init__(profile, sensor, seed)
        self.endpoint = Packets(self, FRAMES, f"{seed} frames")
        self._profile = profile
        self._hears_from = powered_at + profile.boot_s
        self._out: list[CanFrame] = []
        self._waiting: deque[Command] = deque()
        self._synced = False
        """A SYNC has come since the last look."""
        self._looks_at: float | None = self._hears_from
        """When the main program looks next, s; None while there is nothing to be seen."""
        self._booting = True
        self._under_way: Command | None = None
        """The command that takes time; the main program looks at nothing else meanwhile."""

    # --- endpoint

    def receive(self, data: Sequence[CanFrame], now: float) -> None:
        """Take frames; those of other nodes, unknown ops and anything during boot get no answer."""
        self.handle_deadline(now)
        if now < self._hears_from:
            return
        for frame in data:
            if frame.extended or frame.remote or frame.error:
                continue
            try:
                command = decode_command(frame)
            except RemoteProtocolError:
                if split(frame.identifier) == (Op.GRIPPER, self._profile.node):
                    self.unmodelled.touch("operation gripper", "dropped: no motor is connected")
                continue
            if command.op is Op.SYNC:
                self._synced = True
            elif command.node == self._profile.node:
                self._keep(command)
            self._look_soon(now)
            if not self._profile.loop_ms:
                self._work(now)
        self._work(now)

    def _keep(self, command: Command) -> None:
        if len(self._waiting) >= self._profile.buffer_commands:
            if self._profile.buffer_loses == "newest":
                return
            self._waiting.popleft()
        self._waiting.append(command)

    def data_to_send(self, now: float) -> Sequence[CanFrame]:
        """Frames whose time has come."""
        frames, self._out = self._out, []
        return frames

    def next_deadline(self) -> float | None:
        """Time of the main program's next step, the next frame of the stream, or the next block of samples."""
        due = self._firmware.next_deadline()
        if (works_at := self._works_at()) is not None:
            due = works_at if due is None else min(due, works_at)
        return due

    def handle_deadline(self, now: float) -> None:
        """Emit every frame that is due up to and including now."""
        self._work(now)
        self._send_due(now)
        self._firmware.catch_up(now)

    # --- the main program

    def _look_soon(self, now: float) -> None:
        """Look at the next of the times that lie `loop_ms` apart, unless it will anyhow, or is busy."""
        if self._looks_at is not None or self._under_way is not None or not (self._synced or self._waiting):
            return
        period = self._profile.loop_ms * 1e-3
        self._looks_at = now
        if period:
            looks = math.ceil((now - self._hears_from) / period - _ROUNDING)
            self._looks_at = max(now, self._hears_from + looks * period)

    def _works_at(self) -> float | None:
        if self._under_way is not None:
            until = self._firmware.busy_until
            return until if until < math.inf else None
        return self._looks_at

    def _work(self, now: float) -> None:
        """Do what is to be done up to and including now, each at its time."""
        while (at := self._works_at()) is not None and at <= now:
            self._send_due(at)
            if self._under_way is not None:
                self._finish(at)
            elif self._booting:
                self._boot(at)
            elif self._synced:
                self._on_sync(at)
            self._looks_at = None
            while self._waiting and self._under_way is None:
                self._on_command(self._waiting.popleft(), at)
            self._look_soon(at)

    def _boot(self, now: float) -> None:
        self._booting = False
        if self._firmware.plugged:
            self._begin(Command(Op.BOOT_UP, self._profile.node), (Step.READ_CALIBRATION,), now)

    def _on_command(self, command: Command, now: float) -> None:
        steps = self.steps_of(command.op.name)
        if steps is None:
            self._acknowledge(command.op)
            return
        self._begin(command, steps, now)

    def _begin(self, command: Command, steps: tuple[Step, ...], now: float) -> None:
        self._under_way = command
        self._firmware.begin(steps, now)
        self._finish(now)

    def _finish(self, now: float) -> None:
        """Carry out what is under way, if it has waited long enough."""
        command, at = self._under_way, self._firmware.finish(now)
        if command is None or at is None:
            return
        self._under_way = None
        match command.op:
            case Op.START_SYNC:
                self._firmware.start(command.cutoff_centihertz, at)
            case Op.START_ASYNC:
                self._firmware.start_stream(command.cutoff_centihertz, command.period_us, at)
                self._send_due(at)
            case Op.ZERO:
                self._firmware.zero(at)
            case Op.SET_FILTER:
                self._firmware.set_filter(command.cutoff_centihertz, at)
            case Op.BOOT_UP:
                self._out.append(CanFrame(identifier(Op.BOOT_UP, self._profile.node)))
                return
            case _:  # the steps have done it all, or the queries only want the acknowledge
                pass
        self._acknowledge(command.op)

    def _on_sync(self, now: float) -> None:
        self._synced = False
        if (sample := self._firmware.sample(now)) is not None:
            self._send(sample)

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
