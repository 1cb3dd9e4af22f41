"""Settings for all tests: no deadline for examples, because their time on a busy machine says nothing about the code.

Examples are the same in every run, so that a failing run fails again; `--hypothesis-profile explore` draws others.
"""

import gc
import signal
import sys
from collections import Counter
from collections.abc import Callable
from importlib.metadata import distributions
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

from hil_bridge.errors import offers
from tests.command_line import Command, Result
from tests.recordings import Recordings

settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.register_profile("explore", deadline=None)
settings.load_profile("repeatable")

# A shell that starts these tests behind `&` lets them ignore Ctrl-C, and nohup a terminal that closes. The programs
# that they start would inherit it.
for number in (signal.SIGINT, signal.SIGHUP, signal.SIGQUIT, signal.SIGTERM):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)


PACKAGES = {path.parent.name for path in Path(__file__).parents[1].glob("packages/*/pyproject.toml")}
"""Packages of devices, which have their own tests."""


def pytest_configure(config: pytest.Config) -> None:
    """Hide the packages of devices, which may be installed, from the tests of hil-bridge."""
    patch = pytest.MonkeyPatch()
    patch.setattr(
        offers, "distributions", lambda: (one for one in distributions() if one.name not in PACKAGES)
    )
    offers._entry_points.cache_clear()
    config.add_cleanup(patch.undo)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--tier", choices=("gate", "full"), help="gate: tests of every change; full: all others")
    parser.addoption(
        "--part", default="1/1", help="2/3: of each sweep, the full tier runs the second third only"
    )


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Select one tier. Of a test marked `sweep`, the gate runs only the first case, and the full tier `--part` of the
    others; of one marked `full`, the gate runs none.
    """
    if not (tier := config.getoption("--tier")):
        return
    part, parts = map(int, config.getoption("--part").split("/"))
    tiers: dict[str, list[pytest.Item]] = {"gate": [], "full": [], "other parts": []}
    cases = Counter[str]()
    for item in items:
        function = item.nodeid.partition("[")[0]
        number = cases[function]
        cases[function] += 1
        is_further_case = item.get_closest_marker("sweep") is not None and number > 0
        if is_further_case and number % parts != part % parts:
            tiers["other parts"].append(item)
        else:
            tiers["full" if is_further_case or item.get_closest_marker("full") else "gate"].append(item)
    items[:] = tiers.pop(tier)
    config.hook.pytest_deselected(items=[item for others in tiers.values() for item in others])


def pytest_collection_finish() -> None:
    """Exclude thousands of collected tests from garbage collection, which would visit them each time."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session")
def recordings(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Recordings:
    """Return recordings for tests that only read them. Parallel test processes share their folder."""
    base = tmp_path_factory.getbasetemp()
    side_by_side = hasattr(request.config, "workerinput")
    return Recordings((base.parent if side_by_side else base) / "recordings")


@pytest.fixture
def hil(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], tmp_path: Path) -> Command:
    """Run `hil-bridge` with these arguments in an empty folder; return exit code, output and errors."""
    from hil_bridge.cli import main

    monkeypatch.chdir(tmp_path)

    def command(*arguments: object) -> Result:
        monkeypatch.setattr(sys, "argv", ["hil-bridge", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        output, errors = capfd.readouterr()
        return int(ended.value.code or 0), output, errors

    return command


@pytest.fixture(scope="session")
def bench() -> Callable[..., Any]:
    """Run the loop in virtual time: `tests.bench.run_bench`."""
    from tests.bench import run_bench

    return run_bench
