"""The run's side of its page: it never waits, and tells what it cannot do before anything moves."""

import asyncio
import socket
import time

import pytest

from hil_bridge.errors import ConfigError
from hil_bridge.recording import EventRecord
from hil_bridge.runs.shown import Views, fed
from hil_bridge.view import Health
from hil_bridge.web import feed as feeding
from hil_bridge.web import wire
from hil_bridge.web.feed import Feed, WebOptions


class Deaf:
    """A serving process that reads nothing."""

    def __init__(self, *_: object) -> None:
        self.sockets = [socket.socket(fileno=socket.dup(number)) for number in _[0]]  # type: ignore[attr-defined]

    def wait(self, seconds: float) -> int:
        return 0


@pytest.fixture
def deaf(monkeypatch: pytest.MonkeyPatch) -> list[Deaf]:
    """Feeds get a serving process that reads nothing."""
    made: list[Deaf] = []

    def start(*arguments: object) -> Deaf:
        made.append(Deaf(*arguments))
        return made[-1]

    monkeypatch.setattr(feeding, "_started", start)
    return made


def test_a_page_that_keeps_up_with_nothing_costs_no_time_and_every_loss_is_counted(deaf: list[Deaf]) -> None:
    feed = Feed(WebOptions())
    began, slowest = time.monotonic(), 0.0
    for number in range(20_000):
        before = time.monotonic()
        feed.put(EventRecord(float(number), "mark", "x" * 100))
        if number % 5 == 0:
            feed.pulse(float(number), Health())
        slowest = max(slowest, time.monotonic() - before)
    feed.flush()
    assert time.monotonic() - began < 10.0
    assert slowest < 0.5  # what else the machine does; a wait would last for ever
    taken = 0
    theirs = deaf[0].sockets[0]
    theirs.setblocking(False)
    try:
        while message := wire.decoded(theirs.recv(wire.MOST_BYTES)):
            taken += len(message.items) if isinstance(message, wire.Records) else 0
    except BlockingIOError:
        pass
    assert 0 < taken < 20_000
    assert taken + feed.dropped == 20_000
    feed.close()
    for one in deaf[0].sockets:
        one.close()


def test_a_record_too_large_for_a_message_is_counted(deaf: list[Deaf]) -> None:
    feed = Feed(WebOptions())
    feed.put(EventRecord(0.0, "mark", "x" * wire.MOST_BYTES))
    feed.flush()
    assert feed.dropped == 1
    feed.close()
    for one in deaf[0].sockets:
        one.close()


def test_a_serving_process_that_goes_is_told_once(deaf: list[Deaf]) -> None:
    told: list[str] = []

    async def main() -> None:
        feed = Feed(WebOptions())
        feed.listen(lambda: told.append("retract"), told.append)
        deaf[0].sockets[0].send(wire.RETRACT)
        await asyncio.sleep(0.01)
        for one in deaf[0].sockets:
            one.close()
        await asyncio.sleep(0.01)
        feed.put(EventRecord(0.0, "mark", "x"))
        feed.pulse(0.0, Health())
        feed.close()

    asyncio.run(main())
    assert told == ["retract", "the page's server has ended"]


def test_a_taken_port_is_told_before_anything_moves() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with (
            pytest.raises(
                ConfigError, match=rf"127\.0\.0\.1:{port}: Address already in use; name another port"
            ),
            fed(Views(web=WebOptions(port)), virtual=False),
        ):
            pass


def test_a_run_in_virtual_time_and_a_missing_extra_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ConfigError, match="hil-bridge view"), fed(Views(web=WebOptions()), virtual=True):
        pass
    monkeypatch.setattr(feeding, "NEEDED", ("aiohttp", "not_installed_at_all"))
    with pytest.raises(ConfigError, match=r"--web needs the extra web: pip install"):
        Feed(WebOptions())
