"""Emulated NETCANOEM board: it answers requests with gage values, and with the matrix that converts them to a
wrench.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from emulators.devices.ati_can.profile import AtiCanProfile
from emulators.faults.ledger import Handler, Injection
from emulators.faults.own import OwnFaults
from emulators.faults.packets import FRAMES, SENSOR_WIRE, Packets
from emulators.seams import WrenchSource
from emulators.sensing import Converter, MeasuredWrench
from emulators.sensing.settings import unrest
from emulators.unmodelled import Unmodelled
from protocol.can.frame import CanFrame
from protocol.devices.ati_can.messages import (
    ANY_ERROR,
    GAGE_HIGH,
    GAGE_LOW,
    GAGES,
    SLOTS,
    WATCHDOG,
    Op,
    encode_counts,
    encode_row,
    encode_sample,
    identifier,
)
from protocol.wrench import AXES

RATE_HZ = 4000
"""Sample rate of the emulated gages, Hz. Assumed: a real board samples on request."""
_BAD_CALIBRATION = 1 << 6 | ANY_ERROR
_UNITS_FROM = (3, 7)
_DIAGNOSIS_FROM = (3, 8)
_DIAGNOSES = 6
_DIAGNOSIS = 2048
"""Value of a diagnosis. Assumed: the middle of the converter's range."""
_REMEMBERED = 4096
"""Number of samples whose time is stored. Chosen."""


