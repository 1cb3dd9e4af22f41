"""The check, in two tiers: format, lint, types, import contracts, tests, SocketCAN, documentation and built wheels.

    python tools/check.py                the gate, which every change must pass; `make test` runs it
    python tools/check.py --all          the gate and the full tier; `make test-all` runs it
    python tools/check.py --only types   one step
    python tools/check.py --all --every  the same with every case of each sweep, instead of a third
    python tools/check.py --room rsi     the tests of the gate that name a room (a folder of the product)

Run it with the environment's Python. Every step runs even when an earlier one failed; the exit code is 0 only when
none failed. `--tier` in tests/conftest.py divides the tests between the tiers; only tests/wire runs in both, in the
full tier with coverage.
"""

import argparse
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from kernel_machine import SKIPPED

ROOT = Path(__file__).resolve().parent.parent
BIN = Path(sys.executable).parent
PACKAGES = sorted(str(path.parent.relative_to(ROOT)) for path in ROOT.glob("packages/*/pyproject.toml"))
"""Packages of devices outside the core, which have their own tests and pages."""

Step = Callable[[], int]


def run(name: str, *arguments: str) -> Step:
    """Return a step that runs one command of the environment and prints its output immediately."""
    return lambda: subprocess.run([BIN / name, *arguments], cwd=ROOT, check=False).returncode


def pytest(name: str, *arguments: str) -> tuple[str, ...]:
    """Return a pytest command that prints the forty slowest tests and writes all of them to `runs/tests/NAME.xml`."""
    return "python", "-m", "pytest", "--durations=40", f"--junitxml=runs/tests/{name}.xml", *arguments


def run_all(*steps: Step) -> Step:
    """Return a step that runs others in order, every one even if an earlier one failed."""
    return lambda: max([step() for step in steps], default=0)


