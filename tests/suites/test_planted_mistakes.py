"""Naive implementations pass the suites, and each planted mistake is detected and reported."""

import re
from importlib import import_module
from pathlib import Path

import pytest

from hil_bridge.testing.plugin import SUITES

pytestmark = pytest.mark.sweep

pytest_plugins = "pytester"

MODULES = {
    "controller": """
from hil_bridge.testing.controllers import *
from naive.controller import NaiveController

@pytest.fixture(params=MISTAKES, ids=lambda name: name or "none")
def controller(request):
    return NaiveController(mistake=request.param)
""",
    "step": """
from hil_bridge.testing.steps import *
from naive.step import NaiveStep

@pytest.fixture(params=MISTAKES, ids=lambda name: name or "none")
def step(request):
    return NaiveStep(mistake=request.param)
""",
    "robot": """
from hil_bridge.testing import RobotCase
from hil_bridge.testing.robot_clients import *
from naive.robot import ROBOT, settings

@pytest.fixture(params=MISTAKES, ids=lambda name: name or "none")
def robot_client(request):
    stop = ("robot", "motors-off")
    return RobotCase(ROBOT, stop=stop, numbered=True, settings=settings(request.param))
""",
    "sensor": """
from hil_bridge.testing import SensorCase
from hil_bridge.testing.sensor_clients import *
from naive.sensor import SENSOR, settings

@pytest.fixture(params=MISTAKES, ids=lambda name: name or "none")
def sensor_client(request):
    return SensorCase(SENSOR, checked=True, settle_s=0.3, settings=settings(request.param))
""",
}
NAMED = {
    "controller": {
        "sign": "wrong direction: too much force",
        "self": "keeps internal state",
        "nan": "responds to an invalid measurement",
        "lost": "without contact",
        "windup": "winds up",
    },
    "step": {
        "self": "keeps internal state",
        "place": "the input state was modified",
        "clock": "reads a clock",
        "nan": "the setting radius_mm accepts NaN",
        "endless": "a led step needs for_s",
        "moment": "it fails: ValueError: it leads to nan m, nan m",
        "turns": "it fails: ArithmeticError: the moment has turned",
        "negative": "it fails: ValueError: it asks for a force of -10 N",
        "divides": "ZeroDivisionError: float division by zero",
        "far": "it asks for a force of",
        "words": "describe must return single lines",
        "file": "read back from a recording",
    },
    "robot": {
        "stop": "orders continued after a protective stop",
        "commanded": "the commanded pose is reported as the actual one",
        "stale": "a stale packet was taken for a new report",
        "leak": "leaks a wire",
        "mm": "mm or mN interpreted as m or N",
    },
    "robot, more": {
        "halt": "a halted robot continues to move",
        "nowhere": "an order with NaN is accepted",
        "waits": "waits forever",
        "task": "leaves a task behind",
        "sign": "the sign of its vector part is wrong",
    },
    "sensor": {
        "moment-sign": "the sign of my is wrong",
        "zero-unit": "not in the unit of the frame",
        "check": "its checksum was ignored",
        "split": "is reassembled incorrectly",
        "repeat": "an old frame is reported as a new one",
        "overload": "an overload is not reported",
    },
}
PLUGIN = ("-p", "hil_bridge.testing.plugin", "-p", "no:xdist", "-p", "no:asyncio", "-q", "--tb=native")
for name in SUITES:  # pytester forgets what a run inside it has imported, and NumPy cannot be imported again
    import_module(name)
QUICK = {
    "robot, more": "(no_number and nowhere) or (silent and waits) or (cancelled and task) or (where_the and sign) or "
    "(after_a_halt and not nowhere and not waits and not task and not sign)"
}
"""Tests for mistakes that the complete suite detects slowly."""
LONG = "not any_sequence and not every_fault"


@pytest.mark.parametrize("kind", NAMED)
def test_planted_mistake_is_detected_by_its_test(
    kind: str, pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    named = NAMED[kind]
    head = f"import pytest\nMISTAKES = {list(named)}\n"
    pytester.makepyfile(head + MODULES[kind.partition(",")[0]])
    result = pytester.inline_run(*PLUGIN, "-k", QUICK.get(kind, LONG))
    output = dict.fromkeys(named, "")
    for report in result.getreports("pytest_runtest_logreport"):
        if report.failed:
            mistake = next(name for name in output if re.search(rf"[\[-]{name}[\]-]", report.nodeid))
            output[mistake] += str(report.longrepr)
    missed = {mistake: text for mistake, text in named.items() if text not in output[mistake]}
    assert not missed, {mistake: output[mistake][-2000:] for mistake in missed}


@pytest.mark.parametrize("kind", MODULES)
def test_naive_implementation_passes(
    kind: str, pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    pytester.makepyfile("import pytest\nMISTAKES = ['']\n" + MODULES[kind])
    result = pytester.inline_run(*PLUGIN)
    failed = [
        report.longreprtext for report in result.getreports("pytest_runtest_logreport") if report.failed
    ]
    assert not failed, failed[0][-3000:]
    passed, _, _ = result.countoutcomes()
    assert passed >= 9
