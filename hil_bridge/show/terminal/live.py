"""Live terminal view: a redrawn panel, or plain lines if redrawing is not possible."""

import math
from contextlib import AbstractContextManager
from types import TracebackType
from typing import TextIO

from rich.console import Console, ConsoleDimensions
from rich.live import Live

from hil_bridge.errors.text_files import harmless
from hil_bridge.record.records import CycleRecord, EventRecord
from hil_bridge.show.terminal.model import Health, Scene, Snapshot, ViewModel
from hil_bridge.show.terminal.panel import panel

LINE_SECONDS = 1.0


class LiveView(AbstractContextManager["LiveView"]):
    """Live display of a run.

    `update` and `event` only store their arguments, for the control path. `refresh` draws, which takes milliseconds
    and blocks while the terminal is slow or paused. Call `refresh` and `close` in a separate thread. If the
    terminal disappears, the view ends, not the run.
    """

    def __init__(self, scene: Scene, stream: TextIO) -> None:
        self._model = ViewModel(scene)
        self._stream = stream
        console = Console(file=stream, highlight=False)
        redrawable = console.is_terminal and not console.is_dumb_terminal
        self._console = console if redrawable and console.encoding.startswith("utf") else None
        self._live: Live | None = None
        self._size: ConsoleDimensions | None = None
        self._gone = False
        self._line_phase: tuple[str, int] | None = None
        self._line_due = -math.inf
        self._line_cause = ""

    def update(self, record: CycleRecord) -> None:
        """Add a completed cycle."""
        self._model.update(record)

    def event(self, record: EventRecord) -> None:
        """Add an event."""
        self._model.event(record)

    def warn(self, text: str) -> None:
        """Display a warning until the view closes."""
        self._model.warn(text)

    def check(self, text: str) -> None:
        """Display the result of a sensor check before contact."""
        self._model.check(text)

    def refresh(self, now: float, health: Health) -> None:
        """Display the state at `now`, s on the run's clock."""
        self.show(self._model.snapshot(now, health))

    def show(self, snapshot: Snapshot) -> None:
        """Draw a snapshot. As plain lines, draw only once per second of the run, and when the phase or step changes."""
        if self._gone:
            return
        try:
            if self._console is not None:
                self._draw(self._console, snapshot)
            elif (snapshot.phase, snapshot.step) != self._line_phase or snapshot.elapsed_s >= self._line_due:
                self._line_phase = snapshot.phase, snapshot.step
                self._line_due = math.floor(snapshot.elapsed_s / LINE_SECONDS + 1) * LINE_SECONDS
                print(line(snapshot, self._line_cause), file=self._stream, flush=True)
                self._line_cause = snapshot.cause
        except (OSError, ValueError):  # ValueError: the stream has been closed
            self._gone = True

    def _draw(self, console: Console, snapshot: Snapshot) -> None:
        """Draw over the previous picture; clear the screen first if the size of the terminal has changed."""
        size = console.size
        if self._live is None or size != self._size:
            if self._live is not None:
                self._live.stop()
                console.clear()
            self._size = size
            # not redirected: a program that writes to a stream would wait for the drawing thread
            self._live = Live(
                console=console,
                auto_refresh=False,
                transient=False,
                redirect_stdout=False,
                redirect_stderr=False,
            )
            self._live.start()
        # leave the last line free: writing there would scroll the terminal
        self._live.update(panel(snapshot, size.width, size.height - 1), refresh=True)

    def close(self) -> None:
        """Release the terminal; the last panel stays. Idempotent."""
        if self._live is None:
            return
        try:
            self._live.stop()
        except (OSError, ValueError):
            self._gone = True

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def line(snapshot: Snapshot, known_cause: str = "") -> str:
    """Format a snapshot as one ASCII line for log files and pipes, omitting the cause."""
    parts = [f"{snapshot.elapsed_s:7.1f} s", f"{snapshot.phase:<8}"]
    if snapshot.step:
        parts.append(f"step {snapshot.step} of {len(snapshot.scene.steps)}: {snapshot.step_label}")
    if snapshot.newest is not None:
        parts += [
            f"force {snapshot.newest.force:z7.2f} N"
            + (f" of {snapshot.reference_n:.2f} N" if snapshot.is_force_controlled else ""),
            f"depth {snapshot.newest.depth * 1e3:8.3f} mm",
        ]
        if snapshot.newest.verdict != "allow":
            parts.append(f"{snapshot.newest.verdict}: {', '.join(snapshot.newest.reasons)}")
    if snapshot.cycle_time_s is not None:
        parts.append(f"cycle {snapshot.cycle_time_s * 1e3:5.1f} ms")
    troubles = ", ".join(f"{name} {count}" for name, count in snapshot.link_troubles.items())
    parts.append(f"link errors {snapshot.link_errors}{f' ({troubles})' if troubles else ''}")
    parts.append(f"frames lost {snapshot.frames_lost}")
    if snapshot.remaining_s is not None:
        parts.append(f"{snapshot.remaining_s:.0f} s to track")
    if snapshot.newest is None and snapshot.check:
        parts.append(snapshot.check.replace("·", " "))
    if snapshot.cause:
        parts.append("STOPPED" if snapshot.cause == known_cause else f"STOPPED: {snapshot.cause}")
    if snapshot.warning:
        parts.append(f"WARNING: {snapshot.warning}")
    return harmless("  ".join(parts)).encode("ascii", "backslashreplace").decode()
