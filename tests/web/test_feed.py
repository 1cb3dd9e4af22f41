"""Run side of the page: what it receives, sends and drops, and when. No process is started."""

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
    """Feed, the socket of its serving process, and the notifications to the run."""

    feed: Feed
    other: socket.socket
    retracted: list[str] = field(default_factory=list)
    gone: list[str] = field(default_factory=list)

    def listen(self) -> None:
        self.feed.listen(lambda: self.retracted.append("retract"), self.gone.append)

    def decoded_messages(self) -> list[wire.Message]:
        """Return the messages received so far."""
        messages: list[wire.Message] = []
        while True:
            try:
                data = self.other.recv(wire.MOST_BYTES)
            except BlockingIOError:
                return messages
            messages.append(wire.decode_message(data))

    def counts(self) -> list[int]:
        """Return the records of each received message."""
        return [len(one.items) for one in self.decoded_messages() if isinstance(one, wire.Records)]


@pytest.fixture
def ends(monkeypatch: pytest.MonkeyPatch) -> Iterator[Ends]:
    kept: list[int] = []

    def started(
        sockets: Sequence[int], token: str, origins: Sequence[str], output: IO[bytes]
    ) -> "subprocess.Popen[bytes]":
        kept.append(os.dup(sockets[0]))
        output.write(b"the last line\n")
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
    """Return a cycle that ended at this time."""
    return written_cycle(0, at - 0.16)


async def pause() -> None:
    """Let the loop read its sockets: it polls them at every turn, and no time passes."""
    for _ in range(16):
        await asyncio.sleep(0)


async def test_feed_retracts_only_on_exact_command(ends: Ends) -> None:
    ends.listen()
    for word in (b"retrac", b"retract!", b"RETRACT", b"x"):
        ends.other.send(word)
    await pause()
    assert (ends.retracted, ends.gone) == ([], [])
    ends.other.send(wire.RETRACT)
    await pause()
    assert (ends.retracted, ends.gone) == (["retract"], [])


async def test_feed_reports_server_end_once_with_last_line(ends: Ends) -> None:
    ends.listen()
    ends.other.close()
    await pause()
    lines = list(ends.gone)
    assert not asyncio.get_running_loop().remove_reader(ends.feed._socket.fileno()), (
        "a dead socket would be read for ever"
    )
    ends.feed.pulse(1.0, Health())
    assert lines == ends.gone == ["the page's server has ended: the last line"]
    assert ends.retracted == []
    ends.feed.put(event(1))
    ends.feed.flush()
    assert ends.feed.dropped == 0  # records are no longer collected


def test_feed_sends_full_or_old_batch(ends: Ends) -> None:
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
    ends.feed.cycle(cycle(0.0))  # the clock went back: the batch is not kept forever
    assert ends.counts() == [1]


def test_feed_counts_records_beyond_queue(ends: Ends) -> None:
    for number in range(WAITING_RECORDS + 3):
        ends.feed.put(event(number))
    assert ends.feed.dropped == 3
    ends.feed.flush()
    assert ends.counts() == [BATCH_RECORDS] * (WAITING_RECORDS // BATCH_RECORDS) + [
        WAITING_RECORDS % BATCH_RECORDS
    ]
    ends.feed.pulse(2.5, Health(), "a check", "a warning")
    assert ends.decoded_messages() == [wire.Pulse(2.5, Health(), 3, "a check", "a warning")]


def test_feed_drops_only_the_oversized_record(ends: Ends) -> None:
    ends.feed.put(EventRecord(0.0, EventKind.CHECK, "x" * wire.MOST_BYTES))
    ends.feed.flush()
    ends.feed.put(event(1))
    ends.feed.flush()
    assert (ends.counts(), ends.feed.dropped) == ([1], 1)
