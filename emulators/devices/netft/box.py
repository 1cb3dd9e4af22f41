"""Emulated Net F/T: samples at several kHz, a filter, records over UDP, and a page with its configuration.

It serves one client at a time: a start request from another address redirects the stream to that address, without
notice to the first client. A stop request from another address ends the stream, unless a setting prevents it. A
bias request from another address is applied, and the stream continues. Anything other than a request has no effect,
whatever its source.

Samples are numbered at the family's highest rate. An Axia with a lower rate, `adc_rate_hz`, reports every second,
fourth, eighth or sixteenth sample.
"""

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from operator import sub

import numpy as np

from emulators.devices.netft.filter import SampleFilter
from emulators.devices.netft.profile import NetFtProfile
from emulators.faults.ledger import Handler
from emulators.faults.own import OwnFaults
from emulators.faults.packets import SENSOR_WIRE, StampedPackets
from emulators.seams import Floats, WrenchSource
from emulators.sensing import Converter, MeasuredWrench
from emulators.sensing.settings import per_axis, unrest
from emulators.unmodelled import Unmodelled
from protocol.datagram import Datagram, side_of
from protocol.devices.netft.page import FILTERS_HZ, filter_weight
from protocol.devices.netft.records import (
    AXIA,
    FAMILIES,
    INTERNAL_RATE_HZ,
    MONITOR,
    OUT_OF_RANGE,
    SUMMARY,
    WRAP,
    Command,
    decode_request,
    output_step,
    pack_record,
)
from protocol.endpoint import RemoteProtocolError

_COUNT_END = 2**31 - 1
_MOST_AT_ONCE = 64
"""Maximum number of records sent at once. Chosen: after a pause of the computer, more records would overrun a
reader.
"""
_LOAD_MAX = 1.05
"""Load above which an Axia reports that the load is out of range, as a share of its ratings. Two pairs of shares
are added: the force in the sensor's plane with the moment about its axis, and the force along its axis with the
tilting moment. Source: manual 9610-05-EtherCAT Axia-09, 5.2.1.8; assumed: that the shares are added in this way.
"""


@dataclass(slots=True)
class _Stream:
    """Active request for records."""

    next: int
    """Number of the next sample to report."""
    remaining: int | None
    """Total number of records to send; None if the stream continues until a stop."""
    at_once: int
    """Number of records per datagram."""
    side: Hashable
    """Address that sent the request."""
    sent: int = 0
    buffer: list[bytes] = field(default_factory=list)


