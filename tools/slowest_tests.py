"""The tests that take the most processor time: a plug-in of pytest.

`python -m pytest -p tools.slowest_tests --slowest-tests FILE` prints the forty slowest, and writes all tests and all
files into FILE. Each time is that of the processor, s, with the child processes that the test has waited for: a busy
machine does not change it. A fixture of a module or a session counts for the test that needs it first.
"""

import os
import time
from collections import Counter
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest

SHOWN = 40
"""How many tests are printed."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--slowest-tests", metavar="FILE", help="file for the processor time of each test")


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(SlowestTests(config.getoption("--slowest-tests")), "times of tests")


def used_s() -> float:
    """Processor time of this process and of its ended children, s."""
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system


class SlowestTests:
    """Measures in the process that runs a test; gathers and tells in the one that was started."""

    def __init__(self, path: str | None) -> None:
        self._path = path
        self._began = 0.0, 0.0
        self._tests: dict[str, tuple[float, float]] = {}
        """Processor time and duration of each test, s."""

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self) -> Generator[None, Any, Any]:
        self._began = used_s(), time.monotonic()
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self) -> Generator[None, Any, Any]:
        report = yield
        if report.when == "teardown":
            used, began = self._began
            report.cost_s = used_s() - used, time.monotonic() - began
        return report

    def pytest_runtest_logreport(self, report: Any) -> None:
        if cost := getattr(report, "cost_s", None):
            self._tests[report.nodeid] = tuple(cost)

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        if not self._tests:
            return
        tests = sorted(self._tests.items(), key=lambda test: -test[1][0])
        lines = [f"{used:8.2f} s, took {took:7.2f} s  {name}" for name, (used, took) in tests]
        total = sum(used for used, _ in self._tests.values())
        terminalreporter.section(
            f"slowest of {len(tests)} tests, by processor time; all together {total:.0f} s"
        )
        for line in lines[:SHOWN]:
            terminalreporter.line(line)
        if self._path:
            files: Counter[str] = Counter()
            for name, (used, _) in tests:
                files[name.partition("::")[0]] += used
            by_file = [f"{used:8.2f} s  {name}" for name, used in files.most_common()]
            path = Path(self._path)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(
                "\n".join([f"{total:8.2f} s  all", "", *by_file, "", *lines, ""]), encoding="utf-8"
            )
