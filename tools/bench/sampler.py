"""A look, 250 times a second of processor time, at which module works; light enough not to change what it sees.

As a program, `python -m tools.bench.sampler RESULT.json ARGUMENTS…` runs hil-bridge's command line: SIGUSR1 begins
the looking and SIGUSR2 ends it, so that start-up and evaluation stay outside.
"""

import json
import signal
import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from tools.bench.figures import Cost

PERIOD_S = 0.004
"""The kernel's own tick for processor time."""
SHOWN = 14
"""Rows of a profile."""


class Sampler:
    """Counts, by module, in which function the main thread was found."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        signal.signal(signal.SIGPROF, self._look)

    def start(self) -> None:
        """Look from now on."""
        signal.setitimer(signal.ITIMER_PROF, PERIOD_S, PERIOD_S)

    def stop(self) -> None:
        """Look no more. Harmless when it does not."""
        signal.setitimer(signal.ITIMER_PROF, 0.0)

    def _look(self, number: int, frame: FrameType | None) -> None:
        if frame is not None:
            self.counts[frame.f_globals.get("__name__", "?")] += 1


@contextmanager
def sampled() -> Iterator[Counter[str]]:
    """Look at what runs inside; the counts are filled while it does."""
    sampler = Sampler()
    sampler.start()
    try:
        yield sampler.counts
    finally:
        sampler.stop()


def costs(counts: Mapping[str, int]) -> tuple[Cost, ...]:
    """The modules that took most."""
    total = sum(counts.values())
    return tuple(Cost(name, count / total) for name, count in Counter(counts).most_common(SHOWN))


def main() -> None:
    """Run the command; the counts are written when it ends, however it does."""
    result, *arguments = sys.argv[1:]
    sampler = Sampler()
    signal.signal(signal.SIGUSR1, lambda number, frame: sampler.start())
    signal.signal(signal.SIGUSR2, lambda number, frame: sampler.stop())
    sys.argv[1:] = arguments
    from hil_bridge.cli import main as hil_bridge

    try:
        hil_bridge()
    finally:
        sampler.stop()
        Path(result).write_text(json.dumps(sampler.counts), encoding="utf-8")


if __name__ == "__main__":
    main()
