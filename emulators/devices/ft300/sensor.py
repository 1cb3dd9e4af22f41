"""Emulated FT 300: Modbus RTU until a command starts the stream, then messages until a command ends it."""

import random
from collections import deque
from collections.abc import Mapping

import numpy as np

from emulators.devices.ft300.profile import Ft300Profile
from emulators.faults.ledger import Handler
from emulators.faults.own import OwnFaults
from emulators.faults.packets import BYTES, SENSOR_WIRE, Packets
from emulators.seams import WrenchSource
from emulators.sensing import Converter, MeasuredWrench
from emulators.sensing.settings import per_axis, unrest
from emulators.unmodelled import Unmodelled
from protocol.devices.ft300.messages import (
    ACCELERATION_REGISTER,
    COUNT_END,
    ILLEGAL_ADDRESS,
    ILLEGAL_FUNCTION,
    ILLEGAL_VALUE,
    MODE_REGISTER,
    MOST_REGISTERS,
    PERIOD_S,
    READ,
    READ_INPUT,
    SCALES,
    SERIAL_REGISTER,
    SLAVE,
    STREAM_MODE,
    VERSION_REGISTER,
    WRENCH_REGISTER,
    WRITE,
    WRITE_ONE,
    YEAR_REGISTER,
    Request,
    crc_fits,
    decode_request,
    encode_exception,
    encode_message,
    encode_words,
    encode_written,
    request_size,
)
from protocol.endpoint import RemoteProtocolError

RATE_HZ = round(1.0 / PERIOD_S)
_FF = 0xFF
_LETTERS = b"FTS"
_DOWN = (0, 0, (-1000) & 0xFFFF)
"""Acceleration that a stationary sensor reports with its z axis up, thousandths of g."""
_KEPT = 300
"""Maximum size of a stored incomplete request, bytes. Chosen."""
_REMEMBERED = 4096
"""Number of samples whose time is stored. Chosen."""


def measured_counts(
    profile: Ft300Profile, source: WrenchSource, powered_at: float, seed: int
) -> MeasuredWrench:
    """Return the counts that the sensor measures, with its errors."""
    per_unit = 1.0 / np.array(SCALES)
    noise = np.array((*per_axis(profile.noise_n), *per_axis(profile.noise_nm))) * per_unit
    high = np.full(6, float(COUNT_END))  # assumed: the sensor clips the counts
    errors = unrest(profile, powered_at)
    converter = Converter(np.diag(per_unit), noise, -high - 1.0, high, unrest=errors)
    return MeasuredWrench(source, RATE_HZ, converter, seed, "cell.ft300.noise_n")


