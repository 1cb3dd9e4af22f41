"""Nothing on the control path may block: no file, no sleep, no process, no name look-up, no import, no print."""

import contextlib
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

FORBIDDEN = (
    "open",
    "os.",
    "socket.",
    "subprocess.",
    "import",
    "shutil.",
    "tempfile.",
    "glob.",
    "input",
)
"""Audit events, by prefix, of calls that may wait for something. Source: Python's audit events table."""


@dataclass
class Watch:
    """Recorder of the interpreter's audit events of one thread while it is on."""

    on: bool = False
    thread: int = 0
    heard: list[str] = field(default_factory=list)

    def __call__(self, event: str, arguments: tuple[object, ...]) -> None:
        if self.on and threading.get_ident() == self.thread and event.startswith(FORBIDDEN):
            self.heard.append(f"{event} {arguments[:1]}")


WATCH = Watch()
sys.addaudithook(WATCH)  # permanent: an audit hook cannot be removed


class Loudspeaker:
    """Standard output that must not be written to."""

    def write(self, text: str) -> int:
        WATCH.heard.append(f"print {text!r}")
        return len(text)

    def flush(self) -> None:
        """Nothing to do."""


def run_watched(
    bench: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, meddle: Callable[..., None], **sections: Any
) -> list[str]:
    """Arrivals between the third cycle and the end of the movement."""
    WATCH.heard.clear()
    WATCH.thread = threading.get_ident()

    def watch(bench: Any, record: Any) -> None:
        WATCH.on = record.cycle >= 2 and bench.run.moving
        meddle(bench, record)

    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", Loudspeaker())
        patch.setattr(time, "sleep", lambda seconds: WATCH.heard.append(f"sleep {seconds}"))
        try:
            bench(meddle=watch, **sections)
        finally:
            WATCH.on = False
    return list(WATCH.heard)


@pytest.mark.parametrize(
    "controller", ["predictive", "fuzzy-adaptive", "fuzzy", "resolution-aware", "pi", "admittance"]
)
def test_loop_never_blocks(
    bench: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, controller: str
) -> None:
    blocking = run_watched(
        bench,
        monkeypatch,
        lambda bench, record: None,
        run={"duration_s": 2.0},
        controller={"name": controller},
        frame={"follow_normal": True},
    )
    assert blocking == []


@pytest.mark.parametrize(
    "culprit",
    [
        lambda: time.sleep(0.0),
        lambda: Path("/dev/null").read_bytes(),
        lambda: print("here"),
        lambda: __import__("this_is_not_there"),
    ],
    ids=["sleep", "file", "print", "import"],
)
def test_blocking_call_is_detected(
    bench: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, culprit: Callable[[], object]
) -> None:
    def meddle(bench: Any, record: Any) -> None:
        if record.cycle == 5:
            with contextlib.suppress(ImportError):
                culprit()

    assert run_watched(bench, monkeypatch, meddle, run={"duration_s": 1.0})
