"""Packets and their answers, with waiting times, from the time stamps of `c/relay.c`.

An answer counts for its own packet and for all older packets without an answer. Those packets were skipped, but
their waiting time must be counted too. Packets before the first answer and after the last one do not count.
"""

import struct
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

from protocol.devices.egm.messages import decode_answer, decode_robot
from protocol.devices.rtde.packets import Kind, Reader
from protocol.devices.s3.adlp import BLOCK_OVERHEAD, Control, LinkProfile

RECORD = struct.Struct("=dII")
"""Format of a record: time, direction and size. It is the `struct record` of the relay."""
PACKET, ANSWER = 0, 1
"""Directions in the relay's records."""
ORDER_BYTES = 1 + BLOCK_OVERHEAD + LinkProfile().move_length
"""Size of an order, bytes: the ENQ that requests the line, and the block of a move."""


class Chunk(NamedTuple):
    """Bytes that the relay forwarded at once."""

    at: float
    """Time at which the bytes were forwarded, on the monotonic clock, s."""
    direction: int
    data: bytes


class Message(NamedTuple):
    """Packet or answer."""

    at: float
    direction: int
    number: int
    """Number of the packet; an answer has the number of its packet."""
    size: int


class Exchange(NamedTuple):
    """Packet with its answer."""

    at: float
    """Time at which the packet was sent, s on the monotonic clock."""
    taken: float
    """Time until the answer was read, s."""
    own: bool = True
    """Whether the answer belongs to this packet. Otherwise the packet was skipped, and a later one was answered."""


def chunks(data: bytes) -> Iterator[Chunk]:
    """Yield the contents of the relay's file."""
    at = 0
    while at < len(data):
        time, direction, size = RECORD.unpack_from(data, at)
        at += RECORD.size
        yield Chunk(time, direction, data[at : at + size])
        at += size


def numbered_messages(stamped: Iterable[Chunk]) -> Iterator[Message]:
    """Yield the messages of `relay send`. Each begins with its number."""
    for at, direction, data in stamped:
        yield Message(at, direction, int.from_bytes(data[:8], "little"), len(data))


def egm(stamped: Iterable[Chunk]) -> Iterator[Message]:
    """Yield the datagrams of EGM. An answer contains the time of its packet on the robot's clock, ms."""
    for at, direction, data in stamped:
        time = decode_robot(data).tm_ms if direction == PACKET else decode_answer(data).tm_ms
        yield Message(at, direction, time or 0, len(data))


def rtde(stamped: Iterable[Chunk]) -> Iterator[Message]:
    """Yield the data packages of RTDE, which have no number. Each answer belongs to the oldest waiting packet.

    An answer without a waiting packet is an additional order of the client and does not count.
    """
    readers, packets, answered = (Reader(), Reader()), 0, 0
    for at, direction, data in stamped:
        readers[direction].feed(data)
        while (packet := readers[direction].next_packet()) is not None:
            size = len(packet.payload) + 3
            if packet.kind != Kind.DATA:
                continue
            if direction == PACKET:
                packets += 1
                yield Message(at, direction, packets, size)
            elif answered < packets:
                answered += 1
                yield Message(at, direction, answered, size)


def s3(stamped: Iterable[Chunk]) -> Iterator[Message]:
    """Yield the moves on an S3's computer link.

    The EOT that ends a status answer counts as a packet, and the complete move order as its answer. A shorter order
    requests the status and is not an answer: the bridge sends it when a sample has arrived.
    """
    number, ended, size = 0, 0.0, 0
    for at, direction, data in stamped:
        if direction == PACKET:
            if data == bytes((Control.EOT,)):
                number, ended, size = number + 1, at, 0
            continue
        size += len(data)
        if size == ORDER_BYTES:
            yield Message(ended, PACKET, number, 1)
            yield Message(at, ANSWER, number, size)


class StreamSummary(NamedTuple):
    """Summary of a stream."""

    exchanges: tuple[Exchange, ...]
    sizes: tuple[int, int]
    """Sizes of the largest packet and the largest answer, bytes."""


def read_exchanges(data: bytes, messages: Callable[[Iterable[Chunk]], Iterator[Message]]) -> StreamSummary:
    """Return the exchanges in the relay's file, in the order of the packets."""
    waiting: deque[Message] = deque()
    result: list[Exchange] = []
    sizes, begun = [0, 0], False
    for message in messages(chunks(data)):
        sizes[message.direction] = max(sizes[message.direction], message.size)
        if message.direction == PACKET:
            waiting.append(message)
            continue
        while waiting and waiting[0].number <= message.number:
            packet = waiting.popleft()
            if begun or packet.number == message.number:
                result.append(Exchange(packet.at, message.at - packet.at, packet.number == message.number))
        begun = True
    return StreamSummary(tuple(result), (sizes[PACKET], sizes[ANSWER]))
