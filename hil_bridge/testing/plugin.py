"""pytest plug-in: fixtures for user tests, the option `--hil-live`, and a summary of the suites that ran.

pytest loads the plug-in at every start if hil-bridge is installed. The plug-in therefore imports no other module of
hil-bridge before a fixture is used, and does nothing for tests outside the suites.
"""

import re
from collections import Counter
from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pytest

SUITE_VERSION = "2"
"""Version of the suites; `hil_suite = "2"` in pytest's settings pins it.

It increases when a new test or a stricter limit may fail an implementation that passed before. It does not increase
when only messages change.
"""

_PROPERTY = "hil_suite"
"""Name of the report property with the suite and its version, also in JUnit files."""
REQUIREMENT, RECORDING = "hil_requirement", "hil_recording"
"""Mark of a test and property of its report for a verified requirement; property of a report for a saved recording
of the run.
"""
_MISSING = object()
"""Placeholder value of a missing fixture."""


class Suite(NamedTuple):
    """Description of a suite."""

    title: str
    needs: str
    """Name of the fixture that the tests of the suite require."""
    example: tuple[str, str, str]
    """Three lines of code that define the fixture."""


def _example(name: str, given: str) -> tuple[str, str, str]:
    return "@pytest.fixture", f"def {name}():", f"    return {given}"


SUITES = {
    f"hil_bridge.testing.{module}": Suite(title, needs, _example(needs, given))
    for module, title, needs, given in (
        ("controllers", "controller", "controller", "MyController()"),
        ("steps", "step", "step", "MyStep()"),
        ("robot_clients", "robot client", "robot_client", "RobotCase(ROBOT)"),
        ("robot_emulators", "robot emulator", "robot_emulator", "RobotCase(ROBOT)"),
        ("sensor_clients", "sensor client", "sensor_client", "SensorCase(SENSOR)"),
        ("sensor_emulators", "sensor emulator", "sensor_emulator", "SensorCase(SENSOR)"),
        ("surfaces", "surface", "surface", "SurfaceCase(SURFACE)"),
        ("streams", "stream transport", "stream_case", 'StreamCase("mine", open_two_ends)'),
        ("datagrams", "datagram transport", "datagram_case", 'DatagramCase("mine", open_two_ends)'),
    )
}
"""Suites by module."""


def _suite_of(function: Any) -> Suite | None:
    return SUITES.get(getattr(function, "__module__", None) or "")


# --- settings


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("hil-bridge", "suites of hil_bridge.testing")
    group.addoption(
        "--hil-live",
        action="append",
        default=[],
        metavar="URL",
        help="real robot or sensor, KIND+WIRE, for the harmless part of its client's suite: reports and frames are "
        "read, a sensor is zeroed, nothing moves; repeatable",
    )
    group.addoption(
        "--hil-recordings",
        metavar="DIR",
        help="folder for the runs of hil_simulate, including those of tests that pass",
    )
    group.addoption(
        "--hil-order",
        type=int,
        metavar="SEED",
        help="in virtual time, run callbacks that are due together in an order drawn by this seed",
    )
    parser.addini(
        "hil_suite", "version of the hil_bridge.testing suites with which this project was tested", default=""
    )


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        "markers", f"{REQUIREMENT}(*names): requirements that the test verifies, such as 'R-12'"
    )
    if (seed := config.getoption("--hil-order")) is not None:
        from hil_bridge.clock.order import VirtualOrder
        from hil_bridge.clock.virtual import VirtualLoop

        VirtualLoop.usual_order = VirtualOrder("all", seed)
        config.add_cleanup(lambda: setattr(VirtualLoop, "usual_order", VirtualOrder()))
    pinned = config.getini("hil_suite")
    if pinned and pinned != SUITE_VERSION:
        raise pytest.UsageError(
            f"hil_suite is {pinned}, but the installed hil-bridge has version {SUITE_VERSION} of its suites: install "
            "the release with your version, or update hil_suite once the tests pass"
        )


