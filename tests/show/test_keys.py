"""Single keys of a terminal: read only in the foreground, and without waiting for a paused terminal."""

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
"""Longest wait for a thread; normally not reached."""


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Return a terminal for standard input with this process in the foreground: the end at which an operator types."""
    keyboard, terminal = pty.openpty()
    with FileIO(terminal) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        monkeypatch.setattr(os, "tcgetpgrp", lambda source: os.getpgrp())
        yield keyboard
    os.close(keyboard)


def modes(terminal: int) -> int:
    result: int = termios.tcgetattr(terminal)[3]
    return result & (termios.ICANON | termios.ECHO)


def test_keys_arrive_at_once_and_terminal_is_restored(typed: int) -> None:
    received, arrived = [], threading.Event()
    before = modes(sys.stdin.fileno())

    def react(key: str) -> None:
        received.append(key)
        arrived.set()

    with keys.listen_for_keys(react):
        assert modes(sys.stdin.fileno()) == 0
        os.write(typed, b"p")
        assert arrived.wait(DEADLINE_S)
    assert received == ["p"]
    assert modes(sys.stdin.fileno()) == before


def test_background_process_leaves_terminal_unchanged(typed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    received: list[str] = []
    requested = threading.Semaphore(0)

    def another(source: int) -> int:
        requested.release()
        return os.getpgrp() + 1

    with keys.listen_for_keys(received.append):
        monkeypatch.setattr(os, "tcgetpgrp", another)
        os.write(typed, b"r")
        for _ in range(2):  # checked twice: a read would have occurred in between
            assert requested.acquire(timeout=DEADLINE_S)
        by_shell = termios.tcgetattr(sys.stdin.fileno())
        by_shell[0] &= ~termios.ICRNL
        termios.tcsetattr(sys.stdin.fileno(), termios.TCSANOW, by_shell)
    assert received == []
    assert termios.tcgetattr(sys.stdin.fileno()) == by_shell


def test_process_ending_in_background_restores_echo(typed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    before = modes(sys.stdin.fileno())
    with keys.listen_for_keys(lambda key: None):
        monkeypatch.setattr(os, "tcgetpgrp", lambda source: os.getpgrp() + 1)
    assert modes(sys.stdin.fileno()) == before


def test_paused_terminal_does_not_block(typed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    change = termios.tcsetattr
    paths: list[int] = []

    def changed(source: int, when: int, attributes: Any) -> None:
        paths.append(when)
        change(source, when, attributes)

    monkeypatch.setattr(termios, "tcsetattr", changed)
    with keys.listen_for_keys(lambda key: None):
        pass
    assert paths == [termios.TCSANOW] * 2
