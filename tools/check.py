"""The one check: format, lint, types, import contracts, tests with coverage, SocketCAN, and the built wheels elsewhere.

Run it with the environment's Python (`make test` does). Every step runs even when an earlier one failed; the
exit code is 0 only when none failed. `--only NAME` runs one step.
"""

import argparse
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from kernel_machine import SKIPPED
from wheels import check_wheels

ROOT = Path(__file__).resolve().parent.parent
BIN = Path(sys.executable).parent


def tool(name: str, *arguments: str) -> Callable[[], int]:
    """A step that is one command of the environment, its output shown as it comes."""
    return lambda: subprocess.run([BIN / name, *arguments], cwd=ROOT, check=False).returncode


def both(*steps: Callable[[], int]) -> Callable[[], int]:
    """A step of several: each is taken, and the first that fails gives the exit code."""
    return lambda: next(filter(None, [step() for step in steps]), 0)


def at_once(first: tuple[str, ...], second: tuple[str, ...]) -> Callable[[], int]:
    """A step of two commands of the environment at a time; the second one's output is shown when both have ended."""

    def step() -> int:
        command = [BIN / second[0], *second[1:]]
        with (
            subprocess.Popen(
                command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
            ) as other,
            ThreadPoolExecutor(1) as reader,
        ):
            output = reader.submit(lambda: other.communicate()[0])
            code = tool(*first)()
            print(output.result(), flush=True)
        return code or other.returncode

    return step


QUICK = (
    "tests/clients",
    *(f"tests/live/test_{name}_live.py" for name in ("bench", "cell", "clock", "egm", "program", "rtde")),
)
"""Tests in real time of devices that speak every few milliseconds: one at a time, and beside it one of a slow line."""

STEPS: dict[str, Callable[[], int]] = {
    "format": tool("ruff", "format", "--check", "."),
    "lint": tool("ruff", "check", "."),
    "types": both(tool("mypy"), tool("mypy", "--config-file", "tests/mypy.ini", "tests")),
    "imports": tool("lint-imports"),
    "protocol": tool(
        *("pytest", "tests/wire", "tests/emulation", "--numprocesses", "auto", "--dist", "loadfile"),
        *("--cov", "--cov-report=term"),
    ),
    # the campaign of faults first: it takes one process the longest
    "tests": tool(
        *(
            "pytest",
            "tests/guard/test_campaign.py",
            "tests",
            "--ignore",
            "tests/wire",
            "--ignore",
            "tests/emulation",
        ),
        *("-m", "not live and not vcan and not driver", "--numprocesses", "auto"),
        *("--dist", "loadfile", "--no-loadscope-reorder"),
    ),
    "live": at_once(
        ("pytest", "-m", "live", *QUICK), ("pytest", "-m", "live", *(f"--ignore={path}" for path in QUICK))
    ),
    "kernel": tool("python", "tools/vcan_vm.py", "--driver"),
}

VERDICTS = {0: "ok     ", SKIPPED: "skipped"}
"""Meaning of an exit code of a step; every other one is a failure."""


def main() -> int:
    """Run the steps, the wheels beside the others since they mostly wait for downloads."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", choices=[*STEPS, "wheel"])
    only = parser.parse_args().only

    results: dict[str, tuple[int, float]] = {}

    def timed(name: str, step: Callable[[], int]) -> None:
        began = time.monotonic()
        code = step()
        results[name] = code, time.monotonic() - began

    with ThreadPoolExecutor(1) as beside:
        wheel = beside.submit(timed, "wheel", check_wheels) if only in (None, "wheel") else None
        for name, step in STEPS.items():
            if only in (None, name):
                print(f"── {name}", flush=True)
                timed(name, step)
        if wheel is not None:
            print("── wheels, installed into a fresh environment", flush=True)
            wheel.result()

    for name, (code, seconds) in results.items():
        print(f"{VERDICTS.get(code, 'FAILED ')} {name} ({seconds:.0f} s)")
    return int(any(code not in VERDICTS for code, _ in results.values()))


if __name__ == "__main__":
    sys.exit(main())