# --- tests of a suite


def pytest_itemcollected(item: pytest.Item) -> None:
    if suite := _suite_of(getattr(item, "function", None)):
        item.user_properties.append((_PROPERTY, f"{suite.title}, suite version {SUITE_VERSION}"))
    for mark in item.iter_markers(REQUIREMENT):
        item.user_properties += [(REQUIREMENT, str(name)) for name in mark.args]


@pytest.hookimpl(trylast=True)
def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Parametrise a test whose fixture is missing, so that it runs and fails with an explanation."""
    suite = _suite_of(metafunc.function)
    if not suite or suite.needs not in metafunc.fixturenames:
        return
    given = any(suite.needs in call.params for call in metafunc._calls)
    if not given and suite.needs not in metafunc._arg2fixturedefs:
        metafunc.parametrize(suite.needs, [pytest.param(_MISSING, id="missing")])


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> None:
    suite = _suite_of(pyfuncitem.function)
    if suite and pyfuncitem.funcargs.get(suite.needs) is _MISSING:
        lines = "\n".join(f"    {line}" for line in suite.example)
        pytest.fail(
            f"the suite for a {suite.title} needs fixture {suite.needs!r}; define it in {pyfuncitem.path}:\n{lines}",
            pytrace=False,
        )


def _suite_in(report: Any) -> str:
    """Return the suite of a report; empty for a test outside the suites, whose properties may have any format."""
    for pair in getattr(report, "user_properties", ()):
        if len(pair) == 2 and pair[0] == _PROPERTY:
            return str(pair[1])
    return ""


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Print one line for each suite, and one line for each reason of skipped tests."""
    ran: dict[str, Counter[str]] = {}
    skipped: dict[str, Counter[str]] = {}
    for outcome in ("passed", "failed", "error", "skipped", "xfailed", "xpassed"):
        for report in terminalreporter.stats.get(outcome, ()):
            suite = _suite_in(report)
            if not suite:
                continue
            reasons = skipped.setdefault(suite, Counter())
            outcomes = ran.setdefault(suite, Counter())
            if outcome == "skipped":
                reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
                reasons[reason.removeprefix("Skipped: ")] += 1
            else:
                outcomes[outcome] += 1
    if not ran:
        return
    terminalreporter.write_sep("=", "hil-bridge suites")
    for suite, outcomes in sorted(ran.items()):
        parts = ", ".join(f"{count} {outcome}" for outcome, count in outcomes.items())
        left = sum(skipped[suite].values())
        text = f"{suite}: {sum(outcomes.values())} run{f' ({parts})' if parts else ''}, {left} skipped"
        terminalreporter.write_line(text)
        for reason, count in sorted(skipped[suite].items()):
            terminalreporter.write_line(f"  {count} skipped: {reason}")


# --- fixtures for user tests

_RUNS: pytest.StashKey[list[Any]] = pytest.StashKey()


def _save(result: Any, path: Path) -> str:
    """Save a run. Return the reason if saving fails, which does not fail the test; otherwise return an empty text."""
    from hil_bridge.errors import BridgeError

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        result.save(path, overwrite=True)
    except (BridgeError, OSError) as error:
        return str(error)
    return ""


def _place(item: pytest.Item, number: int) -> tuple[Path, bool]:
    """Return a path for the recording of a test's run, and whether the user chose the folder."""
    if folder := item.config.getoption("--hil-recordings"):
        name = re.sub(r"[^\w.-]+", "-", item.nodeid.replace("::", "."))
        return Path(folder) / f"{name}-{number}.mcap", True
    return item.funcargs["tmp_path"] / f"run-{number}.mcap", False  # type: ignore[attr-defined]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, Any, Any]:
    report = yield
    if report.when == "call" and (runs := item.stash.get(_RUNS, [])):
        lines = []
        for number, result in enumerate(runs):
            item.user_properties += run_properties(number, result)
            path, named = _place(item, number)
            if not (report.failed or named):
                continue
            trouble = _save(result, path)
            if not trouble:
                item.user_properties.append((RECORDING, str(path)))
            why = f": {result.text}" if result.text else ""
            advice = f"not saved: {trouble}" if trouble else f"hil-bridge why {path}"
            lines.append(f"run {number}: {result.outcome}{why}\n    {advice}")
            if not trouble:
                lines.append(f"[[ATTACHMENT|{path}]]")
        if lines:
            report.sections.append(("hil_simulate", "\n".join(lines)))
    return report


