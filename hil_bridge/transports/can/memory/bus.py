"""CAN bus inside one event loop, with the bit times, arbitration, acknowledgement and errors of a real bus."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from hil_bridge.clock import Clock, Timer
from hil_bridge.transports.can.memory.disturbance import Disturbance
from hil_bridge.transports.can.memory.node import MemoryCanNode
from protocol.can.error import ErrorState
from protocol.can.frame import CanFilter, CanFrame
from protocol.can.line import (
    ACK_DELIMITER_BITS,
    BUS_FREE_BITS,
    END_OF_FRAME_BITS,
    ERROR_DELIMITER_BITS,
    ERROR_FLAG_BITS,
    INTERMISSION_BITS,
    SUSPEND_BITS,
    arbitration_rank,
    frame_time_bits,
)

BITRATE = 1_000_000
"""Default bit rate, bit/s."""


@dataclass(slots=True)
class _Attempt:
    """Attempt to send a frame, or its repetitions while no node acknowledges it."""

    sender: MemoryCanNode
    frame: CanFrame
    receivers: list[MemoryCanNode]
    start: int
    """Bit time of the start of frame."""
    bits: int
    """Duration of the attempt without the intermission, bit times."""
    end: int
    """Bit time of the end of the attempt."""
    failed: bool = False
    acknowledge_missing: bool = False
    accepted: bool = True
    """Whether the receivers accept the frame, even if the attempt has failed for its sender."""
    repeats: int = 1

    @property
    def cycle(self) -> int:
        """Time between the starts of two repetitions of an error-passive node, bit times."""
        return self.bits + INTERMISSION_BITS + SUSPEND_BITS

    def repeat(self, times: int) -> None:
        """Repeat the frame, `times` times in total."""
        self.repeats = times
        self.end = self.start + (times - 1) * self.cycle + self.bits


def _spoil(attempt: _Attempt, hit: int | None) -> None:
    """Disturb the attempt at the bit `hit`, counted in a complete frame. If there is no receiver, the ACK is
    missing.
    """
    length = attempt.bits
    acknowledge = length - ACK_DELIMITER_BITS - END_OF_FRAME_BITS
    missing = not attempt.receivers and (hit is None or hit > acknowledge)
    failed_at = acknowledge if missing else hit
    attempt.failed, attempt.acknowledge_missing = failed_at is not None, missing
    # in the last bit, it is too late for a receiver to reject the frame
    attempt.accepted = failed_at is None or failed_at == length
    if failed_at is not None:
        attempt.bits = failed_at + ERROR_FLAG_BITS + ERROR_DELIMITER_BITS
        attempt.end = attempt.start + attempt.bits


class MemoryCanBus:
    """CAN bus with any number of nodes.

    Each node sends its own frames in order. Of the waiting frames, the frame that wins the arbitration is sent
    first. The other nodes receive it at the end of its end of frame, stamped with that time. A frame that is
    disturbed or not acknowledged is followed by an error frame and sent again. The nodes count errors, become error
    passive, go bus-off and recover as ISO 11898-1 specifies.

    Simplified: all nodes detect a disturbance in the same bit, so that their error flags coincide. A node that
    leaves during a frame has acknowledged it. Two nodes that send the same identifier at once would destroy each
    other's frames; here they take turns, and `collisions` counts this.
    """

    def __init__(self, clock: Clock, bitrate: int = BITRATE, name: str = "can+memory:bus") -> None:
        self.name = name
        self.bitrate = bitrate
        self.errors = 0
        """Number of error frames."""
        self.collisions = 0
        """Number of times that two nodes sent the same identifier at once."""
        self._disturb: Disturbance | None = None
        self._clock = clock
        self._nodes: list[MemoryCanNode] = []
        self._opened = self._begun = clock.now()
        """Time at which the bus was created, and start of the present uninterrupted traffic, s."""
        self._bits = 0
        """Bit times from the start of the present traffic to the earliest start of the next frame."""
        self._start = 0
        """Bit time of the next arbitration."""
        self._busy = 0
        """Total bit times of completed frames, error frames and intermissions."""
        self._attempt: _Attempt | None = None
        self._timer: Timer | None = None
        """Timer of the end of the attempt, of the next arbitration, or of the next recovery from bus-off."""
        self._suspended: MemoryCanNode | None = None
        """Error-passive sender of the last frame. All other nodes have priority over it."""
        self._free_since: float | None = None
        """Time at which the bus became free while a node is bus-off, s."""
        self._calling_back = False

    @property
    def empty(self) -> bool:
        """Whether no node is connected."""
        return not self._nodes

    @property
    def disturb(self) -> Disturbance | None:
        """Function that disturbs frames. It may be replaced at any time, with effect from the next frame on."""
        return self._disturb

    @disturb.setter
    def disturb(self, disturb: Disturbance | None) -> None:
        self._disturb = disturb
        if self._is_ahead():
            self._joins()

    def now(self) -> float:
        """Time of the bus, s."""
        return self._clock.now()

    def load(self) -> float:
        """Share of the time since opening for which the bus was busy, percent."""
        elapsed = self._clock.now() - self._opened
        return 100.0 * self.busy_s / elapsed if elapsed > 0.0 else 0.0

    @property
    def busy_s(self) -> float:
        """Total time for which the bus was busy with completed traffic, s. The difference between two values gives
        the load of any interval.
        """
        return self._busy / self.bitrate

    def connect(self, accept: Sequence[CanFilter] = ()) -> MemoryCanNode:
        """Connect a new node. It receives the frames that match one of the filters, or all frames if there are no
        filters.
        """
        node = MemoryCanNode(self, accept)
        self._nodes.append(node)
        if not self._joins():
            self._cut_repeats()
        return node

    def disconnect(self, node: MemoryCanNode) -> None:
        """Remove a node from the bus."""
        self._nodes.remove(node)
        if self._is_ahead():
            self._attempt = None
            self._schedule(self._clock.now())

    def wake(self, node: MemoryCanNode) -> None:
        """Handle a node that has a frame to send."""
        # otherwise the end of the attempt, of the callbacks or of bus-off handles it
        if node.on_bus and not self._calling_back and not self._joins() and self._attempt is None:
            self._schedule(self._clock.now())

    def _at(self, bits: int) -> float:
        return self._begun + bits / self.bitrate

    def _is_ahead(self) -> bool:
        """Return whether the next frame has been selected and has not begun."""
        return self._attempt is not None and self._clock.now() < self._at(self._attempt.start)

    def _joins(self) -> bool:
        """Arbitrate again for a node that joins before the start of a frame. Return whether there is such a frame."""
        attempt = self._attempt
        if attempt is None or self._calling_back or self._clock.now() > self._at(attempt.start):
            return False
        self._start = attempt.start
        self._arbitrate()
        return True

    def _schedule(self, not_before: float) -> None:
        """Start the next frame as soon as the bus is free."""
        if self._timer is not None:
            self._set_timer(None)
        if self._free_since is not None:
            self._count_free_time()
        waiting = self._waiting()
        if not waiting:
            self._rest()
            return
        suspended = self._suspended
        start = self._bits + (SUSPEND_BITS if suspended is not None and waiting == [suspended] else 0)
        at = self._begun + start / self.bitrate
        if at < not_before:
            self._begun, self._bits, start, at = not_before, 0, 0, not_before
        self._start = start
        at_once = at <= self._clock.now()
        # While there is only one node, neither arbitration nor its timer is needed. But a node that is
        # bus-off may have frames to drop at an arbitration.
        if (
            len(waiting) == 1
            and suspended is None
            and self._disturb is None
            and waiting[0].queue.give_up_at > at
            and not (at_once and self._any_node_off())
        ):
            self._bits = start
            self._begin(waiting)
        elif at_once:
            self._arbitrate()
        else:
            self._set_timer(start)

    def _arbitrate(self) -> None:
        if self._timer is not None:
            self._set_timer(None)
        self._attempt = None
        self._bits = self._start
        at = self._at(self._bits)
        self._calling_back = True
        try:
            for node in tuple(self._nodes):
                if node.queue.frames and node.queue.give_up_at <= at:
                    node.give_up(at)
        finally:
            self._calling_back = False
            waiting = self._waiting()
            if waiting:
                if self._suspended is not None:
                    waiting = [node for node in waiting if node is not self._suspended] or waiting
                self._begin(waiting)
            else:
                self._rest()

    def _begin(self, contenders: list[MemoryCanNode]) -> None:
        sender = contenders[0]
        if len(contenders) > 1:
            ranks = [arbitration_rank(node.queue.head) for node in contenders]
            best = [node for node, rank in zip(contenders, ranks, strict=True) if rank == min(ranks)]
            self.collisions += len(best) - 1
            sender = min(best, key=lambda node: node.queue.progress)
        frame = sender.queue.head
        receivers = [node for node in self._nodes if node is not sender and node.on_bus]
        start, disturb, length = self._bits, self._disturb, frame_time_bits(frame)
        attempt = _Attempt(sender, frame, receivers, start, length, start + length)
        if not receivers or disturb is not None:
            _spoil(attempt, None if disturb is None else disturb(frame, length))
            if attempt.acknowledge_missing and disturb is None and len(self._nodes) == 1:
                self._repeat_alone(attempt)
        self._attempt, self._suspended = attempt, None
        self._timer = self._clock.call_at(self._begun + attempt.end / self.bitrate, self._over)

    def _repeat_alone(self, attempt: _Attempt) -> None:
        """Skip the repetitions until another node joins or the frame is dropped, because nothing can change before
        then.
        """
        if attempt.sender.state is ErrorState.PASSIVE:
            left = (attempt.sender.queue.give_up_at - self._at(attempt.start)) * self.bitrate
            attempt.repeat(max(1, math.ceil(left / attempt.cycle)))

    def _cut_repeats(self) -> None:
        """Handle a new node. The repetition in progress is the last one that the new node does not acknowledge."""
        attempt = self._attempt
        if attempt is not None and attempt.repeats > 1:
            passed = (self._clock.now() - self._at(attempt.start)) * self.bitrate
            attempt.repeat(min(attempt.repeats, 1 + int(passed / attempt.cycle)))
            self._set_timer(attempt.end)

    def _over(self) -> None:
        attempt = self._attempt
        assert attempt is not None
        self._attempt = self._timer = None
        at = self._begun + attempt.end / self.bitrate
        self._bits = attempt.end + INTERMISSION_BITS
        self._busy += attempt.repeats * (attempt.bits + INTERMISSION_BITS)
        self._calling_back = True
        try:
            if attempt.sender in self._nodes:
                self._tell(attempt, at)
        finally:
            self._calling_back = False
            if self._any_node_off():
                # a frame ends in eleven recessive bits, and so does an error frame
                self._count_sequences(attempt.repeats)
                self._recover(at)
            self._schedule(self._at(self._bits))

    def _tell(self, attempt: _Attempt, at: float) -> None:
        """Deliver the frame to all nodes, or let them count the error."""
        sender, sent = attempt.sender, attempt.frame
        if attempt.failed:
            self.errors += attempt.repeats
            sender.send_failed(attempt.acknowledge_missing, at, attempt.repeats)
            sender.give_up(at)
        else:
            sender.frame_sent(at)
        if sender.state is ErrorState.PASSIVE:
            self._suspended = sender
        nodes, frame = self._nodes, sent.stamped(at)
        for node in attempt.receivers:
            if node not in nodes:
                continue
            if attempt.accepted:
                node.frame_received(frame, at)
            else:
                node.receive_failed(at)

    def _any_node_off(self) -> bool:
        """Return whether a node is bus-off."""
        for node in self._nodes:  # noqa: SIM110 (a generator costs more)
            if not node.on_bus:
                return True
        return False

    def _waiting(self) -> list[MemoryCanNode]:
        return [node for node in self._nodes if node.queue.frames and node.on_bus]

    def _rest(self) -> None:
        """Handle an idle bus. A node that is bus-off recovers when the bus has been free for long enough."""
        needed = [node.recovery for node in self._nodes if not node.on_bus]
        if needed:
            self._free_since = max(self._at(self._bits), self._clock.now())
            when = self._free_since + min(needed) * BUS_FREE_BITS / self.bitrate
            self._timer = self._clock.call_at(when, self._come_back)

    def _come_back(self) -> None:
        self._timer = None
        if self._free_since is not None:
            self._count_free_time()
        self._recover(self._clock.now())
        self._schedule(self._clock.now())

    def _count_free_time(self) -> None:
        assert self._free_since is not None
        free = (self._clock.now() - self._free_since) * self.bitrate
        self._free_since = None
        # a rounding error of the time must not cost a complete sequence
        self._count_sequences(int(free / BUS_FREE_BITS + 1e-6))

    def _count_sequences(self, sequences: int) -> None:
        for node in self._nodes:
            if not node.on_bus:
                node.recovery -= sequences

    def _recover(self, at: float) -> None:
        self._calling_back = True
        try:
            for node in tuple(self._nodes):
                if not node.on_bus and node.recovery <= 0:
                    node.recover(at)
        finally:
            self._calling_back = False

    def _set_timer(self, bits: int | None) -> None:
        """Replace the timer by a timer for this bit time, or by none."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if bits is not None:
            self._timer = self._clock.call_at(
                self._at(bits), self._arbitrate if self._attempt is None else self._over
            )
