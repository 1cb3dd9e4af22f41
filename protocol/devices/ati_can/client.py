"""Client of a NETCANOEM board: reads the calibration matrix, polls the gages, and computes the wrench.

One request is outstanding at a time. The host subtracts the zero. If another host changed the active slot, the
matrix would silently be wrong; a change of slot therefore ends the session.
"""

from collections.abc import Sequence

from protocol.can.error import decode_error
from protocol.can.frame import CanFrame
from protocol.devices.ati_can.messages import (
    CRITICAL,
    FORCE_UNITS,
    GAGE_HIGH,
    GAGE_LOW,
    TORQUE_UNITS,
    WATCHDOG,
    Op,
    SampleStart,
    decode_counts,
    decode_firmware,
    decode_pair,
    decode_sample,
    decode_sample_rest,
    decode_units,
    describe_status_bits,
    question,
)
from protocol.devices.ati_can.profile import AtiCanClientProfile
from protocol.endpoint import RemoteProtocolError
from protocol.geometry import Wrench
from protocol.outbox import Outbox
from protocol.sensor_events import SensorEventQueue
from protocol.wrench import AXES, SensorFacts, SensorStatistics

_UNITS_FROM = (3, 7)
"""First firmware version that reports its units. Source: manual."""
_OLDER_UNITS = (FORCE_UNITS[2], TORQUE_UNITS[3])
"""Units of firmware that does not report them: N and N·m. Assumed."""
_ROW_OPS = (Op.ROW, Op.ROW_MIDDLE, Op.ROW_END)
_ALL_AXES = 0b111111


