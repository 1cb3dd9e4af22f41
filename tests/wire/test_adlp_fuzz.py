"""Arbitrary bytes into either end, a megabyte in every run: nothing raised, little kept, valid messages understood.

What an end keeps is stated at its limits: an unfinished block, `EVENT_LIMIT` events and `MESSAGE_LIMIT` blocks of a
message. With an owner that takes its events and bytes, as here, only the unfinished block and the message remain.
"""

import random
import tracemalloc

import pytest

from protocol.devices.s3.adlp import (
    BLOCK_OVERHEAD,
    EVENT_LIMIT,
    LENGTH_STYLES,
    MESSAGE_LIMIT,
    BlockFormat,
    BlockScanner,
    Link,
    LinkFailed,
    LinkProfile,
    MessageReceived,
    MessageSent,
    Role,
    State,
    encode_block,
)

EPOCH = 4321.75
SIZE = 1_000_000
ASK = bytes.fromhex("00 08 01 00 13 01 00 00")
REPLY = bytes.fromhex("00 08 00 00 13 02 00 00")
KEPT = 100_000
"""Maximum number of bytes allocated at any time: an end keeps some hundreds, the rest are transient events
and bytes.
"""

PIECES = (
    *(bytes((value,)) for value in (0x02, 0x03, 0x04, 0x05, 0x06, 0x0E, 0x0F, 0x10, 0x15, 0x82)),
    b"\x10\x02",
    b"\x10\x82",
    b"\x10\x03",
    b"\x10\x02\x00\x80",
    encode_block(ASK),
    encode_block(REPLY),
    encode_block(REPLY)[:-1] + b"\x00",
)
"""Byte sequences with a meaning for a link."""


def uniform(rng, size):
    """Return bytes of all values."""
    return rng.randbytes(size)


def meaningful(rng, size):
    """Return control bytes, pieces of blocks and blocks, with some noise between them."""
    parts, length = [], 0
    while length < size:
        parts.append(rng.choice(PIECES) if rng.random() < 0.8 else rng.randbytes(rng.randrange(1, 40)))
        length += len(parts[-1])
    return b"".join(parts)


def feed(link, data, rng, now):
    """Feed in pieces, with time-outs between them; some messages wait to be sent. Return the time at the end."""
    at = 0
    while at < len(data):
        piece = data[at : at + rng.randrange(1, 600)]
        at += len(piece)
        now += len(piece) * 0.001 + (rng.random() if rng.random() < 0.2 else 0.0)
        while (due := link.next_deadline()) is not None and due <= now:
            link.handle_deadline(due)
            link.data_to_send(due)
        if rng.random() < 0.01 and link.state is State.IDLE:
            link.send([ASK])
        link.receive(piece, now)
        link.data_to_send(now)
        while link.next_event() is not None:
            pass
    return now


def rest(link, now):
    """Let every time-out expire."""
    while (due := link.next_deadline()) is not None:
        now = max(now, due)
        link.handle_deadline(due)
        link.data_to_send(due)
    while link.next_event() is not None:
        pass
    return now


def events(link):
    return list(iter(link.next_event, None))


@pytest.mark.full
@pytest.mark.parametrize("stuffing", ["off", "double"])
@pytest.mark.parametrize(("make", "size"), [(uniform, SIZE * 3 // 4), (meaningful, SIZE // 4)])
@pytest.mark.parametrize("role", list(Role))
def test_megabyte_of_arbitrary_bytes(role, make, size, stuffing):
    rng = random.Random(f"{role} {make.__name__} {stuffing}")
    link = Link(role, LinkProfile(dle_stuffing=stuffing))
    now = rest(link, feed(link, make(rng, size), rng, EPOCH))
    assert link.state is State.IDLE
    # A valid message is understood, and one of its own goes out.
    for data, answer in ((b"\x05", b"\x06"), (encode_block(REPLY), b"\x06"), (b"\x04", b"")):
        link.receive(data, now)
        assert link.data_to_send(now) == answer
    assert events(link) == [MessageReceived((REPLY,))]
    link.send([ASK])
    assert link.data_to_send(now) == b"\x05"
    for data, answer in ((b"\x06", encode_block(ASK)), (b"\x06", b"\x04")):
        link.receive(data, now)
        assert link.data_to_send(now) == answer
    assert events(link) == [MessageSent()]


@pytest.mark.full
@pytest.mark.parametrize("role", list(Role))
def test_little_is_kept(role):
    rng = random.Random(7)
    pieces = [meaningful(rng, 50_000), uniform(rng, 50_000), b"\x10\x02\x00\x80" + bytes(50_000)]
    link = Link(role, LinkProfile())
    now = feed(link, pieces[0], rng, EPOCH)
    tracemalloc.start()
    try:
        for piece in pieces:
            now = feed(link, piece, rng, now)
        kept, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert kept <= KEPT // 4
    assert peak <= KEPT


@pytest.mark.parametrize(("stuffing", "doubled"), [("off", 1), ("double", 2)])
def test_unfinished_block_is_at_most_a_block(stuffing, doubled):
    scanner = BlockScanner(BlockFormat(stuffing, LENGTH_STYLES, 128))
    rng = random.Random(3)
    pieces = [meaningful(rng, 50_000), b"\x10\x02\x00\x80" + bytes(500), b"\x10\x02" + b"\x10" * 1000]
    most = 0
    for piece in pieces:
        for at in range(0, len(piece), 7):
            scanner.feed(piece[at : at + 7])
            most = max(most, scanner.pending)
    assert 128 <= most < doubled * 128 + BLOCK_OVERHEAD


def test_owner_that_reads_nothing_needs_bounded_memory():
    link = Link(Role.HOST, LinkProfile())
    for _ in range(EVENT_LIMIT + 50):
        link.receive(b"\x05", EPOCH)
        link.data_to_send(EPOCH)
        link.receive(encode_block(REPLY) + b"\x04", EPOCH)
        link.data_to_send(EPOCH)
    assert len(events(link)) == EVENT_LIMIT
    assert link.counters["events dropped"] == 50


def test_message_is_abandoned_before_it_fills_the_memory():
    link = Link(Role.HOST, LinkProfile())
    link.receive(b"\x05", EPOCH)
    link.data_to_send(EPOCH)
    for _ in range(MESSAGE_LIMIT + 1):
        link.receive(encode_block(REPLY), EPOCH)
    assert [type(event) for event in events(link)] == [LinkFailed]
    assert link.data_to_send(EPOCH)[-1:] == b"\x04"
