"""The run's side of its page: what it hears, what it sends and when, and what it drops. No process is started."""

import asyncio
import os
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import IO

import pytest

from hil_bridge.record import CycleRecord, EventKind, EventRecord
from hil_bridge.show.terminal import Health
from hil_bridge.show.web import feed as feeding
from hil_bridge.show.web import wire
from hil_bridge.show.web.feed import BATCH_RECORDS, BATCH_S, WAITING_RECORDS, Feed, WebOptions
from tests.record.written_recordings import cycle as written_cycle


@dataclass
class Ends:
    """A feed, the socket of its serving process, and what the run was told."""

    feed: Feed
    other: socket.socket
    retracted: list[str] = field(default_factory=list)
    gone: list[str] = field(default_factory=list)

    def listen(self) -> None:
        self.feed.listen(lambda: self.retracted.append("retract"), self.gone.append)

    def heard(self) -> list[wire.Message]:
        """Messages that have come."""
        messages: list[wire.Message] = []
        while True:
            try:
                data = self.other.recv(wire.MOST_BYTES)
            except BlockingIOError:
                return messages
            messages.append(wire.decode_message(data))

    def counts(self) -> list[int]:
        """Records of each message that has come."""
        return [len(one.items) for one in self.heard() if isinstance(one, wire.Records)]


@pytest.fixture
def ends(monkeypatch: pytest.MonkeyPatch) -> Iterator[Ends]:
    kept: list[int] = []

    def started(
        sockets: Sequence[int], token: str, origins: Sequence[str], told: IO[bytes]
    ) -> "subprocess.Popen[bytes]":
        kept.append(os.dup(sockets[0]))
        told.write(b"the last line\n")
        return subprocess.Popen([sys.executable, "-c", ""])

    monkeypatch.setattr(feeding, "_start", started)
    feed = Feed(WebOptions())
    with socket.socket(fileno=kept[0]) as other:
        other.setblocking(False)
        yield Ends(feed, other)
        feed.close()


def event(number: int) -> EventRecord:
    return EventRecord(float(number), EventKind.CHECK, f"number {number}")


def cycle(at: float) -> CycleRecord:
    """A cycle that ended at this time."""
    return written_cycle(0, at - 0.16)


async def pause() -> None:
    """Let the loop take what lies in its sockets: it looks at them at every turn, and no time passes."""
    for _ in range(16):
        await asyncio.sleep(0)


async def test_one_word_alone_retracts(ends: Ends) -> None:
    ends.listen()
    for word in (b"retrac", b"retract!", b"RETRACT", b"x"):
        ends.other.send(word)
    await pause()
    assert (ends.retracted, ends.gone) == ([], [])
    ends.other.send(wire.RETRACT)
    await pause()
    assert (ends.retracted, ends.gone) == (["retract"], [])


async def test_the_end_of_the_server_is_told_once_with_its_last_line(ends: Ends) -> None:
    ends.listen()
    ends.other.close()
    await pause()
    said = list(ends.gone)
    assert not asyncio.get_running_loop().remove_reader(ends.feed._socket.fileno()), (
        "a dead socket would be read for ever"
    )
    ends.feed.pulse(1.0, Health())
    assert said == ends.gone == ["the page's server has ended: the last line"]
    assert ends.retracted == []
    ends.feed.put(event(1))
    ends.feed.flush()
    assert ends.feed.dropped == 0  # nothing is gathered any more


def test_a_batch_goes_when_it_is_full_or_old(ends: Ends) -> None:
    ends.feed.put(event(0))
    ends.feed.cycle(cycle(BATCH_S * 0.99))
    assert ends.counts() == []
    ends.feed.cycle(cycle(BATCH_S))
    assert ends.counts() == [1]
    for number in range(BATCH_RECORDS - 1):
        ends.feed.put(event(number))
    ends.feed.cycle(cycle(BATCH_S * 1.5))
    assert ends.counts() == []
    ends.feed.put(event(BATCH_RECORDS))
    ends.feed.cycle(cycle(BATCH_S * 1.5))
    assert ends.counts() == [BATCH_RECORDS]
    ends.feed.put(event(1))
    ends.feed.cycle(cycle(0.0))  # a clock that went back: the batch is not kept for ever
    assert ends.counts() == [1]


def test_records_beyond_what_may_wait_are_counted(ends: Ends) -> None:
    for number in range(WAITING_RECORDS + 3):
        ends.feed.put(event(number))
    assert ends.feed.dropped == 3
    ends.feed.flush()
    assert ends.counts() == [BATCH_RECORDS] * (WAITING_RECORDS // BATCH_RECORDS) + [
        WAITING_RECORDS % BATCH_RECORDS
    ]
    ends.feed.pulse(2.5, Health(), "a check", "a warning")
    assert ends.heard() == [wire.Pulse(2.5, Health(), 3, "a check", "a warning")]


def test_a_record_too_large_for_a_message_is_dropped_alone(ends: Ends) -> None:
    ends.feed.put(EventRecord(0.0, EventKind.CHECK, "x" * wire.MOST_BYTES))
    ends.feed.flush()
    ends.feed.put(event(1))
    ends.feed.flush()
    assert (ends.counts(), ends.feed.dropped) == ([1], 1)
