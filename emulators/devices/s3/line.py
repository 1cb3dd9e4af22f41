"""Controller's end of the link with its faults: a filter between the link and the wire.

The link is unaware of faults: it has sent the bytes that are lost here, and it receives the bytes that are damaged
here.
"""

import random
from collections.abc import Callable, Sequence
from enum import StrEnum
from typing import Literal

from emulators.faults.ledger import Injection
from protocol.devices.s3.adlp import (
    LENGTH_STYLES,
    Block,
    BlockFormat,
    BlockScanner,
    Control,
    Link,
    LinkEvent,
    LinkProfile,
    Role,
    State,
)
from protocol.devices.s3.arap import FunctionCode

SpontaneousEot = Literal["always", "sometimes", "never"]

_BREAK = b"\0"
"""Byte that a receiver reads during a break on the line. Mark: standard."""
_FUNCTION_BYTE = 4


class Strike(StrEnum):
    """Faults of the line that can be armed, each with the name of the fault."""

    DROP_BLOCK_ACK = "drop-ack of a block"
    DROP_BID_ACK = "drop-ack of a bid"
    DAMAGE_BLOCK = "nak-block"
    CORRUPT_BLOCK = "corrupt-block"
    LOSE_EOT = "lose-eot"


class FaultyLine:
    """Endpoint of bytes around a robot's `Link`. Without a fault it passes all bytes on.

    `on_reset` is called when a reset requested by `reset_after` is due.
    """

    def __init__(
        self,
        profile: LinkProfile,
        spontaneous_eot: SpontaneousEot,
        seed: int,
        on_reset: Callable[[float], None],
    ) -> None:
        self._profile = profile
        self._spontaneous_eot = spontaneous_eot
        self._random = random.Random(f"line {seed}")
        self._on_reset = on_reset
        self._link = Link(Role.ROBOT, profile)
        self._off_until = float("-inf")
        self._extra = bytearray()
        self._offs: list[Injection] = []
        """Active faults that block all bytes."""
        self._armed: dict[Strike, Injection] = {}
        """Armed faults. Their `count` is the number of times they will occur."""
        self._watch: BlockScanner | None = None
        """Parser of the incoming bytes while a fault that damages a block is armed."""
        self._reset_after: int | None = None
        self._spontaneous = False
        """Whether the newest block sent was spontaneous."""

    @property
    def armed(self) -> dict[str, int]:
        """Armed faults by name, each with the number of times it will occur."""
        waiting = {
            str(strike): int(injection.number("count")) - injection.struck
            for strike, injection in self._armed.items()
        }
        return waiting if self._reset_after is None else {**waiting, "power-cycle": 1}

    def send(self, blocks: Sequence[bytes]) -> None:
        """Queue a message. Raises the errors of `Link.send`."""
        self._link.send(blocks)

    # --- endpoint

    def receive(self, data: bytes, now: float) -> None:
        """Receive bytes from the line."""
        if now < self._off_until:
            self._count_lost(data, now)
            return
        self._link.receive(self._damaged(data, now) if Strike.DAMAGE_BLOCK in self._armed else data, now)

    def next_event(self) -> LinkEvent | None:
        """Return the link's oldest unread event, or None."""
        return self._link.next_event()

    def data_to_send(self, now: float) -> bytes:
        """Return bytes for the line."""
        data = self._link.data_to_send(now)
        if data and (self._armed or self._spontaneous_eot != "always"):
            data = self._corrupt(data, now)
        if now < self._off_until:
            self._count_lost(data, now)
            data = b""
        if self._extra:
            data = bytes(self._extra) + data
            self._extra.clear()
        if self._reset_after is not None and data:
            data, left = data[: self._reset_after], self._reset_after - len(data)
            self._reset_after = max(left, 0)
            if left <= 0:
                self._reset_after = None
                self._on_reset(now)
        return data

    def next_deadline(self) -> float | None:
        """Return the time of the link's next timeout, s."""
        return self._link.next_deadline()

    def handle_deadline(self, now: float) -> None:
        """Process the link's timeouts up to now."""
        self._link.handle_deadline(now)

    # --- faults

    def arm(self, strike: Strike, injection: Injection) -> None:
        """Arm a fault for its next `count` opportunities."""
        self._armed[strike] = injection

    def disarm(self) -> None:
        """Cancel all armed faults and a requested reset."""
        self._armed.clear()
        self._reset_after = None

    def babble(self, size: int) -> None:
        """Send random bytes."""
        self._extra += self._random.randbytes(size)

    def switch_off(self, injection: Injection) -> None:
        """Neither receive nor send anything until the fault ends."""
        assert injection.ends_at is not None
        self._off_until = max(self._off_until, injection.ends_at)
        self._offs.append(injection)

    def switch_on(self, injection: Injection, now: float) -> None:
        """End a fault that blocks all bytes. Other such faults may remain active."""
        self._offs = [other for other in self._offs if other.holds(now)]
        if self._off_until == injection.ends_at:
            ends = (other.ends_at for other in self._offs if other.ends_at is not None)
            self._off_until = max(ends, default=now)

    def hold_in_break(self, injection: Injection) -> None:
        """Hold a break on the line until the fault ends."""
        self._extra += _BREAK
        injection.struck += len(_BREAK)
        self.switch_off(injection)

    def reset_after(self, size: int) -> None:
        """Request a reset after this many more bytes have been sent."""
        self._reset_after = size

    def restart(self, until: float) -> None:
        """Discard all exchanges, and neither receive nor send until the time `until`, s. Armed faults remain armed."""
        self._link = Link(Role.ROBOT, self._profile)
        self._watch = None
        self._off_until = until

    def _count_lost(self, data: bytes, now: float) -> None:
        """Count the bytes that active faults block."""
        self._offs = [injection for injection in self._offs if injection.holds(now)]
        for injection in self._offs:
            injection.struck += len(data)

    def _strikes(self, strike: Strike, now: float) -> bool:
        injection = self._armed.get(strike)
        if injection is None:
            return False
        injection.strike(now)
        if injection.ended_at is not None:
            del self._armed[strike]
        return True

    def _damaged(self, data: bytes, now: float) -> bytes:
        """Return the incoming bytes, with the check character of a block made invalid if that fault is armed."""
        if self._watch is None:
            if self._link.state is not State.IDLE:
                return data  # in the middle of a message, the start of a block is unknown
            self._watch = BlockScanner(
                BlockFormat(
                    self._profile.dle_stuffing,
                    LENGTH_STYLES,
                    self._profile.max_telegram,
                    self._profile.block_end,
                )
            )
        spoiled = bytearray(data)
        for at, byte in enumerate(data):
            for token in self._watch.feed(bytes((byte,))):
                if isinstance(token, Block) and self._strikes(Strike.DAMAGE_BLOCK, now):
                    spoiled[at] ^= 0xFF
        if Strike.DAMAGE_BLOCK not in self._armed:
            self._watch = None
        return bytes(spoiled)

    def _corrupt(self, data: bytes, now: float) -> bytes:
        """Apply the armed faults to outgoing bytes, which are complete blocks and control bytes."""
        scanner = BlockScanner(
            BlockFormat(self._profile.dle_stuffing, LENGTH_STYLES[:1], self._profile.max_telegram)
        )
        bid = self._link.state is State.AWAITING_BLOCK
        acknowledges = Strike.DROP_BID_ACK if bid else Strike.DROP_BLOCK_ACK
        out = bytearray()
        at = 0
        for token in scanner.feed(data):
            size = token.size if isinstance(token, Block) else 1
            part = bytearray(data[at : at + size])
            at += size
            if isinstance(token, Block):
                self._spontaneous = token.telegram[_FUNCTION_BYTE] == FunctionCode.SPONTANEOUS
                if self._strikes(Strike.CORRUPT_BLOCK, now):
                    part[-1] ^= 0xFF
            lost = (token is Control.ACK and self._strikes(acknowledges, now)) or (
                token is Control.EOT and self._eot_is_lost(now)
            )
            if not lost:
                out += part
        return bytes(out)

    def _eot_is_lost(self, now: float) -> bool:
        if self._spontaneous and self._spontaneous_eot != "always":
            return self._spontaneous_eot == "never" or self._random.random() < 0.5
        return self._strikes(Strike.LOSE_EOT, now)
