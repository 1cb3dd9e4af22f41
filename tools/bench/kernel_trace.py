"""What processes did while something was slow, from the kernel's trace of its scheduler: needs root and tracefs.

Times of the trace are of CLOCK_MONOTONIC, as `time.monotonic` and `time.perf_counter` are on Linux.
"""

import os
import re
import subprocess
import tempfile
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from enum import StrEnum
from pathlib import Path

from tools.bench.figures import Cost
from tools.bench.machine import stolen_s

NOT_HERE = "what the slowest spent their time on, for the kernel gives no trace: that needs root and tracefs"
FULL = "what the slowest of a run spent their time on, for more happened in it than the trace's buffer holds"
BUFFER_KB = 32768
"""For each processor: a switch takes some 70 bytes."""
SLOWEST = 0.01
MICRO = 1e6

Span = tuple[float, float]
"""Begin and end, s."""


class State(StrEnum):
    """Of one thread."""

    ASLEEP = "asleep"
    WOKEN = "woken"
    """Something has woken it; the processor that it is to run on has nothing to do, and does not run it yet."""
    QUEUED = "queued"
    """Something has woken it; the processor that it is to run on runs another."""
    RUNNING = "running"
    PREEMPTED = "preempted"
    """It would go on if it had a processor."""


_RETURNS = ("epoll_wait", "futex", "poll", "clock_nanosleep", "read")
"""Calls in which the traced threads sleep. Their ends are traced too, for not every kernel traces the switch from an
idle processor: then it is by them that a thread is seen to run.
"""
_LINE = re.compile(
    r"-(?P<task>\d+)\s+\[(?P<cpu>\d+)\].*?\s(?P<at>\d+\.\d+): (?P<event>[\w ]+?)(?:: | ->)(?P<what>.*)$"
)
_WAKING = re.compile(r"\bpid=(\d+) prio=-?\d+ target_cpu=(\d+)")
_SWITCH = re.compile(r"prev_pid=(\d+) prev_prio=-?\d+ prev_state=(\S+) ==> .*next_pid=(\d+)")
_WORKER = re.compile(r"\bnext_comm=kworker/\S+ next_pid=(\d+)")
_JUST_WOKEN = (State.WOKEN, State.QUEUED)


class Trace:
    """Which thread was in which state when, as far as it was traced."""

    def __init__(self) -> None:
        self._lines: list[str] = []
        self.stolen_s = 0.0
        """What the host kept meanwhile; see `machine.stolen_s`."""

    def read(self, path: Path) -> None:
        """Take what the kernel has written down."""
        self._lines = path.read_text(errors="replace").splitlines()

    def workers(self) -> list[int]:
        """The kernel's own threads that carry, among other things, the bytes of pseudo-terminals."""
        return sorted(
            {int(worker[1]) for line in self._lines if (worker := _WORKER.search(line)) is not None}
        )

    def parts(
        self,
        spans: Sequence[Span],
        threads: Sequence[int],
        name: Callable[[Sequence[State]], str],
    ) -> Counter[str]:
        """What the time in these spans went to, s: `name` says what it is called while these threads, in their order,
        are in such states.
        """
        times, names = self._course(threads, name)
        parts: Counter[str] = Counter()
        for begun, ended in spans:
            at, k = begun, bisect_right(times, begun) - 1
            while at < ended:
                until = min(ended, times[k + 1]) if k + 1 < len(times) else ended
                parts[names[k] if k >= 0 else "before the trace"] += until - at
                at, k = until, k + 1
        return parts

    def _course(
        self, threads: Sequence[int], name: Callable[[Sequence[State]], str]
    ) -> tuple[list[float], list[str]]:
        states = dict.fromkeys(threads, State.ASLEEP)
        times, names = [], []
        running: dict[int, int] = {}
        for line in self._lines:
            if (found := _LINE.search(line)) is None:
                continue
            for thread, state in _changes(found, running):
                before = states.get(thread)
                if before not in (None, state) and not (state in _JUST_WOKEN and before is not State.ASLEEP):
                    states[thread] = state
                    times.append(float(found["at"]))
                    names.append(name(list(states.values())))
        return times, names


