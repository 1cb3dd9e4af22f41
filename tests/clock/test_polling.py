"""The selector that stays awake: it looks without sleeping for as long as it was told, and sleeps then."""

import selectors
import socket
from collections.abc import Iterator
from types import SimpleNamespace

import pytest

from hil_bridge.clock import polling
from hil_bridge.clock.polling import CHECK_S, BusyPolling

LOOK_S = 0.25
"""Time of one look on the clock of these tests; a power of two, so that sums are exact."""
READY = [(selectors.SelectorKey(0, 0, selectors.EVENT_READ, None), selectors.EVENT_READ)]


class Looks:
    """The platform's selector and its clock, without either: each look takes its time, and what comes when is told."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 1000.0
        self.asked: list[float] = []
        self.comes_at = float("inf")
        monkeypatch.setattr(polling, "time", SimpleNamespace(monotonic=lambda: self.now))
        monkeypatch.setattr(selectors.DefaultSelector, "select", lambda _, timeout: self.look(timeout))

    def look(self, timeout: float) -> list[tuple[selectors.SelectorKey, int]]:
        self.asked.append(timeout)
        self.now += timeout or LOOK_S
        return READY if self.now >= self.comes_at else []


@pytest.fixture
def looks(monkeypatch: pytest.MonkeyPatch) -> Looks:
    return Looks(monkeypatch)


@pytest.fixture
def selector() -> Iterator[BusyPolling]:
    with BusyPolling(1.0) as selector:
        yield selector


def test_it_looks_until_something_comes(looks: Looks, selector: BusyPolling) -> None:
    looks.comes_at = looks.now + 0.75
    assert selector.select() == READY
    assert looks.asked == [0, 0, 0]


def test_it_sleeps_once_it_has_been_awake_long_enough(looks: Looks, selector: BusyPolling) -> None:
    """It wakes for a look at its files alone, and is not awake again after that."""
    looks.comes_at = looks.now + 2.0
    assert selector.select() == READY
    assert looks.asked == [0] * 4 + [CHECK_S] * 4


def test_a_longer_wait_sleeps_for_what_is_left(looks: Looks, selector: BusyPolling) -> None:
    assert selector.select(2.375) == []
    assert looks.asked == [0] * 4 + [CHECK_S] * 5 + [0.125]
    assert looks.now == 1002.375


def test_a_shorter_wait_never_sleeps(looks: Looks, selector: BusyPolling) -> None:
    assert selector.select(0.5) == []
    assert looks.asked == [0, 0, 0]
    assert looks.now == 1000.75


@pytest.mark.parametrize("timeout", [0, -1.0])
def test_who_does_not_wait_looks_once(looks: Looks, selector: BusyPolling, timeout: float) -> None:
    selector.select(timeout)
    assert looks.asked == [timeout]


def test_it_sees_what_the_platforms_selector_sees() -> None:
    here, there = socket.socketpair()
    with here, there, BusyPolling(10.0) as selector:
        selector.register(here, selectors.EVENT_READ, "here")
        there.send(b"\x05")
        ((key, events),) = selector.select()
        assert (key.data, events) == ("here", selectors.EVENT_READ)