class AtiCanBoard:
    """Board behind its wire, which is `endpoint`. It receives and sends CAN frames. An `EmulatedSensor`."""

    def __init__(self, profile: AtiCanProfile, source: WrenchSource, powered_at: float, seed: int) -> None:
        self.profile = profile
        inverse = np.linalg.inv(profile.coefficients)
        matrix = np.asarray(inverse * float(profile.counts_per_unit), np.float64)
        ends = np.full(GAGES, float(GAGE_LOW)), np.full(GAGES, float(GAGE_HIGH))
        noise = np.full(GAGES, profile.noise_gages)
        errors = unrest(profile, powered_at)
        converter = Converter(matrix, noise, *ends, offset=float(profile.offset_gages), unrest=errors)
        self._measured = MeasuredWrench(source, RATE_HZ, converter, seed, "cell.ati_can.noise_gages")
        self.endpoint: Packets[Sequence[CanFrame]] = Packets(self, FRAMES, f"{seed} frames")
        """Board's end of the wire."""
        self._faults = OwnFaults()
        self._read = self._measured.number_at(powered_at)
        self._count = 0
        self._sample_times: deque[tuple[int, float]] = deque(maxlen=_REMEMBERED)
        """Numbers of reported samples, counted from power-up, each with the time of its measurement, s."""
        self.unmodelled = Unmodelled("ati-can")
        self._stored_base = self._base = profile.base
        self._boot(powered_at, watchdog=False)
        held, striking = self._faults.held, self._faults.striking
        self.handlers: Mapping[str, Mapping[str, Handler]] = {
            "signal": self._measured.signal.handlers,
            SENSOR_WIRE: self.endpoint.handlers,
            "sensor": {
                **held(("wrong-scales", "unplugged", "status")),
                **striking(
                    {"power-cycle": self._power_cycle, "watchdog": partial(self._boot, watchdog=True)}
                ),
                "other-host": Handler(self._other_host),
            },
        }

    def sampled_at(self, counter: int) -> float | None:
        """Return the time at which the board measured the reported sample with this number, s."""
        return next((at for number, at in reversed(self._sample_times) if number == counter), None)

    # --- power

    def _boot(self, now: float, watchdog: bool) -> None:
        self._receives_from = now + self.profile.boot_s
        self._slot = 0
        self._watchdog = watchdog
        self._answers: deque[tuple[float, Sequence[CanFrame]]] = deque()

    def _power_cycle(self, now: float) -> None:
        self._base = self._stored_base
        self._boot(now, watchdog=False)

    # --- endpoint

    def receive(self, data: Sequence[CanFrame], now: float) -> None:
        """Receive requests. The board does not answer other frames."""
        for frame in data:
            if now < self._receives_from or frame.extended or frame.remote or frame.error:
                continue
            if frame.identifier >> 4 != self._base:
                continue
            if answer := self._answer(frame.identifier & 0xF, frame.data, now):
                self._answers.append((now + self.profile.turnaround_s, answer))

    def next_event(self) -> None:
        """Return None: a board has no events."""

    def data_to_send(self, now: float) -> Sequence[CanFrame]:
        """Return answers that are due."""
        out: list[CanFrame] = []
        while self._answers and self._answers[0][0] <= now:
            out += self._answers.popleft()[1]
        return out

    def next_deadline(self) -> float | None:
        """Return the time at which the next answer is due, s."""
        return self._answers[0][0] if self._answers else None

    def handle_deadline(self, now: float) -> None:
        """Do nothing: `data_to_send` returns the answers."""

    # --- questions

    def _answer(self, op: int, data: bytes, now: float) -> Sequence[CanFrame]:
        """Return the frames of the answer. There are none for an unknown operation or a missing or invalid byte."""
        profile, base, first = self.profile, self._base, data[0] if data else None
        if op == Op.SAMPLE:
            return self._sample(now)
        if op == Op.ROW and first is not None and first < len(AXES):
            return encode_row(base, profile.coefficients[first].tolist())
        if op == Op.SERIAL:
            return self._plain(op, profile.serial.encode("ascii").ljust(8, b"\0"))
        if op == Op.SLOT and first is not None and first < SLOTS:
            self._slot = first
            return self._plain(op, bytes((first,)))
        if op == Op.COUNTS:
            return (encode_counts(base, self._counts("forces", now), self._counts("moments", now)),)
        if op == Op.UNITS and profile.firmware[:2] >= _UNITS_FROM:
            return self._plain(op, b"\x02\x03")
        if (
            op == Op.DIAGNOSIS
            and first is not None
            and first < _DIAGNOSES
            and profile.firmware[:2] >= _DIAGNOSIS_FROM
        ):
            return self._plain(op, _DIAGNOSIS.to_bytes(2, "big"))
        if op == Op.FIRMWARE:
            major, minor, build = profile.firmware
            return self._plain(op, bytes((major, minor)) + build.to_bytes(2, "big"))
        if op == Op.SET_BASE and first is not None and first <= 0x7F:
            self._stored_base = first
            return self._plain(op)
        if op == Op.SET_RATE and first is not None:
            self.unmodelled.touch("operation set rate", "answered as done; the bus keeps its rate")
            return self._plain(op)
        if op == Op.RESET:
            if profile.reset_applies:
                self._base = self._stored_base
            self._boot(now, watchdog=False)
        return ()

    def _plain(self, op: int, data: bytes = b"") -> Sequence[CanFrame]:
        return (CanFrame(identifier(self._base, op), data),)

    def _counts(self, kind: str, now: float) -> int:
        """Return the counts per unit that the board reports."""
        counts, wrong = self.profile.counts_per_unit, self._faults.under_way("wrong-scales", now)
        if wrong is None or wrong.values["of"] not in ("all", kind):
            return counts
        return max(1, min(2**32 - 1, round(counts / (wrong.number("factor") or 1.0))))

    def _sample(self, now: float) -> Sequence[CanFrame]:
        self._read = max(self._read, self._measured.number_at(now))
        gages = self._measured.outputs(self._read, self._read)[0].astype(np.int64).tolist()
        if self._faults.under_way("unplugged", now) is not None:
            gages = [self.profile.unplugged_gage] * GAGES
        self._count += 1
        self._sample_times.append((self._count, self._read / RATE_HZ))
        status = WATCHDOG | ANY_ERROR if self._watchdog else 0
        if self._slot not in self.profile.slots:
            status |= _BAD_CALIBRATION
        if (fault := self._faults.under_way("status", now)) is not None:
            status |= 1 << int(fault.number("bit")) | ANY_ERROR
        return encode_sample(self._base, status, gages)

    # --- faults

    def _other_host(self, injection: Injection) -> None:
        """Put another host's request, and the board's answer to it, on the bus."""
        slot, at = int(injection.number("slot")), injection.injected_at
        self._slot = slot
        request = CanFrame(identifier(self._base, Op.SLOT), bytes((slot,)))
        self._answers.append((at, (request, request)))
        injection.struck += 1
        injection.finish(at)
