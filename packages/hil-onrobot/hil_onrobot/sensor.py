"""Emulated OnRobot HEX behind its Ethernet converter: records over UDP, and single values over TCP.

It serves one client over UDP: a start from another address redirects the stream to that address. Rate, filter and bias
are properties of the sensor, not of a client. The sensor is emulated from the end of its boot on; a power cycle boots
it again.
"""

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from operator import sub

import numpy as np

from emulators.devices.netft.filter import SampleFilter
from emulators.faults.ledger import Handler
from emulators.faults.own import OwnFaults
from emulators.faults.packets import SENSOR_WIRE, StampedPackets
from emulators.seams import WrenchSource
from emulators.sensing import Converter, MeasuredWrench
from emulators.sensing.settings import per_axis, unrest
from emulators.unmodelled import Unmodelled
from hil_onrobot.connection import Connection
from hil_onrobot.messages import (
    FILTERS_HZ,
    RATE_HZ,
    RECORD,
    WRAP,
    Calibration,
    Command,
    Request,
    decode_request,
)
from hil_onrobot.profile import HexProfile
from protocol.datagram import Datagram, side_of
from protocol.devices.netft.page import filter_weight
from protocol.endpoint import RemoteProtocolError

_COUNT_END = 2**31 - 1
_MOST_AT_ONCE = 64
"""Maximum number of records sent at once. Chosen: after a pause of the computer, more would overrun a reader."""
_WEIGHTS = [filter_weight(cutoff, RATE_HZ) for cutoff in FILTERS_HZ]
_REMEMBERED = 4096
"""Number of records whose time is stored. Chosen."""
_READING_END = 32767
"""Largest value of a reading over TCP."""


@dataclass(slots=True)
class _Stream:
    """Active request for records."""

    next: int
    """Number of the next sample to report."""
    remaining: int | None
    """Total number of records to send; None if the stream continues until a stop."""
    side: Hashable
    """Address that sent the request."""
    sent: int = 0