class _Calibration:
    """Calibration reported by the board, received row by row."""

    def __init__(self) -> None:
        self._units, self._per_unit = _OLDER_UNITS, (1, 1)
        self._row: list[float] = []
        self._matrix: list[list[float]] = []

    @property
    def axis(self) -> int:
        """Index of the next row."""
        return len(self._matrix)

    def begin(self) -> None:
        """Restart with the first row."""
        self._matrix = []

    def begin_row(self) -> None:
        """Discard the row received so far."""
        self._row = []

    def take_row(self, op: int, data: bytes) -> bool:
        """Store a part of a row and return whether the row is complete. Raises RemoteProtocolError if all values of
        the row are zero.
        """
        if len(data) < 2 or op != _ROW_OPS[len(self._row) // 2]:
            return False  # a request of another host, or a response whose predecessors are missing
        self._row += decode_pair(data)
        if len(self._row) < 6:
            return False
        if not any(self._row):
            raise RemoteProtocolError(f"row {AXES[self.axis]} of the matrix is 0")
        self._matrix.append(self._row)
        return True

    def take_counts(self, data: bytes) -> None:
        """Decode and store the counts per unit."""
        self._per_unit = decode_counts(data)

    def take_units(self, data: bytes) -> None:
        """Decode and store the units."""
        self._units = decode_units(data)

    def apply(self, gages: tuple[int, ...]) -> list[float]:
        """Convert gage readings to a wrench, in counts."""
        g, h, i, j, k, m = gages
        return [0.0 + a * g + b * h + c * i + d * j + e * k + f * m for a, b, c, d, e, f in self._matrix]

    @property
    def scales(self) -> Wrench:
        """Scale of each axis, N or N·m per count."""
        force, torque = (unit / counts for unit, counts in zip(self._units, self._per_unit, strict=True))
        return force, force, force, torque, torque, torque


class AtiCanClient(Outbox[CanFrame]):
    """`SensorClient` over CAN frames."""

    stop_patience = 0.0

    def __init__(self, profile: AtiCanClientProfile, now: float) -> None:
        self.statistics = SensorStatistics()
        self._profile = profile
        self._sensor_events = events = SensorEventQueue(
            zero_samples=max(1, round(profile.zero_s / (profile.period_ms * 1e-3)))
        )
        self.next_event, self.zero = events.next_event, events.zero
        super().__init__()
        self._given_up_at = now + profile.ready_timeout_s
        self._others = False
        self._op = Op.FIRMWARE
        """Operation of the outstanding or the next request."""
        self._tries = 0
        self._under_way = False
        self._due: float | None = now
        """Time at which to send the request, or at which its response is overdue, s."""
        self._asked_at = now
        self._model = ""
        self._firmware = (0, 0)
        self._calibration = _Calibration()
        self._start: SampleStart | None = None
        self._status = 0
        self._bus = ""
        """Text of the interface's newest bus error report."""

    # --- endpoint

    def receive(self, data: Sequence[CanFrame], now: float) -> None:
        """Process received frames. Frames of other boards are ignored, and bus error reports become notices."""
        for frame in data:
            if self._sensor_events.ended:
                return
            op = frame.identifier & 0xF
            try:
                if frame.error:
                    self._report_bus(f"CAN bus: {decode_error(frame)}")
                    continue
                if frame.extended or frame.remote or frame.identifier >> 4 != self._profile.base:
                    continue
                self._process_response(op, frame, now)
            except RemoteProtocolError as error:
                self.statistics.malformed += 1
                if not (self._sensor_events.ready or frame.error) and op != Op.SAMPLE:
                    self._fail(str(error), "check its calibration")

    def handle_deadline(self, now: float) -> None:
        """Send the request, repeat it, or report a failure."""
        if self._due is None or now < self._due:
            return
        if (
            not self._under_way
            or self._tries < self._profile.tries
            or (not self._model and now < self._given_up_at)
        ):
            self._ask(now)
        else:
            self._fail(
                f"no response to {self._op.name.lower()} after {self._tries} requests",
                f"check its supply, the bus, its bit rate, and base {self._profile.base:02X}",
            )

    def stop(self) -> None:
        """Stop polling. No stop command is needed, because the board sends nothing unsolicited."""
        if not self._sensor_events.ended:
            self._due = None
            self._sensor_events.stop()

    # --- requests

    def _ask(self, now: float) -> None:
        profile = self._profile
        if self._op is Op.SLOT:
            self._out.append(question(profile.base, self._op, profile.slot))
        elif self._op is Op.ROW:
            self._out.append(question(profile.base, self._op, self._calibration.axis))
        else:
            self._out.append(question(profile.base, self._op))
        self._calibration.begin_row()
        self._start = None
        self._tries += 1
        self._under_way, self._asked_at = True, now
        self._due = now + profile.answer_timeout_s

    def _advance(self, op: Op, now: float) -> None:
        """Accept the response and send the request `op` next, without delay."""
        self._op, self._tries = op, 0
        self._ask(now)

    def _process_response(self, op: int, frame: CanFrame, now: float) -> None:
        data = frame.data
        if op in (Op.SAMPLE, Op.SAMPLE_REST):
            self._take_sample(op, frame, now)
        elif op == Op.RESET or (op == Op.SLOT and self._op is not Op.SLOT):
            self._fail("another host resets the board or selects a calibration", "let only one host use it")
        elif not self._under_way or (op != self._op and not (self._op is Op.ROW and op in _ROW_OPS)):
            self._report_other_host()
        elif op == Op.FIRMWARE and data:
            major, minor, build = decode_firmware(data)
            self._firmware = (major, minor)
            self._model = f"ATI NETCANOEM, firmware {major}.{minor} build {build}"
            self._advance(Op.SERIAL, now)
        elif op == Op.SERIAL and data:
            serial = data.decode("ascii", "replace").strip("\0 ")
            self._model += f", {serial}" if serial.isprintable() else ""
            self._advance(Op.SLOT, now)
        elif op == Op.SLOT:
            if data != bytes((self._profile.slot,)):
                raise RemoteProtocolError(f"the board has not selected slot {self._profile.slot}")
            self._calibration.begin()
            self._advance(Op.ROW, now)
        elif self._op is Op.ROW and op in _ROW_OPS:
            if self._calibration.take_row(op, data):
                self._advance(Op.ROW if self._calibration.axis < len(AXES) else Op.COUNTS, now)
        elif op == Op.COUNTS and data:
            self._calibration.take_counts(data)
            self._advance(Op.UNITS if self._firmware >= _UNITS_FROM else Op.SAMPLE, now)
        elif op == Op.UNITS and data:
            self._calibration.take_units(data)
            self._advance(Op.SAMPLE, now)

    # --- samples

    def _take_sample(self, op: int, frame: CanFrame, now: float) -> None:
        if op == Op.SAMPLE:
            if not frame.data or self._op is not Op.SAMPLE or not self._under_way:
                self._report_other_host()
                return
            self.statistics.unpaired += self._start is not None
            self._start = decode_sample(frame.data)
            return
        if (start := self._start) is None:
            self.statistics.unpaired += 1
            return
        self._start = None
        one, three, five = decode_sample_rest(frame.data)
        zero, two, four = start.gages
        at = now if frame.received_at is None else frame.received_at
        self._report_sample(start.status, (zero, one, two, three, four, five), at)
        self._under_way, self._tries = False, 0
        if not self._sensor_events.ended:
            self._due = max(now, self._asked_at + self._profile.period_ms * 1e-3)

    def _report_sample(self, status: int, gages: tuple[int, ...], at: float) -> None:
        events = self._sensor_events
        if status != self._status:
            text = f"status {status:04X}: {describe_status_bits(status)}"
            if status:
                events.notice_status(status, text)
            if events.ready and status & WATCHDOG and not self._status & WATCHDOG:
                events.restart()  # the active slot is 0 again
                self._op = Op.SLOT
            self._status = status
        if not events.ready:
            if status & CRITICAL:
                self._fail(
                    f"it reports status {status:04X}: {describe_status_bits(status)}",
                    "check its supply and cable",
                )
                return
            events.begin(self._facts())
        # A saturated gage affects every axis.
        lost = status & CRITICAL or max(gages) >= GAGE_HIGH or min(gages) <= GAGE_LOW
        events.sample(self._calibration.apply(gages), at, _ALL_AXES if lost else 0)

    def _facts(self) -> SensorFacts:
        return SensorFacts(self._model, self._calibration.scales, None, None, None, 0.0, "host")

    # --- end

    def _report_other_host(self) -> None:
        if not self._others:
            self._others = True
            self._sensor_events.notice("another host sends requests on this bus, or a response was late")

    def _report_bus(self, text: str) -> None:
        if text != self._bus:
            self._bus = text
            self._sensor_events.notice(text)

    def _fail(self, text: str, remedy: str = "") -> None:
        if not self._sensor_events.ended:
            self._due = None
            self._sensor_events.fail(text, remedy)
