"""Examples of docs/reference/testing.md, unchanged, for built-in devices under the names of that page."""

import re
from importlib import import_module
from pathlib import Path

import pytest

import hil_bridge
from hil_bridge import testing
from hil_bridge.testing.plugin import SUITE_VERSION, SUITES

pytest_plugins = "pytester"

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "reference" / "testing.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"^## ([^\n]+)$(?:(?!^## ).)*?^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
PLUGIN = ("-p", "hil_bridge.testing.plugin", "-p", "no:xdist", "-p", "no:asyncio", "-q")
LONG = "not any_sequence and not every_fault and not cancelled and not damaged"
ROOM = """
from emulators.surface.contact import Contact, SurfaceProfile
from emulators.surface.faults import SURFACE_FAULTS
from hil_bridge.devices.kinds import ROBOTS, SENSORS, SurfaceKind

ROBOT, SENSOR = ROBOTS.kind("s3"), SENSORS.kind("jr3-uart")
SURFACE = SurfaceKind("mine", "", SurfaceProfile, lambda s: lambda changed: Contact(s, changed), SURFACE_FAULTS)
"""
for name in SUITES:  # pytester forgets what a run inside it has imported, and NumPy cannot be imported again
    import_module(name)
hil_bridge.simulate({"run": {"duration_s": 0.2}})


@pytest.mark.full
@pytest.mark.parametrize(("title", "code"), EXAMPLES, ids=[title for title, _ in EXAMPLES])
def test_example_passes(
    title: str, code: str, pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = pytester.mkpydir("my_package")
    (package / "room.py").write_text(ROOM)
    (package / "control.py").write_text(
        "from hil_bridge.control import make_controller\nMyController = lambda: make_controller('pi')\n"
    )
    (package / "steps.py").write_text(
        "from hil_bridge.control.steps.hold import Hold\nMyStep = lambda: Hold(for_s=2.0)\n"
    )
    monkeypatch.syspath_prepend(str(pytester.path))
    pytester.makepyfile(test_mine=code)
    result = pytester.inline_run(*PLUGIN, "-k", LONG)
    failed = [
        report.longreprtext for report in result.getreports("pytest_runtest_logreport") if report.failed
    ]
    assert not failed, failed[0][-2000:]
    passed, _, _ = result.countoutcomes()
    assert passed >= 2


def test_suite_page_examples_and_names_are_complete() -> None:
    assert len(EXAMPLES) == PAGE.count("```python") == 9
    for name in testing.__all__:
        assert name in PAGE
    for module, suite in SUITES.items():
        assert f"`{module.rpartition('.')[2]}`" in PAGE
        assert f"`{suite.needs}`" in PAGE
    assert f'hil_suite = "{SUITE_VERSION}"' in PAGE