def _changes(line: re.Match[str], running: dict[int, int]) -> Iterator[tuple[int, State]]:
    """The threads whose state changes with this line; `running` holds the thread on each processor."""
    cpu, task = int(line["cpu"]), int(line["task"])
    running[cpu] = task
    yield task, State.RUNNING
    if line["event"] == "sched_waking":
        if (woken := _WAKING.search(line["what"])) is not None:
            yield int(woken[1]), State.QUEUED if running.get(int(woken[2])) else State.WOKEN
    elif line["event"] == "sched_switch" and (switch := _SWITCH.search(line["what"])) is not None:
        running[cpu] = int(switch[3])
        yield int(switch[1]), State.PREEMPTED if switch[2].startswith("R") else State.ASLEEP
        yield int(switch[3]), State.RUNNING


@contextmanager
def traced() -> Iterator[Trace]:
    """Trace what happens inside; the trace can be asked afterwards. Raises OSError where the kernel gives none."""
    trace = Trace()
    with ExitStack() as stack:
        here = _instance(stack)
        (here / "options/overwrite").write_text("0")
        (here / "buffer_size_kb").write_text(str(BUFFER_KB))
        (here / "trace_clock").write_text("mono")
        for event in ("sched_waking", "sched_switch"):
            (here / "events/sched" / event / "enable").write_text("1")
        for call in _RETURNS:
            event_of_call = here / "events/syscalls" / f"sys_exit_{call}"
            (event_of_call / "filter").write_text("ret != 0" if "poll" in call else "ret >= 0")
            (event_of_call / "enable").write_text("1")
        stolen = stolen_s()
        yield trace
        trace.stolen_s = stolen_s() - stolen
        (here / "tracing_on").write_text("0")
        for statistics in here.glob("per_cpu/cpu*/stats"):
            if re.search(r"^(overrun|dropped events): [1-9]", statistics.read_text(), re.MULTILINE):
                raise OSError(FULL)
        trace.read(here / "trace")


def _instance(stack: ExitStack) -> Path:
    """A trace of our own, which leaves others' alone."""
    root = Path("/sys/kernel/tracing")
    if not (root / "instances").is_dir():
        root = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        mounted = subprocess.run(
            ["mount", "-t", "tracefs", "nodev", root], capture_output=True, text=True, check=False
        )
        if mounted.returncode:
            raise OSError(NOT_HERE)
        stack.callback(subprocess.run, ["umount", root], check=False)
    here = root / "instances" / f"hil-bridge-{os.getpid()}"
    try:
        here.mkdir()
    except OSError as error:
        raise OSError(NOT_HERE) from error
    stack.callback(here.rmdir)
    return here


def explained(
    trace: Trace,
    what: str,
    spans: Sequence[Span],
    threads: Sequence[int],
    name: Callable[[Sequence[State]], str],
) -> dict[str, tuple[Cost, ...]]:
    """What the slowest hundredth and the tenth around the median spent their time on, as profiles with their titles."""
    slow, usual = slowest(spans), middle(spans)
    p99 = f"p99 {(slow[0][1] - slow[0][0]) * MICRO:.0f} µs"
    run = f"{what}, {len(spans)} traced ({p99}, the host kept {trace.stolen_s:.2f} s of it all)"
    return {
        f"{run}: {which}, {mean_us(some):.0f} µs on average": costs_of(trace.parts(some, threads, name))
        for which, some in (("the slowest hundredth", slow), ("the tenth around the median", usual))
    }


def costs_of(parts: Mapping[str, float]) -> tuple[Cost, ...]:
    """As shares of all, the largest first."""
    total = sum(parts.values())
    return tuple(Cost(name, part / total) for name, part in Counter(parts).most_common())


def slowest(spans: Sequence[Span]) -> list[Span]:
    """The slowest hundredth of them."""
    ordered = sorted(spans, key=lambda span: span[1] - span[0])
    return ordered[-max(1, round(len(ordered) * SLOWEST)) :]


def middle(spans: Sequence[Span]) -> list[Span]:
    """The tenth of them around the median."""
    ordered = sorted(spans, key=lambda span: span[1] - span[0])
    return ordered[round(len(ordered) * 0.45) : round(len(ordered) * 0.55)]


def mean_us(spans: Sequence[Span]) -> float:
    """How long they took on average, µs."""
    return sum(ended - begun for begun, ended in spans) / len(spans) * MICRO
