"""One direction of a serial line. Bytes take time, and the receiver reads them with its own settings."""

from collections.abc import Callable
from typing import NamedTuple

from hil_bridge.clock import Clock, Timer
from hil_bridge.transports.delivery import QUEUE_BYTES
from hil_bridge.transports.serial.uart import (
    COUNTED_AS,
    Character,
    Damaged,
    Flaw,
    LineErrors,
    LineSettings,
    Receiver,
    taken,
)


class ReceivingEnd(NamedTuple):
    """Receiving end of a serial line."""

    settings: Callable[[], LineSettings]
    """Returns the present settings of the receiving end."""
    damaged: Damaged
    sink: Callable[[bytes], None]
    """Receives the bytes. Called with no bytes if time has passed on the line without bytes for the owner."""
    on_flaw: Callable[[Flaw], None]


class SerialDirection:
    """Queue of bytes that wait for the serial line.

    Bytes are delivered in chunks, as by the FIFO of a receiver. They are decoded bit by bit only if the settings of
    the two ends differ.
    """

    __slots__ = (
        "_alike",
        "_baudrate",
        "_begun",
        "_bits",
        "_clock",
        "_damaged",
        "_fifo",
        "_next",
        "_on_flaw",
        "_passed",
        "_receiver",
        "_receiver_settings",
        "_sender_settings",
        "_sent_at",
        "_sink",
        "_timer",
        "errors",
        "waiting",
    )

    def __init__(
        self,
        clock: Clock,
        fifo: int,
        sender_settings: Callable[[], LineSettings],
        receiver: ReceivingEnd,
    ) -> None:
        """Create a direction. `sender_settings` returns the present settings of the sending end."""
        self._clock = clock
        self._fifo = fifo
        self._sender_settings = sender_settings
        self._receiver_settings, self._damaged, self._sink, self._on_flaw = receiver
        self._receiver = Receiver(receiver.settings())
        self._take_settings(sender_settings())
        self.errors = LineErrors()
        """Counts of damaged characters that the receiver has detected."""
        self.waiting = bytearray()
        self._begun = 0.0
        """Time of the first start bit of the present uninterrupted traffic, s."""
        self._passed = 0
        """Number of delivered characters of the present uninterrupted traffic."""
        self._next = 0
        """Number of characters to deliver when the timer expires; 0 if the timer belongs to the receiver."""
        self._timer: Timer | None = None

    def push(self, data: bytes) -> bool:
        """Queue bytes for the line. If the queue has no room for all of them, queue none and return False. New
        settings of a sender apply from the next burst on.
        """
        if len(self.waiting) + len(data) > QUEUE_BYTES:
            return False
        if not data:
            return True
        if not self.waiting:
            self._begun, self._passed = self._clock.now(), 0
            if (settings := self._sender_settings()) is not self._sent_at:
                self._take_settings(settings)
            if not self._receiver.quiet:
                self._hear(self._begun)
        self.waiting += data
        if self._timer is None or self._next < min(len(self.waiting), self._fifo):
            self._arm()
        return True

    async def drained(self) -> None:
        """Return when the last bit has been transmitted."""
        while self.waiting:
            await self._clock.sleep_until(self._at(self._passed + len(self.waiting)))

    def clear(self) -> None:
        """Discard the characters on the line."""
        self.waiting.clear()
        self._receiver = Receiver(self._receiver.settings)
        self._disarm()

    def hold(self, low: bool, delay: float = 0.0) -> None:
        """Begin or end a break after a delay, s. Characters that are sent during a break are not received."""
        now = self._clock.now()
        self._settle(now)
        self._receiver.hold(low, now + delay)
        self._hear(now)
        self._arm()

    def _take_settings(self, settings: LineSettings) -> None:
        self._sent_at = settings
        self._bits, self._baudrate = settings.bits, settings.baudrate
        self._alike = self._receiver.settings.understands(settings)

    def _at(self, characters: int) -> float:
        return self._begun + characters * self._bits / self._baudrate

    def _disarm(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _arm(self) -> None:
        if self._timer is not None:
            self._disarm()
        waiting = len(self.waiting)
        self._next = following = waiting if waiting < self._fifo else self._fifo
        # the receiver completes a character without further edges only if no other character can follow
        when = self._at(self._passed + following) if following else self._receiver.deadline
        if when is not None:
            self._timer = self._clock.call_at(when, self._due)

    def _due(self) -> None:
        self._timer = None
        try:
            if self._next:
                self._hand_on(self._next)
            else:
                # a timer may expire a rounding step early
                now = self._clock.now()
                self._hear(max(now, self._receiver.deadline or now))
        finally:
            if self._timer is None:
                self._arm()

    def _settle(self, now: float) -> None:
        """Deliver every character whose last bit has been transmitted."""
        if self.waiting:
            complete = int((now - self._begun) * self._baudrate / self._bits) - self._passed
            self._hand_on(max(0, min(complete, len(self.waiting))))

    def _hand_on(self, count: int) -> None:
        if count == len(self.waiting):
            data = bytes(self.waiting)
            self.waiting.clear()
        else:
            data = bytes(self.waiting[:count])
            del self.waiting[:count]
        first, self._passed = self._passed, self._passed + count
        if (receiver_settings := self._receiver_settings()) is not self._receiver.settings:
            self._receiver.retune(receiver_settings)
            self._alike = receiver_settings.understands(self._sent_at)
        if self._alike and self._receiver.quiet:
            self._sink(data)
            return
        for k, byte in enumerate(data):
            self._receiver.character(byte, self._at(first + k), self._sent_at)
        self._hear(self._at(self._passed))

    def _hear(self, until: float) -> None:
        characters = self._receiver.listen(until)
        for character in characters:
            self._count(character)
        self._sink(taken(characters, self._damaged))

    def _count(self, character: Character) -> None:
        if character.flaw is not None:
            self.errors += COUNTED_AS[character.flaw]
            self._on_flaw(character.flaw)