def run_properties(number: int, result: Any) -> list[tuple[str, str]]:
    """Return the properties of a run for the report of a test: how it ended, each fault, and each program step with
    its verdict.
    """
    from hil_bridge.errors.event_kinds import EventKind

    name = f"hil_run.{number}"
    properties = [(f"{name}.outcome", str(result.outcome)), (f"{name}.left", result.left)]
    if result.text:
        properties.append((f"{name}.cause", result.text))
    properties += [(f"{name}.fault", event.text) for event in result.events if event.kind == EventKind.FAULT]
    return properties + [
        (f"{name}.step.{step.step}", f"{step.label}: {'passed' if step.passed else f'failed: {step.text}'}")
        for step in result.steps
    ]


@pytest.fixture
def hil_simulate(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[..., Any]:
    """Return `hil_bridge.simulate`, which also records in the report of the test how each run ended and where it
    was saved.

    `--hil-recordings` names a folder for the recordings of all runs. Without this option, only the runs of failed
    tests are kept.
    """
    import hil_bridge

    runs = request.node.stash[_RUNS] = []  # emptied if a test is repeated

    def simulate(config: Any = None, **more: Any) -> Any:
        result = hil_bridge.simulate(config, **more)
        runs.append(result)
        return result

    return simulate


@pytest.fixture
def hil_cell() -> Callable[..., Any]:
    """Return a function that runs `async def script(cell)` with the devices of a configuration in virtual time."""
    import hil_bridge

    def run(script: Callable[[Any], Any], config: Any = None) -> Any:
        async def main() -> Any:
            async with hil_bridge.open_devices(config) as cell:
                return await script(cell)

        return hil_bridge.run_virtual(main)

    return run


@pytest.fixture
def hil_live(request: pytest.FixtureRequest) -> list[str]:
    """Return the URLs of `--hil-live`."""
    urls: list[str] = request.config.getoption("--hil-live")
    return urls


@pytest.fixture
def hil_conform(request: pytest.FixtureRequest) -> Callable[..., Any]:
    """Return a function that runs one scenario of `hil-bridge conform` in the test.

    `hil_conform(kind, command, scenario="nominal", config=None, **rules)` starts `command`, words with placeholders,
    in real time; `config` is a file or settings by dotted key. The verdict fails or skips the test. The evidence
    becomes properties of the test, and the client's output a section of its report; JUnit files contain both. Returns
    the result of the scenario.
    """

    def judge(
        kind: str, command: Sequence[str], scenario: str = "nominal", config: Any = None, **rules: Any
    ) -> Any:
        from hil_bridge.errors import BridgeError
        from hil_bridge.lab.conform.real_time import play_once
        from hil_bridge.lab.conform.reports import evidence

        try:
            result = play_once((kind, scenario), command, config, rules)
        except BridgeError as error:  # a wrong name, or a client that does not start
            pytest.fail(f"{scenario}: {error}", pytrace=False)
        outcome, reason = result.verdict.outcome, result.verdict.reason
        properties = {"outcome": str(outcome), "reason": reason, **evidence(result)}
        request.node.user_properties += [(f"{scenario}.{key}", value) for key, value in properties.items()]
        if result.output:
            request.node.add_report_section("call", f"the client in {scenario}", result.output)
        if outcome == "failed":
            pytest.fail(f"{scenario}: {reason}", pytrace=False)
        if outcome == "skipped":
            pytest.skip(f"{scenario}: {reason}")
        return result

    return judge
