"""Busy polling: the selector polls for the configured time, then sleeps."""

import selectors
import socket
from collections.abc import Iterator
from types import SimpleNamespace

import pytest

from hil_bridge.clock import polling
from hil_bridge.clock.polling import CHECK_S, BusyPolling

POLL_S = 0.25
"""Time of one poll on the clock of these tests; a power of two, so that sums are exact."""
READY = [(selectors.SelectorKey(0, 0, selectors.EVENT_READ, None), selectors.EVENT_READ)]


class FakePolls:
    """Fake of the platform's selector and clock: each poll takes a fixed time, and arrivals are scheduled."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 1000.0
        self.timeouts: list[float] = []
        self.ready_at = float("inf")
        monkeypatch.setattr(polling, "time", SimpleNamespace(monotonic=lambda: self.now))
        monkeypatch.setattr(selectors.DefaultSelector, "select", lambda _, timeout: self.poll(timeout))

    def poll(self, timeout: float) -> list[tuple[selectors.SelectorKey, int]]:
        self.timeouts.append(timeout)
        self.now += timeout or POLL_S
        return READY if self.now >= self.ready_at else []


@pytest.fixture
def polls(monkeypatch: pytest.MonkeyPatch) -> FakePolls:
    return FakePolls(monkeypatch)


@pytest.fixture
def selector() -> Iterator[BusyPolling]:
    with BusyPolling(1.0) as selector:
        yield selector


def test_busy_polling_polls_until_ready(polls: FakePolls, selector: BusyPolling) -> None:
    polls.ready_at = polls.now + 0.75
    assert selector.select() == READY
    assert polls.timeouts == [0, 0, 0]


def test_busy_polling_sleeps_after_time_limit(polls: FakePolls, selector: BusyPolling) -> None:
    """The selector wakes only to check its files, and does not resume polling after that."""
    polls.ready_at = polls.now + 2.0
    assert selector.select() == READY
    assert polls.timeouts == [0] * 4 + [CHECK_S] * 4


def test_busy_polling_long_wait_sleeps_for_rest(polls: FakePolls, selector: BusyPolling) -> None:
    assert selector.select(2.375) == []
    assert polls.timeouts == [0] * 4 + [CHECK_S] * 5 + [0.125]
    assert polls.now == 1002.375


def test_busy_polling_short_wait_never_sleeps(polls: FakePolls, selector: BusyPolling) -> None:
    assert selector.select(0.5) == []
    assert polls.timeouts == [0, 0, 0]
    assert polls.now == 1000.75


@pytest.mark.parametrize("timeout", [0, -1.0])
def test_busy_polling_without_wait_polls_once(
    polls: FakePolls, selector: BusyPolling, timeout: float
) -> None:
    selector.select(timeout)
    assert polls.timeouts == [timeout]


def test_busy_polling_matches_selector_of_platform() -> None:
    near, far = socket.socketpair()
    with near, far, BusyPolling(10.0) as selector:
        selector.register(near, selectors.EVENT_READ, "here")
        far.send(b"\x05")
        ((key, events),) = selector.select()
        assert (key.data, events) == ("here", selectors.EVENT_READ)