class HexSensor:
    """Sensor behind its wire, which is `endpoint`. It receives and sends datagrams. An `EmulatedSensor`."""

    def __init__(self, profile: HexProfile, source: WrenchSource, powered_at: float, seed: int) -> None:
        self.profile = profile
        ratings = np.array((*profile.ratings_n, *profile.ratings_nm))
        per_unit = np.array((*(profile.counts_per_n,) * 3, *(profile.counts_per_nm,) * 3), dtype=float)
        ends = np.minimum(ratings * profile.overload_share * per_unit, _COUNT_END)
        noise = np.array((*per_axis(profile.noise_n), *per_axis(profile.noise_nm))) * per_unit
        converter = Converter(
            np.diag(per_unit), noise, -ends, ends, unrest=unrest(profile, powered_at), full_scale=ratings
        )
        factors = tuple(math.ceil(end / _READING_END) for end in ends.tolist())
        self.calibration = Calibration(profile.counts_per_n, profile.counts_per_nm, factors)
        """Scales of the values over TCP. Assumed: factors with which the range just fits."""
        self._measured = MeasuredWrench(source, RATE_HZ, converter, seed, "cell.onrobot_hex.noise_n")
        self.filter = SampleFilter(self._measured, _WEIGHTS, profile.filter, profile.saturation_hold_samples)
        self.endpoint = StampedPackets(self, f"{seed} records")
        """Sensor's end of the wire."""
        self.unmodelled = Unmodelled("onrobot-hex")
        self._out: list[bytes] = []
        self._bias = [0.0] * 6
        """Bias subtracted from the counts."""
        self._connections: list[Connection] = []
        self._stream: _Stream | None = None
        self._faults = OwnFaults()
        self._power_up(powered_at)
        self.ready_at = powered_at
        """Time from which the sensor receives and answers, s."""
        held, striking = self._faults.held, self._faults.striking
        self.handlers: Mapping[str, Mapping[str, Handler]] = {
            "signal": self._measured.signal.handlers,
            SENSOR_WIRE: self.endpoint.handlers,
            "sensor": {
                **held(("unplugged", "slow", "frozen-counter", "status", "saturated")),
                **striking({"power-cycle": self._power_up, "biased": self._take_bias, "taken": self._stop}),
            },
        }

    def _power_up(self, now: float) -> None:
        """Begin a boot."""
        self.ready_at = now + self.profile.boot_s
        self._first = self._measured.first_after(now)
        """Number of the sample whose number on the wire is 0."""
        self.filter.restart(self._first)
        self.filter.number, self._every = self.profile.filter, self.profile.every
        if not self.profile.bias_persistent:
            self._bias = [0.0] * 6
        self._frozen: int | None = None
        """Number of the sample with which the records continue, if it is frozen."""
        self._client: Hashable = None
        """Address of the first client since power-up."""
        self._sampled: dict[int, int] = {}
        """Samples of the newest records by their number in the stream."""
        self._out.clear()
        self._stop(now)

    def sampled_at(self, counter: int) -> float | None:
        """Return the time at which the sample in the newest record with this number was measured, s."""
        number = self._sampled.get(counter)
        return None if number is None else number / RATE_HZ

    # --- TCP

    def connect(self, now: float) -> Connection | None:
        """Return the end of a new connection. None if the sensor boots, or serves as many clients as it can."""
        if now < self.ready_at or len(self._connections) >= self.profile.tcp_clients:
            return None
        connection = Connection(self)
        self._connections.append(connection)
        return connection

    def leave(self, connection: Connection) -> None:
        """Handle the end of a connection."""
        self._connections.remove(connection)

    def read(self, now: float) -> tuple[int, Sequence[float]]:
        """Return status and counts of the newest sample."""
        self._send_due(now)
        number = self._read_to(self._measured.number_at(now - self.profile.latency_s))
        return self._status(number, now), self._counts()

    # --- endpoint

    def receive(self, data: Sequence[bytes], now: float) -> None:
        """Receive requests. The sensor does not answer anything else."""
        self._send_due(now)
        if now < self.ready_at:
            return
        for datagram in data:
            try:
                request = decode_request(datagram)
            except RemoteProtocolError:
                continue  # assumed: dropped without an answer
            side = side_of(datagram)
            if self.profile.first_client_only and self._client not in (None, side):
                continue
            self._client = side
            self._carry_out(request, side, now)

    def _carry_out(self, request: Request, side: Hashable, now: float) -> None:
        command, value = request
        match command:
            case Command.STOP:
                own = self._stream is None or side == self._stream.side
                if own or self.profile.stranger_may_stop:
                    self._stop(now)
            case Command.START:
                first = self._measured.first_after(now)
                self._stream = _Stream(first, value or None, side)
            case Command.BIAS if value:
                self._take_bias(now)
            case Command.BIAS:
                self._bias = [0.0] * 6
            case Command.SET_FILTER if value < len(FILTERS_HZ):
                self.filter.number = value
            case Command.SET_RATE if value:
                self._every = value
            case Command.SET_FILTER | Command.SET_RATE:
                pass  # assumed: an impossible value is ignored
            case _:
                self.unmodelled.touch(f"command {command:04X}", "dropped")

    def next_event(self) -> None:
        """Return None: there are no events."""

    def data_to_send(self, now: float) -> Sequence[bytes]:
        """Return the records that are due."""
        out, self._out = self._out, []
        return out

    def next_deadline(self) -> float | None:
        """Return the time at which the next record is due, s."""
        return None if self._stream is None else self._stream.next / RATE_HZ + self.profile.latency_s

    def last_deadline(self, until: float) -> float:
        """Return the time at which the last record up to `until` is due, s; `until` if there is no stream."""
        if self._stream is None:
            return until
        newest = self._measured.number_at(until - self.profile.latency_s)
        last = newest - (newest - self._stream.next) % self._every
        return min(last / RATE_HZ + self.profile.latency_s, until)

    def handle_deadline(self, now: float) -> None:
        """Send every record that is due. Each has the time at which it was due."""
        self._send_due(now, _MOST_AT_ONCE)

    def _stop(self, now: float) -> None:
        self._stream = None

    def _take_bias(self, now: float) -> None:
        self._send_due(now)
        self._read_to(self._measured.number_at(now - self.profile.latency_s))
        if self.filter.output is not None:
            self._bias = list(self.filter.output)

    # --- samples

    def _read_to(self, number: int) -> int:
        """Let the filter read up to a sample, unless it has already. Return the number of its newest sample."""
        if number > self.filter.newest and number >= self._first:
            self.filter.read(number, self._every)
        return self.filter.newest

    def _send_due(self, now: float, most: int = WRAP) -> None:
        newest = self._measured.number_at(now - self.profile.latency_s)
        while (stream := self._stream) is not None and stream.next <= newest and most:
            self._send(stream, min(stream.next / RATE_HZ + self.profile.latency_s, now))
            most -= 1

    def _send(self, stream: _Stream, now: float) -> None:
        number, step, faults = stream.next, self._every, self._faults
        sample = (number - self._first) % WRAP
        if not faults.any:
            self._read_to(number)
        else:
            if self.filter.output is None or faults.under_way("unplugged", now) is None:
                self._read_to(number)
            if (slow := faults.under_way("slow", now)) is not None:
                step = max(1, round(step * slow.number("factor")))
            if faults.under_way("frozen-counter", now) is None:
                self._frozen = None
            else:
                sample = self._frozen = sample if self._frozen is None else self._frozen
        stream.next += step
        stream.sent += 1
        self._remember(stream.sent % WRAP, number)
        record = RECORD.struct.pack(stream.sent % WRAP, sample, self._status(number, now), *self._counts())
        self._out.append(Datagram(record, now, stream.side))
        if stream.sent == stream.remaining:
            self._stop(now)

    def _remember(self, counter: int, number: int) -> None:
        self._sampled[counter] = number
        if len(self._sampled) > _REMEMBERED:
            del self._sampled[next(iter(self._sampled))]

    def _counts(self) -> Sequence[int]:
        """Return the filter's output without bias, limited to the range of a word."""
        counts = map(round, map(sub, self.filter.output or [0.0] * 6, self._bias))
        return [max(-_COUNT_END, min(_COUNT_END, count)) for count in counts]

    def _status(self, number: int, now: float) -> int:
        """Return the status word that is sent with a sample."""
        faults, status = self._faults, 0
        if faults.any and faults.under_way("unplugged", now):
            return self.profile.unplugged_status
        if number <= self.filter.saturated_until or (faults.any and faults.under_way("saturated", now)):
            status |= self.profile.saturated_status
        if faults.any and (fault := faults.under_way("status", now)) is not None:
            status |= 1 << int(fault.number("bit"))
        return status
