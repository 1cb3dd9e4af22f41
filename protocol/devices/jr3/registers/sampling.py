"""Requests for samples, by polling or as a stream, and the deliveries that result from them."""

from protocol.devices.jr3.registers.procedure import RequestWriter
from protocol.devices.jr3.registers.profile import BoardClientProfile
from protocol.devices.jr3.registers.samples import SampleLayout
from protocol.devices.jr3.registers.telegrams import RESPONSE, Op, Response, Status, encode_head


class Sampling:
    """State of the sample requests of one session."""

    def __init__(
        self, profile: BoardClientProfile, layout: SampleLayout, writer: RequestWriter, now: float
    ) -> None:
        self._profile, self._layout, self._writer = profile, layout, writer
        self.by_poll = profile.mode == "poll"
        self._timeout = max(profile.data_timeout_s, 5 * profile.period * profile.bursts)
        self._at_once = 1 if self.by_poll else profile.bursts
        self.delivery_size = RESPONSE.size + self._at_once * layout.burst.size
        self._requested_at = self.received_at = now
        self._polls = 0
        self.end()

    def end(self) -> None:
        """Stop expecting samples."""
        self.tag: int | None = None
        """Tag of the request for samples, or None."""
        self.head: bytes | None = None
        """Header of every delivery of the stream, or of the response to a poll."""
        self.waits = False
        """Whether the response to a poll is outstanding."""
        self.check_at: float | None = None
        """Time of the next check for missing samples, s. Checks are infrequent, so that no timer is needed for each
        sample.
        """

    def begin(self, now: float) -> None:
        """Request the stream, or start polling."""
        self._requested_at = self.received_at = now
        self._polls = 0
        self.check_at = now + self._timeout
        if not self.by_poll:
            self._request(Op.STREAM, round(self._profile.period * 1e6))

    @property
    def poll_due(self) -> float:
        """Time at which to send the next poll, s."""
        return self._requested_at + self._polls * self._profile.period

    def poll(self, now: float) -> None:
        """Send a poll for one sample."""
        self.waits = True
        self._polls = max(self._polls, int((now - self._requested_at) / self._profile.period)) + 1
        self._request(Op.READ, 0)

    def _request(self, op: Op, period_us: int) -> None:
        first, words = self._layout.first, self._layout.words
        self.tag = self._writer.write(op, first, words, period_us=period_us)
        self.head = encode_head(Response(op, Status.OK, self.tag, first, words), self._at_once)

    def check(self, sampled_at: float, counter: int | None, now: float) -> tuple[str, str]:
        """Return the fault and its remedy if no sample has arrived since `sampled_at`, s. Both are empty before the
        time-out.
        """
        if now < sampled_at + self._timeout:
            self.check_at = sampled_at + self._timeout
            return "", ""
        if now < self.received_at + self._timeout:
            return f"its counter has been stuck at {counter} for {self._timeout:g} s", "does its program run?"
        return f"no data for {self._timeout:g} s", "server or network stuck?"