class NetBox:
    """Box behind its wire, which is `endpoint`. It receives and sends datagrams. An `EmulatedSensor`."""

    def __init__(self, profile: NetFtProfile, source: WrenchSource, powered_at: float, seed: int) -> None:
        self.profile, self._family = profile, FAMILIES[profile.family]
        ratings = np.array((*profile.ratings_n, *profile.ratings_nm))
        ends = np.minimum(ratings * (profile.saturation_share * profile.counts_per_unit), _COUNT_END)
        noise = np.array((*per_axis(profile.noise_n), *per_axis(profile.noise_nm))) * profile.counts_per_unit
        matrix = np.eye(6) * float(profile.counts_per_unit)
        converter = Converter(
            matrix, noise, -ends, ends, unrest=unrest(profile, powered_at), full_scale=ratings
        )
        self._measured = MeasuredWrench(source, self._family.rate_hz, converter, seed, "cell.netft.noise_n")
        weights = [*map(filter_weight, FILTERS_HZ)]
        self.filter = SampleFilter(self._measured, weights, profile.filter, profile.saturation_hold_samples)
        self.endpoint = StampedPackets(self, f"{seed} frames")
        """Box's end of the wire."""
        self._out: list[bytes] = []
        self.bias: Floats = np.zeros(6)
        """Bias subtracted from the counts."""
        self.streams = profile.rdt_enabled
        self.rate_hz: float = profile.rate_hz
        self._every = round(self._family.rate_hz / profile.adc_rate_hz)
        """Ratio of the highest sample rate to the current one."""
        self.buffered_records = profile.buffered_records
        self._latched = False
        self._stream: _Stream | None = None
        self._power_up(powered_at)
        self._faults = OwnFaults()
        self.unmodelled = Unmodelled("netft")
        held, striking = self._faults.held, self._faults.striking
        self.handlers: Mapping[str, Mapping[str, Handler]] = {
            "signal": self._measured.signal.handlers,
            SENSOR_WIRE: self.endpoint.handlers,
            "sensor": {
                **held(("wrong-scales", "unplugged", "slow", "frozen-counter", "status", "saturated")),
                **striking(
                    {
                        "power-cycle": self._power_down,
                        "threshold": self._latch,
                        "biased": self._take_bias,
                        "taken": self._stop,
                    }
                ),
            },
        }

    # --- power

    def _power_up(self, now: float) -> None:
        self.ready_at = now + self.profile.boot_s
        """Time from which the box receives and answers, s."""
        self._first = self._measured.first_after(now)
        """Number of the sample whose ft_sequence is 0."""
        self.filter.restart(self._first)
        self._frozen_ft: int | None = None
        self._stop(now)

    def _power_down(self, now: float) -> None:
        if not self.profile.bias_persistent:
            self.bias = np.zeros(6)
        self._latched = False
        self._out.clear()
        self._power_up(now)

    def sampled_at(self, counter: int) -> float | None:
        """Return the time at which the box measured the sample with this ft_sequence, s."""
        number = self._first + counter * self._every
        return number / self._family.rate_hz if number <= self.filter.newest else None

    # --- endpoint

    def receive(self, data: Sequence[bytes], now: float) -> None:
        """Receive requests. The box does not answer anything else."""
        self._send_due(now)
        if now < self.ready_at or not self.streams:
            return
        for datagram in data:
            try:
                request = decode_request(datagram)
            except RemoteProtocolError:
                continue  # assumed: dropped without an answer
            if request.extended:
                self.unmodelled.touch(
                    "extended request", "dropped: records are sent to the requesting address only"
                )
                continue
            own = self._stream is None or side_of(datagram) == self._stream.side
            if request.command == Command.STOP:
                if own or self.profile.stranger_may_stop:
                    self._stop(now)
            elif request.command in (Command.START, Command.START_BUFFERED):
                self._start(Command(request.command), request.records, now, side_of(datagram))
            elif request.command == Command.RESET_LATCH:
                self._latched = False
            elif request.command == Command.BIAS:
                self._take_bias(now)
                if self.profile.bias_stops_stream:
                    self._stop(now)
            else:
                self.unmodelled.touch(f"command {request.command:#06x}", "dropped")

    def next_event(self) -> None:
        """Return None: a box has no events."""

    def data_to_send(self, now: float) -> Sequence[bytes]:
        """Return the records that are due."""
        out, self._out = self._out, []
        return out

    def next_deadline(self) -> float | None:
        """Return the time at which the next record is due, s."""
        stream = self._stream
        return None if stream is None else stream.next / self._family.rate_hz + self.profile.latency_s

    def last_deadline(self, until: float) -> float:
        """Return the time at which the last record up to `until` is due, s; `until` if there is no stream."""
        stream = self._stream
        if stream is None:
            return until
        newest = self._measured.number_at(until - self.profile.latency_s)
        last = newest - (newest - stream.next) % self.step
        return min(last / self._family.rate_hz + self.profile.latency_s, until)

    def handle_deadline(self, now: float) -> None:
        """Send every record that is due. Each has the time at which it was due."""
        self._send_due(now, _MOST_AT_ONCE)

    # --- requests

    def _start(self, command: Command, records: int, now: float, side: Hashable) -> None:
        newest, step = self._measured.number_at(now), self.step
        at_once = self.buffered_records if command is Command.START_BUFFERED else 1
        self._stream = _Stream(newest + step - (newest - self._first) % step, records or None, at_once, side)

    def _stop(self, now: float) -> None:
        self._stream = None

    def _take_bias(self, now: float) -> None:
        newest = self._measured.number_at(now - self.profile.latency_s)
        if newest > self.filter.newest:
            self.filter.read(newest, self.step)
        if self.filter.output is not None:
            self.bias = np.array(self.filter.output)

    def _latch(self, now: float) -> None:
        self._latched = True

    # --- samples

    def _send_due(self, now: float, most: int = INTERNAL_RATE_HZ) -> None:
        newest, step = self._measured.number_at(now - self.profile.latency_s), self.step
        while (stream := self._stream) is not None and stream.next <= newest and most:
            due = stream.next / self._family.rate_hz + self.profile.latency_s
            self._sample(stream, min(due, now), step)
            most -= 1

    @property
    def adc_rate_hz(self) -> int:
        """Internal sample rate that the page reports, Hz."""
        return self._family.rate_hz // self._every

    def set_adc_rate(self, rate_hz: int, now: float) -> None:
        """Change at once to another sample rate of the family. Sample numbers continue (assumed)."""
        newest = self._measured.number_at(now)
        sent = (newest - self._first) // self._every
        self._every = round(self._family.rate_hz / rate_hz)
        self._first = newest - sent * self._every
        if self._stream is not None:
            self._stream.next = newest + self.step

    @property
    def rate_used_hz(self) -> int:
        """Records per second, an integer."""
        return self._family.rate_hz // self.step

    @property
    def step(self) -> int:
        """Number of samples at the highest rate between two records."""
        return self._every * output_step(self.rate_hz, self._family.rate_hz / self._every)

    def newest(self, now: float) -> int:
        """Return the number of the newest sample."""
        return self._measured.number_at(now)

    @property
    def counts(self) -> tuple[int, ...]:
        """Counts of the last record; without a record, the counts that it would have."""
        return tuple(self._counts_of(self.filter.output or [0.0] * 6))

    def status(self, number: int, now: float) -> int:
        """Return the status word that is sent with the sample of this number."""
        faulty, status = self._faults.any, 0
        if faulty and self._faults.under_way("unplugged", now):
            return self._family.unplugged
        if number <= self.filter.saturated_until or (faulty and self._faults.under_way("saturated", now)):
            status |= self._family.overloaded
        if self._family is AXIA and self._is_out_of_range():
            status |= OUT_OF_RANGE | SUMMARY
        if self._latched:
            status |= MONITOR | (SUMMARY if self.profile.family == "netbox" else 0)
        if faulty and (fault := self._faults.under_way("status", now)) is not None:
            bit = 1 << int(fault.number("bit"))
            status |= bit if bit & self._family.harmless & ~self._family.summarised else bit | SUMMARY
        return status

    def _is_out_of_range(self) -> bool:
        """Return whether the load of the newest sample exceeds an Axia's combined ratings."""
        units = [abs(count) / self.profile.counts_per_unit for count in self.filter.output or [0.0] * 6]
        ratings = (*self.profile.ratings_n, *self.profile.ratings_nm)
        fx, fy, fz, mx, my, mz = (unit / rating for unit, rating in zip(units, ratings, strict=True))
        return max(math.hypot(fx, fy) + mz, fz + math.hypot(mx, my)) > _LOAD_MAX

    def _sample(self, stream: _Stream, now: float, step: int) -> None:
        """Measure the next sample and report it. Records are `step` samples apart."""
        number, state = stream.next, self.filter.output
        ft = (number - self._first) // self._every % WRAP
        if not self._faults.any:  # the usual case
            state = self.filter.read(number, step)
        else:
            if state is None or self._faults.under_way("unplugged", now) is None:
                state = self.filter.read(number, step)
            if (slow := self._faults.under_way("slow", now)) is not None:
                step = max(1, round(step * slow.number("factor")))
            if self._faults.under_way("frozen-counter", now) is None:
                self._frozen_ft = None
            else:
                ft = self._frozen_ft = ft if self._frozen_ft is None else self._frozen_ft
        stream.next += step
        stream.sent += 1
        counts = self._counts_of(state)
        stream.buffer.append(pack_record(stream.sent % WRAP, ft, self.status(number, now), *counts))
        over = stream.remaining == stream.sent
        if over or len(stream.buffer) >= stream.at_once:
            self._out.append(Datagram(b"".join(stream.buffer), now, stream.side))
            stream.buffer.clear()
        if over:
            self._stop(now)

    def _counts_of(self, state: Sequence[float]) -> list[int]:
        """Return the counts of a record: an output of the filter minus the bias, limited to the range of a word."""
        counts = [*map(round, map(sub, state, self.bias.tolist()))]
        if max(counts) > _COUNT_END or min(counts) < -_COUNT_END:
            counts = [max(-_COUNT_END, min(_COUNT_END, count)) for count in counts]
        return counts

    # --- faults

    def reported_scale(self, kind: str, now: float) -> float:
        """Return the factor by which the page falsifies the counts per unit of the forces or the moments."""
        wrong = self._faults.under_way("wrong-scales", now)
        return 1.0 if wrong is None or wrong.values["of"] not in ("all", kind) else wrong.number("factor")
