"""Microcontroller between a JR3 sensor's serial link and CAN.

It behaves as the firmware roboticslab-uc3m/jr3-mbed-firmware-can, which was read for facts only. Its main program
checks for a SYNC, then for commands, then sleeps. Throughout, an interrupt receives frames from the bus.
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
"""Rounding tolerance, as a share of the time between two checks."""


@dataclass(frozen=True)
class GatewayProfile(FirmwareProfile):
    """Timing of a gateway."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    node: int = setting(1, Mark.OBSERVED, "node number", between(1, 127))
    boot_s: float = setting(
        2.0, Mark.OBSERVED, "time without response after power-up", at_least(0.0), unit="s"
    )
    loop_ms: float = setting(
        1.0,
        Mark.OBSERVED,
        "interval at which the gateway's main program polls commands and SYNC; it answers all "
        "SYNCs since the last poll once; 0: everything at once",
        between(0.0, 1000.0),
        unit="ms",
    )
    buffer_commands: int = setting(32, Mark.OBSERVED, "length of the command queue", between(1, 65536))
    buffer_loses: Literal["oldest", "newest"] = setting(
        "oldest", Mark.OBSERVED, "command that is lost when the queue is full"
    )
    shortest_period_us: float = setting(
        260.0,
        Mark.DERIVED,
        "shortest period of the stream: two frames of 8 bytes at 1 Mbit/s",
        above(0.0),
        unit="µs",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.buffer_loses not in ("oldest", "newest"):
            raise SettingError("buffer_loses", f"must be oldest or newest, got {self.buffer_loses}")


class Gateway(AnyGateway[Sequence[CanFrame]]):
    """Endpoint of the gateway. It receives and sends sequences of CAN frames and has no events."""

    def __init__(self, profile: GatewayProfile, sensor: Jr3Sensor, powered_at: float, seed: int = 0) -> None:
        super().__init__(profile, sensor, seed)
        self.endpoint = Packets(self, FRAMES, f"{seed} frames")
        self._profile = profile
        self._receives_from = powered_at + profile.boot_s
        self._out: list[CanFrame] = []
        self._waiting: deque[Command] = deque()
        self._synced = False
        """Whether a SYNC has arrived since the last check."""
        self._next_check_at: float | None = self._receives_from
        """Time of the main program's next check, s; None while there is nothing to process."""
        self._booting = True
        self._under_way: Command | None = None
        """Command in progress. Until it completes, the main program checks nothing else."""

    # --- endpoint

    def receive(self, data: Sequence[CanFrame], now: float) -> None:
        """Receive frames. Frames of other nodes, unknown operations and all frames during the boot get no answer."""
        self.handle_deadline(now)
        if now < self._receives_from:
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
                self._queue_command(command)
            self._schedule_check(now)
            if not self._profile.loop_ms:
                self._work(now)
        self._work(now)

    def _queue_command(self, command: Command) -> None:
        if len(self._waiting) >= self._profile.buffer_commands:
            if self._profile.buffer_loses == "newest":
                return
            self._waiting.popleft()
        self._waiting.append(command)

    def data_to_send(self, now: float) -> Sequence[CanFrame]:
        """Return frames that are due."""
        frames, self._out = self._out, []
        return frames

    def next_deadline(self) -> float | None:
        """Return the time of the main program's next step, the stream's next frame, or the next block of samples, s."""
        due = self._firmware.next_deadline()
        if (works_at := self._works_at()) is not None:
            due = works_at if due is None else min(due, works_at)
        return due

    def handle_deadline(self, now: float) -> None:
        """Send every frame that is due up to and including now."""
        self._work(now)
        self._send_due(now)
        self._firmware.catch_up(now)

    # --- the main program

    def _schedule_check(self, now: float) -> None:
        """Schedule the next check, on a grid of `loop_ms`, unless one is already scheduled or the program is busy."""
        if (
            self._next_check_at is not None
            or self._under_way is not None
            or not (self._synced or self._waiting)
        ):
            return
        period = self._profile.loop_ms * 1e-3
        self._next_check_at = now
        if period:
            checks = math.ceil((now - self._receives_from) / period - _ROUNDING)
            self._next_check_at = max(now, self._receives_from + checks * period)

    def _works_at(self) -> float | None:
        if self._under_way is not None:
            until = self._firmware.busy_until
            return until if until < math.inf else None
        return self._next_check_at

    def _work(self, now: float) -> None:
        """Process everything that is due up to and including now, each item at its own time."""
        while (at := self._works_at()) is not None and at <= now:
            self._send_due(at)
            if self._under_way is not None:
                self._finish(at)
            elif self._booting:
                self._boot(at)
            elif self._synced:
                self._on_sync(at)
            self._next_check_at = None
            while self._waiting and self._under_way is None:
                self._on_command(self._waiting.popleft(), at)
            self._schedule_check(at)

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
        """Complete the command in progress if it has waited long enough."""
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
            case _:  # the steps have already executed it, or it requires only an acknowledgement
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