class Ft300:
    """Sensor behind its wire, which is `endpoint`. It receives and sends bytes and has no events. An
    `EmulatedSensor`.
    """

    def __init__(self, profile: Ft300Profile, source: WrenchSource, powered_at: float, seed: int) -> None:
        self.profile = profile
        self._measured = measured_counts(profile, source, powered_at, seed)
        self.endpoint: Packets[bytes] = Packets(self, BYTES, f"{seed} frames")
        """Sensor's end of the wire."""
        self._seed = seed
        self._faults = OwnFaults()
        self.unmodelled = Unmodelled("ft300")
        self._sample_times: deque[tuple[int, float]] = deque(maxlen=_REMEMBERED)
        """Counters of the reported samples, each with the time of its measurement, s."""
        self._read = self._measured.number_at(powered_at) - 1
        self._power_up(powered_at)
        faults = self._faults
        self.handlers: Mapping[str, Mapping[str, Handler]] = {
            "signal": self._measured.signal.handlers,
            SENSOR_WIRE: self.endpoint.handlers,
            "sensor": {
                **faults.ended_by("unplugged", self._power_up),
                **faults.held(("slow", "refuses")),
                **faults.striking({"power-cycle": self._power_up}),
            },
        }

    def sampled_at(self, counter: int) -> float | None:
        """Return the time at which the sensor measured the reported sample with this number, s. Numbers count from
        the request of the stream.
        """
        return next((at for number, at in reversed(self._sample_times) if number == counter), None)

    # --- power

    def _power_up(self, now: float) -> None:
        self._receives_from = now + self.profile.boot_s
        self._out = bytearray()
        self._answers: deque[tuple[float, bytes]] = deque()
        self._question = b""
        self._question_at = now
        self._mode = self._ffs = 0
        self._count = 0
        self._next: int | None = None
        """Number of the next sample of the stream; None if there is no stream."""
        if self.profile.power_up == "stream":
            self._stream(self._receives_from)

    def _stream(self, begin: float) -> None:
        self._mode, self._ffs, self._count = STREAM_MODE, 0, 0
        self._next = self._measured.first_after(begin - self.profile.latency_s)

    def _due(self, number: int) -> float:
        """Return the time at which the message of a sample is due, s."""
        late = random.Random(f"{self._seed} {number}").random() * self.profile.jitter_s
        return number * PERIOD_S + self.profile.latency_s + late

    # --- endpoint

    def receive(self, data: bytes, now: float) -> None:
        """Receive the bytes of a request, or of the command that ends the stream."""
        if now < self._receives_from or self._faults.under_way("unplugged", now):
            return
        if self._next is not None:
            at = self._stopped_at(data)
            if at is None:
                return
            self._next, self._mode, data = None, 0, data[at:]
        if now - self._question_at > self.profile.frame_timeout_s:
            self._question = b""
        self._question_at = now
        self._question = (self._question + data)[-_KEPT:]
        while (frame := self._frame()) is not None:
            if crc_fits(frame):
                self._answer(frame, now)

    def next_event(self) -> None:
        """Return None: a sensor has no events."""

    def data_to_send(self, now: float) -> bytes:
        """Return bytes that are due."""
        out = bytes(self._out)
        self._out.clear()
        return out

    def next_deadline(self) -> float | None:
        """Return the time at which the next message or answer is due, s."""
        times = [at for at, _ in self._answers]
        if self._next is not None:
            times.append(self._due(self._next))
        return min(times, default=None)

    def handle_deadline(self, now: float) -> None:
        """Send all messages and answers that are due."""
        while self._answers and self._answers[0][0] <= now:
            self._send(self._answers.popleft()[1], now)
        while self._next is not None and self._due(self._next) <= now:
            self._message(self._next, now)

    # --- stream

    def _message(self, number: int, now: float) -> None:
        slow = self._faults.under_way("slow", now)
        self._next = number + (1 if slow is None else max(1, round(slow.number("factor"))))
        self._send(encode_message(self._sample(number)), now)

    def _sample(self, number: int) -> list[int]:
        """Return the counts of a sample that is sent now."""
        self._read = max(number, self._read)
        self._count += 1
        self._sample_times.append((self._count, self._read * PERIOD_S))
        counts: list[int] = self._measured.outputs(self._read, self._read)[0].astype(np.int64).tolist()
        return counts

    def _send(self, data: bytes, now: float) -> None:
        if self._faults.under_way("unplugged", now) is None:
            self._out += data

    # --- questions

    def _stopped_at(self, data: bytes) -> int | None:
        """Return the index after the byte that ends the stream; None if none of these bytes ends it."""
        for at, byte in enumerate(data):
            self._ffs = self._ffs + 1 if byte == _FF else 0
            if self._ffs >= self.profile.stop_after_ff:
                return at + 1
        return None

    def _frame(self) -> bytes | None:
        """Return the next complete request, even if its checksum is invalid, or None."""
        begin = self._question.find(SLAVE)
        self._question = self._question[begin:] if begin >= 0 else b""
        size = request_size(self._question)
        if size is None or len(self._question) < size:
            return None
        frame, self._question = self._question[:size], self._question[size:]
        return frame

    def _answer(self, frame: bytes, now: float) -> None:
        at = now + self.profile.modbus_turnaround_s
        function = frame[1]
        try:
            request = decode_request(frame)
        except RemoteProtocolError:
            self._answers.append((at, encode_exception(function, ILLEGAL_VALUE)))
            return
        refusal = self._faults.under_way("refuses", now)
        if refusal is not None:
            answer = encode_exception(function, int(refusal.number("code")))
        elif function == READ or (function == READ_INPUT and self.profile.fc04):
            answer = self._read_words(request, now)
        elif function == WRITE or (function == WRITE_ONE and self.profile.fc06):
            answer = self._write_words(request, at)
        else:
            self.unmodelled.touch(f"Modbus function {function}", "refused as an illegal function")
            answer = encode_exception(function, ILLEGAL_FUNCTION)
        self._answers.append((at, answer))

    def _read_words(self, request: Request, now: float) -> bytes:
        count, registers = request.words, range(request.register, request.register + request.words)
        if not 0 < count <= MOST_REGISTERS:
            return encode_exception(request.function, ILLEGAL_VALUE)
        profile, known = self.profile, dict[int, int]()
        version, number = bytes(profile.version), profile.serial
        for register, words in (
            (ACCELERATION_REGISTER, _DOWN),
            (MODE_REGISTER, (self._mode,)),
            (VERSION_REGISTER, _words(_LETTERS + version)),
            (SERIAL_REGISTER, (*_words(_LETTERS + b"\0"), number & 0xFFFF, number >> 16, profile.year)),
            (YEAR_REGISTER, (profile.year,)),
        ):
            known.update(enumerate(words, register))
        if any(WRENCH_REGISTER <= register < WRENCH_REGISTER + 6 for register in registers):
            newest = self._measured.number_at(now - profile.latency_s)
            known.update(enumerate((count & 0xFFFF for count in self._sample(newest)), WRENCH_REGISTER))
        if unknown := [register for register in registers if register not in known]:
            self.unmodelled.touch(f"register {unknown[0]}", "refused as an illegal address")
            return encode_exception(request.function, ILLEGAL_ADDRESS)
        return encode_words(request.function, [known[register] for register in registers])

    def _write_words(self, request: Request, at: float) -> bytes:
        if request.register != MODE_REGISTER or request.words != 1:
            wrong = ILLEGAL_ADDRESS if request.words else ILLEGAL_VALUE
            self.unmodelled.touch(f"writing register {request.register}", "refused")
            return encode_exception(request.function, wrong)
        if request.values[0] == STREAM_MODE:  # assumed: any other value is accepted without effect
            self._stream(at + self.profile.stream_start_s)
        return encode_written(request)


def _words(data: bytes) -> tuple[int, ...]:
    return tuple(int.from_bytes(data[at : at + 2], "big") for at in range(0, len(data), 2))