def run_captured(command: Sequence[str]) -> tuple[int, str]:
    """Run a command and return its exit code and its output."""
    done = subprocess.run(
        [BIN / command[0], *command[1:]],
        cwd=ROOT,
        check=False,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    return done.returncode, done.stdout


def run_shown(step: Step) -> tuple[int, str]:
    """Run a step that prints its own output. Return its exit code and no output."""
    return step(), ""


def run_both(first: tuple[str, ...], second: tuple[str, ...]) -> Step:
    """Return a step that runs two commands in parallel. The output of the second is printed when both have ended."""

    def step() -> int:
        with ThreadPoolExecutor(1) as background:
            other = background.submit(run_captured, second)
            code = run(*first)()
            other_code, output = other.result()
            print(output, flush=True)
        return code or other_code

    return step


def without_ports(tier: str) -> tuple[str, ...]:
    """Return pytest options for the tests of a tier that need no port, bus or driver. These tests also write their
    evidence.
    """
    return (
        *("--tier", tier, "-m", "not live and not vcan and not driver"),
        *("--numprocesses", "auto", "--dist", "loadfile", "--no-loadscope-reorder"),
        *("-p", "tools.exercising", "--exercised", f"runs/tests/{tier}-exercised.json"),
    )


SWEEP_PARTS = 3
"""Number of parts of each sweep, one of which is checked. Chosen: a check below half an hour on an idle machine."""


def sweeps(every: bool = False) -> Step:
    """Return the step of long tests. The hash of the commit selects the part of each sweep, so that a check of the same
    commit runs the same tests; `every` selects all parts.
    """
    commit = subprocess.run(("git", "rev-parse", "HEAD"), cwd=ROOT, capture_output=True, check=False).stdout
    part = "1/1" if every else f"{int(commit or b'0', 16) % SWEEP_PARTS}/{SWEEP_PARTS}"
    # the fault campaign is first, because it occupies one process longest
    files = "tests/guard/test_campaign.py", "tests", "--ignore", "tests/wire"
    return run(*pytest("sweeps", *files, *without_ports("full"), "--part", part))


REAL_TIME = ("-m", "live", "--reruns", "2")
"""Options of real-time tests. A test that fails because the machine is busy is retried twice; pytest reports how
many were retried.
"""
FAST_DEVICES = (
    "tests/clients",
    "tests/live/test_egm_web_live.py",
    "tests/web/test_panel_page.py",
    *(
        f"tests/live/test_{name}_live.py"
        for name in ("api", "bench", "clock", "egm", "program", "rtde", "today")
    ),
)
"""Options of real-time tests that must run one at a time. Their devices send every few milliseconds, or use EGM's
default port.
"""
SLOW_DEVICES = ("--numprocesses", "3", "--dist", "load", "--maxschedchunk", "1")
"""Options of the other real-time tests. Three run in parallel, because they mostly wait."""

TIERS: dict[str, dict[str, Step]] = {
    "gate": {
        "format": run("ruff", "format", "--check", "."),
        "lint": run("ruff", "check", "."),
        "types": run_both(("mypy",), ("mypy", "--config-file", "tests/mypy.ini", "tests", "tools")),
        "imports": run("lint-imports"),
        "tests": run(*pytest("gate", "tests", *without_ports("gate"))),
        "packages": run_all(
            *(run(*pytest(Path(one).name, one, "--numprocesses", "auto")) for one in PACKAGES)
        ),
    },
    "full": {
        "protocol": run(
            *pytest("protocol", "tests/wire", "--numprocesses", "auto", "--dist", "loadfile"),
            *("--cov", "--cov-report=term"),
        ),
        # the tutorials are first, because their pages take longest
        "pages": run(
            *pytest("pages", "-p", "tools.page_examples", "docs/tutorial", "docs", "README.md"),
            *(f"{package}/README.md" for package in PACKAGES),
            *(
                "--ignore",
                "docs/_build",
                "--ignore",
                "docs/reference/generated",
                "--numprocesses",
                "2",
                "--dist",
                "loadfile",
                "--no-loadscope-reorder",
            ),
        ),
        "sweeps": sweeps(),
        "live": run_both(
            pytest("live-fast", *REAL_TIME, *FAST_DEVICES),
            pytest("live-slow", *REAL_TIME, *SLOW_DEVICES, *(f"--ignore={path}" for path in FAST_DEVICES)),
        ),
    },
}
BACKGROUND: dict[str, tuple[str, ...]] = {
    "docs": ("sphinx-build", "-E", "-W", "--keep-going", "-q", "docs", "docs/_build/html"),
    "kernel": ("python", "tools/vcan_vm.py", "--driver"),
    "wheels": ("python", "tools/wheels.py"),
}
"""Steps of the full tier that wait for downloads or use one processor. They run in the background, two at a time."""
ALONE = "live"
"""Step that runs while no background step can disturb it."""
IDLE = ("kernel",)
"""Background step that uses only idle processor time, so that it can continue during ALONE."""

VERDICTS = {0: "ok     ", SKIPPED: "skipped"}
"""Verdicts by exit code of a step. Every other code is a failure."""


def room_tests(room: str) -> Step:
    """Return a step that runs the gate's tests whose path or text names a room."""
    name = re.compile(rf"(?<![a-z0-9]){re.escape(room)}(?![a-z0-9])")
    files = sorted(path.relative_to(ROOT) for path in (ROOT / "tests").rglob("test_*.py"))
    named = [
        str(path) for path in files if name.search(f"{path}\n{(ROOT / path).read_text(encoding='utf-8')}")
    ]
    if not named:
        sys.exit(f"no test names {room!r}; give the name of a folder of hil_bridge, emulators or protocol")
    return run(*pytest("room", *named, *without_ports("gate")))


def run_steps(steps: dict[str, Step], background: dict[str, tuple[str, ...]]) -> dict[str, tuple[int, float]]:
    """Run the steps in order and the background steps in parallel. Return exit code and duration of each step, s."""
    results: dict[str, tuple[int, float]] = {}

    def run_timed(name: str, step: Callable[[], tuple[int, str]]) -> str:
        began = time.monotonic()
        code, output = step()
        results[name] = code, time.monotonic() - began
        return output

    with ThreadPoolExecutor(2) as pool:
        running = {
            name: pool.submit(run_timed, name, partial(run_captured, command))
            for name, command in background.items()
        }

        def show_background(but: tuple[str, ...] = ()) -> None:
            for name in [name for name in running if name not in but]:
                output = running.pop(name).result()
                print(f"── {name}\n{output}", flush=True)

        for name, step in steps.items():
            if name == ALONE:
                show_background(but=IDLE)
            print(f"── {name}", flush=True)
            run_timed(name, partial(run_shown, step))
        show_background()
    return results


def main() -> int:
    """Run the chosen steps and print a verdict for each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    every_step = {name: step for tier in TIERS.values() for name, step in tier.items()}
    parser.add_argument("--all", action="store_true", help="run the full tier after the gate")
    parser.add_argument("--every", action="store_true", help="run every case of each sweep, not a third")
    parser.add_argument("--only", choices=[*every_step, *BACKGROUND], help="run one step")
    parser.add_argument("--room", help="run the tests that name this folder of the product")
    options = parser.parse_args()
    if options.every:
        every_step["sweeps"] = sweeps(every=True)
    # otherwise the interpreter would compile each module again in every process
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

    steps, background = (every_step, BACKGROUND) if options.all else (TIERS["gate"], {})
    if options.only:
        steps = {name: step for name, step in every_step.items() if name == options.only}
        background = {name: command for name, command in BACKGROUND.items() if name == options.only}
    if options.room:
        steps, background = {options.room: room_tests(options.room)}, {}

    results = run_steps(steps, background)
    for name, (code, seconds) in results.items():
        print(f"{VERDICTS.get(code, 'FAILED ')} {name} ({seconds:.0f} s)")
    return int(any(code not in VERDICTS for code, _ in results.values()))


if __name__ == "__main__":
    sys.exit(main())
