"""Client of a Net F/T: reads its configuration page, requests the stream, and monitors both sequence numbers and
the status.

It never biases the sensor; the host subtracts the zero. The page arrives as a `Page` among the datagrams.
"""

from collections.abc import Sequence

from protocol.arrival_clock import ArrivalClock
from protocol.datagram import arrived_at
from protocol.devices.netft.http import Page
from protocol.devices.netft.page import Configuration, parse_page
from protocol.devices.netft.profile import NetFtClientProfile
from protocol.devices.netft.rate import APART, RateWatch, nearest_known
from protocol.devices.netft.records import (
    FAMILIES,
    INTERNAL_RATE_HZ,
    RECORD_SIZE,
    WRAP,
    Command,
    encode_request,
    unpack_record,
)
from protocol.endpoint import RemoteProtocolError
from protocol.outbox import Outbox
from protocol.sensor_events import SensorEventQueue
from protocol.wrench import SensorFacts, SensorStatistics

_STOP_AGAIN_S = 0.02
"""Time after which a stop is repeated while records still arrive, s. Chosen."""
_STOPS = 4
_USUAL_PERIOD_S = 0.001
"""Period of a box whose page does not report one, s, for the number of samples in a zero. Assumed."""
_BEHIND_LIMIT = 10
"""Number of consecutive records older than the newest record that mean that the sensor was restarted. Chosen: fewer
are stragglers.
"""
_BACKWARD = WRAP // 2
_ALL_AXES = 0b111111


