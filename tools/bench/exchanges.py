"""Packets and their answers, from what `c/relay.c` stamped: how long each packet waited.

An answer counts for its own packet and for all older ones that have none yet, since these were passed over: that they
waited too is not to be left out. Packets before the first answer do not count, nor those behind the last one.
"""

import struct
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

from protocol.devices.egm.messages import decode_answer, decode_robot
from protocol.devices.rtde.packets import Kind, Reader
from protocol.devices.s3.adlp import BLOCK_OVERHEAD, Control, LinkProfile

RECORD = struct.Struct("=dII")
"""Time, way and size, as `struct record` of the relay."""
PACKET, ANSWER = 0, 1
"""Ways."""
ORDER_BYTES = 1 + BLOCK_OVERHEAD + LinkProfile().move_length
"""The ENQ that bids for the line, and the block of a move."""


class Chunk(NamedTuple):
    """Bytes that the relay forwarded at once."""

    at: float
    """On the monotonic clock, s."""
    way: int
    data: bytes


class Message(NamedTuple):
    """A packet or an answer."""

    at: float
    way: int
    number: int
    """An answer has the number of its packet."""
    size: int


class Exchange(NamedTuple):
    """A packet that was answered."""

    at: float
    """When it went out, on the monotonic clock, s."""
    taken: float
    """Until its answer had been read, s."""
    own: bool = True
    """Whether the answer was its own; else it was passed over, and a later packet was answered."""


def chunks(data: bytes) -> Iterator[Chunk]:
    """Return the content of the relay's file."""
    at = 0
    while at < len(data):
        time, way, size = RECORD.unpack_from(data, at)
        at += RECORD.size
        yield Chunk(time, way, data[at : at + size])
        at += size


def numbered(stamped: Iterable[Chunk]) -> Iterator[Message]:
    """Messages of `relay send`, which begin with their numbers."""
    for at, way, data in stamped:
        yield Message(at, way, int.from_bytes(data[:8], "little"), len(data))


def egm(stamped: Iterable[Chunk]) -> Iterator[Message]:
    """Datagrams of EGM: an answer holds the time of the robot's clock that its packet told, ms."""
    for at, way, data in stamped:
        time = decode_robot(data).tm_ms if way == PACKET else decode_answer(data).tm_ms
        yield Message(at, way, time or 0, len(data))


def rtde(stamped: Iterable[Chunk]) -> Iterator[Message]:
    """Read data packages of RTDE, which have no number: each answer is for the oldest packet that waits.

    An answer while none waits is one too many: an order that the client gives beside its answers.
    """
    readers, packets, answered = (Reader(), Reader()), 0, 0
    for at, way, data in stamped:
        readers[way].feed(data)
        while (packet := readers[way].next_packet()) is not None:
            size = len(packet.payload) + 3
            if packet.kind != Kind.DATA:
                continue
            if way == PACKET:
                packets += 1
                yield Message(at, way, packets, size)
            elif answered < packets:
                answered += 1
                yield Message(at, way, answered, size)


def s3(stamped: Iterable[Chunk]) -> Iterator[Message]:
    """Read moves of an S3's computer link.

    The EOT that ends a status answer is a packet, the complete order its answer.

    An order for status is shorter, and no answer: the bridge gives it when a sample is there.
    """
    number, ended, size = 0, 0.0, 0
    for at, way, data in stamped:
        if way == PACKET:
            if data == bytes((Control.EOT,)):
                number, ended, size = number + 1, at, 0
            continue
        size += len(data)
        if size == ORDER_BYTES:
            yield Message(ended, PACKET, number, 1)
            yield Message(at, ANSWER, number, size)


class Seen(NamedTuple):
    """All that was seen of a stream."""

    exchanges: tuple[Exchange, ...]
    sizes: tuple[int, int]
    """Largest packet and largest answer, bytes."""


def seen(data: bytes, messages: Callable[[Iterable[Chunk]], Iterator[Message]]) -> Seen:
    """Return the exchanges in the relay's file, in the order of the packets."""
    waiting: deque[Message] = deque()
    found: list[Exchange] = []
    sizes, begun = [0, 0], False
    for message in messages(chunks(data)):
        sizes[message.way] = max(sizes[message.way], message.size)
        if message.way == PACKET:
            waiting.append(message)
            continue
        while waiting and waiting[0].number <= message.number:
            packet = waiting.popleft()
            if begun or packet.number == message.number:
                found.append(Exchange(packet.at, message.at - packet.at, packet.number == message.number))
        begun = True
    return Seen(tuple(found), (sizes[PACKET], sizes[ANSWER]))
