"""The one check: format, lint, types, import contracts, tests with coverage, SocketCAN, and the built wheels elsewhere.

Run it with the environment's Python (`make test` does). Every step runs even when an earlier one failed; the
exit code is 0 only when none failed. `--only NAME` runs one step.
"""

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from kernel_machine import SKIPPED

ROOT = Path(__file__).resolve().parent.parent
BIN = Path(sys.executable).parent


def tool(name: str, *arguments: str) -> Callable[[], int]:
    """A step that is one command of the environment, its output shown as it comes."""
    return lambda: subprocess.run([BIN / name, *arguments], cwd=ROOT, check=False).returncode


def tests(name: str, *arguments: str) -> tuple[str, ...]:
    """The command for tests. It prints the forty slowest; `runs/tests/NAME.xml` keeps verdict and time of each test."""
    return "python", "-m", "pytest", "--durations=40", f"--junitxml=runs/tests/{name}.xml", *arguments


def told(command: Sequence[str]) -> tuple[int, str]:
    """Exit code of a command, and what it said."""
    done = subprocess.run(
        [BIN / command[0], *command[1:]],
        cwd=ROOT,
        check=False,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    return done.returncode, done.stdout


def at_once(first: tuple[str, ...], second: tuple[str, ...]) -> Callable[[], int]:
    """A step of two commands of the environment at a time; the second one's output is shown when both have ended."""

    def step() -> int:
        with ThreadPoolExecutor(1) as beside:
            other = beside.submit(told, second)
            code = tool(*first)()
            other_code, output = other.result()
            print(output, flush=True)
        return code or other_code

    return step


REAL = ("-m", "live", "--reruns", "2")
"""Tests in real time. Where a busy machine made one late it has two more tries, and their number is shown."""
QUICK = (
    "tests/clients",
    "tests/live/test_egm_web_live.py",
    "tests/web/test_panel_page.py",
    *(
        f"tests/live/test_{name}_live.py"
        for name in ("api", "bench", "clock", "egm", "program", "rtde", "today")
    ),
)
"""Tests in real time of devices that speak every few milliseconds, or take EGM's usual port: one at a time."""
SLOW = ("--numprocesses", "3", "--dist", "load", "--maxschedchunk", "1")
"""Beside them three at a time of slow lines, which mostly wait."""

STEPS: dict[str, Callable[[], int]] = {
    "format": tool("ruff", "format", "--check", "."),
    "lint": tool("ruff", "check", "."),
    "types": at_once(("mypy",), ("mypy", "--config-file", "tests/mypy.ini", "tests", "tools")),
    "imports": tool("lint-imports"),
    "protocol": tool(
        *tests("protocol", "tests/wire", "--numprocesses", "auto", "--dist", "loadfile"),
        *("--cov", "--cov-report=term"),
    ),
    # the tutorials first: their pages last the longest
    "pages": tool(
        *tests("pages", "-p", "tools.page_examples", "docs/tutorial", "docs", "README.md"),
        *("--ignore", "docs/_build", "--numprocesses", "2", "--dist", "loadfile", "--no-loadscope-reorder"),
    ),
    # the campaign of faults first: it takes one process the longest
    "tests": tool(
        *tests("tests", "tests/guard/test_campaign.py", "tests", "--ignore", "tests/wire"),
        *("-m", "not live and not vcan and not driver", "--numprocesses", "auto"),
        *("--dist", "loadfile", "--no-loadscope-reorder"),
        *("-p", "tools.exercising", "--exercised", "runs/tests/exercised.json"),
    ),
    "live": at_once(
        tests("live-quick", *REAL, *QUICK),
        tests("live-slow", *REAL, *SLOW, *(f"--ignore={path}" for path in QUICK)),
    ),
}
BESIDE: dict[str, tuple[str, ...]] = {
    "docs": ("sphinx-build", "-E", "-W", "--keep-going", "-q", "docs", "docs/_build/html"),
    "kernel": ("python", "tools/vcan_vm.py", "--driver"),
    "wheels": ("python", "tools/wheels.py"),
}
"""Commands that wait for downloads or keep one processor busy: two at a time beside the steps."""
REAL_TIME = "live"
"""The step beside which nothing runs that others could notice."""
IDLE = ("kernel",)
"""A command that takes only time that no other wants, and so goes on beside REAL_TIME."""

VERDICTS = {0: "ok     ", SKIPPED: "skipped"}
"""Meaning of an exit code of a step; every other one is a failure."""


def main() -> int:
    """Run the steps, and beside them what may be."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", choices=[*STEPS, *BESIDE])
    only = parser.parse_args().only
    # each process would compile each module again where the machine forbids to keep what was compiled
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

    results: dict[str, tuple[int, float]] = {}

    def timed(name: str, began: float, code: int) -> None:
        results[name] = code, time.monotonic() - began

    def quietly(name: str) -> str:
        began = time.monotonic()
        code, output = told(BESIDE[name])
        timed(name, began, code)
        return output

    with ThreadPoolExecutor(2) as beside:
        others = {name: beside.submit(quietly, name) for name in BESIDE if only in (None, name)}

        def show_others(but: tuple[str, ...] = ()) -> None:
            for name in [name for name in others if name not in but]:
                output = others.pop(name).result()
                print(f"── {name}\n{output}", flush=True)

        for name, step in STEPS.items():
            if name == REAL_TIME:
                show_others(but=IDLE)
            if only in (None, name):
                print(f"── {name}", flush=True)
                timed(name, time.monotonic(), step())
        show_others()

    for name, (code, seconds) in results.items():
        print(f"{VERDICTS.get(code, 'FAILED ')} {name} ({seconds:.0f} s)")
    return int(any(code not in VERDICTS for code, _ in results.values()))


if __name__ == "__main__":
    sys.exit(main())