class NetFtClient(Outbox[bytes]):
    """`SensorClient` over datagrams."""

    stop_patience = _STOPS * _STOP_AGAIN_S

    def __init__(self, profile: NetFtClientProfile, now: float) -> None:
        self.statistics = SensorStatistics()
        self._profile, self._family = profile, FAMILIES[profile.family]
        self._sensor_events = events = SensorEventQueue()
        self.next_event, self.zero = events.next_event, events.zero
        super().__init__()
        self._configuration: Configuration | None = None
        self._page_failure = "no answer"
        self._due: float | None = now + profile.page_patience_s
        """End of the current time-out, s, or None."""
        self._step = 1
        """Number of internal samples between two records."""
        self._requests = 0
        """Number of requests for the stream since the last record."""
        self._rdt = self._ft = self._sequence = 0
        """RDT and F/T sequence numbers of the newest record, and the unwrapped F/T sequence number."""
        self._behind = 0
        """Number of consecutive records older than the newest record."""
        self._clock = ArrivalClock()
        self._rates = RateWatch(profile.internal_rate_hz)
        self._stops = 0
        """Number of stops sent."""
        self._has_received = False
        """Whether a record has arrived since the last stop."""

    # --- Endpoint

    def receive(self, data: Sequence[bytes], now: float) -> None:
        """Process records and the configuration page."""
        for datagram in data:
            if isinstance(datagram, Page):
                self._process_page(datagram, now)
            elif len(datagram) != RECORD_SIZE:
                self.statistics.malformed += 1
            elif self._stops:
                self._has_received = True
            elif self._configuration is not None and not self._sensor_events.ended:
                self._process_record(datagram, now)

    def handle_deadline(self, now: float) -> None:
        """Repeat the request, or report a failure."""
        if self._due is None or now < self._due:
            return
        if self._stops:
            self._stop_again(now)
        elif self._configuration is None:
            self._fail(
                f"its configuration page was not received within {self._profile.page_patience_s:g} s: "
                f"{self._page_failure}",
                "check its supply, its address and the port of its page",
            )
        elif self._requests >= self._profile.starts:
            self._fail(
                f"no record received after {self._requests} requests",
                "check its supply and its cable, and whether another program reads it",
            )
        else:
            if self._sensor_events.ready and not self._requests:
                self._sensor_events.notice(
                    f"no record for {self._profile.silence_s * 1e3:g} ms; requested again"
                )
            self._start(now)

    def stop(self) -> None:
        """Stop the stream. The stop is repeated while records still arrive."""
        if self._sensor_events.ended or self._stops:
            return
        if self._configuration is None:
            self._finish()
            return
        self._stops, self._has_received = 1, False
        self._due = 0.0
        self._out.append(encode_request(Command.STOP))

    # --- configuration page

    def _process_page(self, page: Page, now: float) -> None:
        if self._configuration is not None or self._sensor_events.ended:
            return
        if page.failure:
            self._page_failure = page.failure
            return
        try:
            configuration = parse_page(page)
        except RemoteProtocolError as error:
            self._fail(str(error), "check the address and the sensor's own pages")
            return
        if not configuration.streams:
            self._fail(
                "its raw data transfer (RDT) is switched off", "enable it on its page Communication Settings"
            )
            return
        rate = configuration.internal_rate_hz
        if rate is not None and abs(rate / self._profile.internal_rate_hz - 1.0) > APART:
            self._fail_for_rate("its page tells", rate)
            return
        self._configuration = configuration
        period = configuration.period or _USUAL_PERIOD_S
        self._step = max(1, round(period * self._profile.internal_rate_hz))
        self._sensor_events.set_zero_samples(max(1, round(self._profile.zero_s / period)))
        self._start(now)

    # --- stream

    def _start(self, now: float) -> None:
        self._out.append(encode_request(Command.START))
        self._requests += 1
        self._due = now + self._profile.silence_s

    def _process_record(self, datagram: bytes, now: float) -> None:
        rdt, ft, status, fx, fy, fz, tx, ty, tz = unpack_record(datagram)
        arrived = arrived_at(datagram, now)
        self._due = arrived + self._profile.silence_s
        saturated, events, family = 0, self._sensor_events, self._family
        if status and not events.knows_status(status):
            text = f"status {status:08X}: {family.words(status)}"
            if not (events.ready or status & family.saturated or family.is_warning(status)):
                self._fail(f"it reports {text}", "check its own pages")
                return
            events.notice_status(status, text)
        if status and not family.is_warning(status):
            saturated = _ALL_AXES  # the values are invalid, so a run retracts
        if not events.ready:
            self._rdt, self._ft, self._sequence = rdt, ft, ft
            events.begin(self._facts())
            self._rates.begin(ft, arrived)
        elif not self._is_next(rdt, ft):
            return
        elif rate := self._rates.take(self._sequence, arrived):
            self._fail_for_rate("it takes about", nearest_known(rate))
            return
        self._requests = self._behind = self.statistics.standing = 0
        counted = self._sequence / self._profile.internal_rate_hz
        at = self._clock.sent_at(counted, arrived)
        events.numbered_sample((fx, fy, fz, tx, ty, tz), ft, self._sequence, at, saturated)

    def _is_next(self, rdt: int, ft: int) -> bool:
        """Return whether a record is newer than the newest one so far. Count missing and outdated records."""
        step = (ft - self._ft) % WRAP
        if not 0 < step < _BACKWARD:
            self.statistics.repeated += 1
            if not step:
                self.statistics.standing += rdt != self._rdt
                self._rdt = rdt
                return False
            self._behind += 1
            if not self._requests and self._behind < _BEHIND_LIMIT:
                return False
            self._sensor_events.restart()
            step = 1
            self._rates.begin(self._sequence + 1, self._clock.arrived_at)
        else:
            missing = (rdt - self._rdt) % WRAP - 1
            if missing >= _BACKWARD:  # the stream was requested again, and its records count from 1
                missing = step // self._step - 1
            self.statistics.lost += max(missing, 0)
        self._rdt, self._ft = rdt, ft
        self._sequence += step
        return True

    def _facts(self) -> SensorFacts:
        configuration = self._configuration
        assert configuration is not None
        return SensorFacts(
            configuration.product,
            configuration.scales,
            configuration.ratings,
            None,
            configuration.period,
            configuration.delay,
            "host",
        )

    # --- end

    def _stop_again(self, now: float) -> None:
        if (self._stops > 1 and not self._has_received) or self._stops >= _STOPS:
            self._finish()
            return
        if self._has_received:
            self._out.append(encode_request(Command.STOP))
        self._stops, self._has_received = self._stops + 1, False
        self._due = now + _STOP_AGAIN_S

    def _finish(self) -> None:
        self._due = None
        self._sensor_events.stop()

    def _fail_for_rate(self, begin: str, rate_hz: float) -> None:
        of = "netbox" if abs(rate_hz / INTERNAL_RATE_HZ - 1.0) < APART else "axia"
        family = "" if of == self._profile.family else f'family to "{of}" and '
        self._fail(
            f"{begin} {rate_hz:g} internal samples a second, and internal_rate_hz is "
            f"{self._profile.internal_rate_hz:g}: the age of a force would be wrong",
            f"set {family}internal_rate_hz in [sensor.netft] to {rate_hz:g}",
        )

    def _fail(self, text: str, remedy: str = "") -> None:
        self._due = None
        self._out.append(encode_request(Command.STOP))
        self._sensor_events.fail(text, remedy)
