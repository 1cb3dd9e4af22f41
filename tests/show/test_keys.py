"""Single keys of a terminal: read in the foreground alone, and never by waiting for a paused terminal."""

import os
import pty
import sys
import termios
import threading
from collections.abc import Iterator
from io import FileIO
from typing import Any

import pytest

from hil_bridge.console import keys

DEADLINE_S = 10.0
"""Longest wait for a thread; it is not used up."""


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A terminal for standard input, whose foreground is this process: the end at which an operator types."""
    person, terminal = pty.openpty()
    with FileIO(terminal) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        monkeypatch.setattr(os, "tcgetpgrp", lambda source: os.getpgrp())
        yield person
    os.close(person)


def modes(terminal: int) -> int:
    found: int = termios.tcgetattr(terminal)[3]
    return found & (termios.ICANON | termios.ECHO)


def test_keys_come_at_once_and_the_terminal_is_what_it_was(typed: int) -> None:
    heard, came = [], threading.Event()
    before = modes(sys.stdin.fileno())

    def react(key: str) -> None:
        heard.append(key)
        came.set()

    with keys.listen_for_keys(react):
        assert modes(sys.stdin.fileno()) == 0
        os.write(typed, b"p")
        assert came.wait(DEADLINE_S)
    assert heard == ["p"]
    assert modes(sys.stdin.fileno()) == before


def test_a_process_in_the_background_takes_no_key_and_leaves_the_terminal_alone(
    typed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard: list[str] = []
    asked = threading.Semaphore(0)

    def another(source: int) -> int:
        asked.release()
        return os.getpgrp() + 1

    with keys.listen_for_keys(heard.append):
        monkeypatch.setattr(os, "tcgetpgrp", another)
        os.write(typed, b"r")
        for _ in range(2):  # looked at, and once more: a read would have come between
            assert asked.acquire(timeout=DEADLINE_S)
        by_shell = termios.tcgetattr(sys.stdin.fileno())
        by_shell[0] &= ~termios.ICRNL
        termios.tcsetattr(sys.stdin.fileno(), termios.TCSANOW, by_shell)
    assert heard == []
    assert termios.tcgetattr(sys.stdin.fileno()) == by_shell


def test_a_process_that_ends_in_the_background_leaves_no_terminal_without_echo(
    typed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = modes(sys.stdin.fileno())
    with keys.listen_for_keys(lambda key: None):
        monkeypatch.setattr(os, "tcgetpgrp", lambda source: os.getpgrp() + 1)
    assert modes(sys.stdin.fileno()) == before


def test_a_paused_terminal_is_not_waited_for(typed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    change = termios.tcsetattr
    ways: list[int] = []

    def changed(source: int, when: int, attributes: Any) -> None:
        ways.append(when)
        change(source, when, attributes)

    monkeypatch.setattr(termios, "tcsetattr", changed)
    with keys.listen_for_keys(lambda key: None):
        pass
    assert ways == [termios.TCSANOW] * 2
