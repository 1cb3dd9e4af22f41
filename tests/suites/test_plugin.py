"""pytest plug-in: it reports what is missing, counts what is skipped, and costs nothing to load."""

import subprocess
import sys
from importlib import import_module
from pathlib import Path
from xml.etree import ElementTree

import pytest

import hil_bridge
from hil_bridge.clock.order import VirtualOrder
from hil_bridge.clock.virtual import VirtualLoop
from hil_bridge.testing import SUITE_VERSION
from hil_bridge.testing.plugin import SUITES

pytest_plugins = "pytester"

PLUGIN = ("-p", "hil_bridge.testing.plugin", "-p", "no:xdist", "-p", "no:asyncio")
SUITE_MODULES = [import_module(name) for name in SUITES]
"""Modules imported once: pytester unloads what an inner run imports, and NumPy cannot be imported again."""
hil_bridge.simulate({"run": {"duration_s": 0.2}})


def test_missing_fixture_is_reported_with_location(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        test_mine="\n".join(f"from {module} import *" for module in SUITES)
        + "\nfrom hil_bridge.testing.transports import TestStreamWire\n"
    )
    result = pytester.runpytest_inprocess(*PLUGIN, "-q", "-x", "--maxfail=1000")
    counts = result.parseoutcomes()
    assert set(counts) <= {"failed", "warnings"}, counts
    output = result.stdout.str()
    where = pytester.path / "test_mine.py"
    for suite in SUITES.values():
        example = "\n".join(f"    {line}" for line in suite.example)
        assert (
            f"the suite for a {suite.title} needs fixture {suite.needs!r}; define it in {where}:\n{example}\n"
            in output
        )


MINE = """
import pytest
from hil_bridge.testing import SurfaceCase
from hil_bridge.testing.surfaces import *
from hil_bridge.devices.kinds import SurfaceKind
from emulators.surface.contact import Contact, SurfaceProfile

KIND = SurfaceKind("mine", "", SurfaceProfile, lambda s: lambda changed: Contact(s, changed))

@pytest.fixture
def surface():
    return SurfaceCase(KIND)

def test_of_my_own(hil_simulate, hil_cell):
    async def script(cell):
        return (await cell.robot.ready()).pose.position[2]

    assert hil_cell(script) == pytest.approx(0.6, abs=0.001)
    stop = {"on": "robot", "fault": "emergency-stop", "phase": "approach"}
    assert hil_simulate({"run": {"duration_s": 1.0}}, faults=[stop]).outcome == "completed"
"""


def test_summary_counts_tests_and_failed_run_is_saved(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(test_mine=MINE)
    result = pytester.runpytest_inprocess(*PLUGIN, "-q")
    assert result.parseoutcomes()["passed"] == 8
    result.stdout.fnmatch_lines(
        [
            "* hil_simulate *",
            "run 0: stopped: *emergency stop*",
            "    hil-bridge why */run-0.mcap",
            "* hil-bridge suites *",
            f"surface, suite version {SUITE_VERSION}: 9 run (8 passed, 1 failed), 1 skipped",
            "  1 skipped: not declared: friction (SurfaceCase.friction)",
        ]
    )


def test_order_of_callbacks_is_drawn_by_option(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(VirtualLoop, "usual_order", VirtualOrder())
    pytester.makepyfile(
        test_mine="""
        from hil_bridge.clock import Clock, run_virtual

        def test_order():
            async def main():
                clock, names = Clock.running(), []
                for name in "abcdef":
                    clock.call_at(clock.now() + 1.0, lambda name=name: names.append(name))
                await clock.sleep_until(clock.now() + 2.0)
                return "".join(names)

            assert run_virtual(main) == "abcdef"
        """
    )
    assert pytester.runpytest_inprocess(*PLUGIN, "-q").parseoutcomes() == {"passed": 1}
    assert pytester.runpytest_inprocess(*PLUGIN, "-q", "--hil-order", "7").parseoutcomes() == {"failed": 1}
    assert pytester.runpytest_inprocess(*PLUGIN, "-q").parseoutcomes() == {"passed": 1}


def test_fixture_from_parameter_or_conftest_is_used(pytester: pytest.Pytester) -> None:
    body = MINE.partition("@pytest.fixture")[0]
    pytester.makepyfile(
        test_marked=body + "pytestmark = pytest.mark.parametrize('surface', [SurfaceCase(KIND)])\n",
        test_generated=body
        + "def pytest_generate_tests(metafunc): metafunc.parametrize('surface', [SurfaceCase(KIND)])\n",
    )
    shared = pytester.mkdir("shared")
    (shared / "test_shared.py").write_text("from hil_bridge.testing.surfaces import *\n")
    own = body.replace("from hil_bridge.testing.surfaces import *", "")
    (shared / "conftest.py").write_text(own + "@pytest.fixture\ndef surface(): return SurfaceCase(KIND)\n")
    result = pytester.runpytest_inprocess(*PLUGIN, "-q", "-k", "above or pulls")
    assert result.parseoutcomes()["passed"] == 6


@pytest.mark.parametrize("version", [SUITE_VERSION, "0"])
def test_unpinned_runtime_version_is_refused(pytester: pytest.Pytester, version: str) -> None:
    pytester.makeini(f"[pytest]\nhil_suite = {version}\n")
    pytester.makepyfile("def test_nothing(): pass")
    result = pytester.runpytest_inprocess(*PLUGIN)
    if version == SUITE_VERSION:
        assert result.ret == 0
        return
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    assert [line for line in result.stderr.lines if line] == [
        f"ERROR: hil_suite is 0, but the installed hil-bridge has version {SUITE_VERSION} of its suites: install the "
        "release with your version, or update hil_suite once the tests pass"
    ]


def test_plugin_loading_imports_no_product_module() -> None:
    code = (
        "import sys, pytest, time; before = set(sys.modules); began = time.process_time(); "
        "import hil_bridge.testing.plugin; took = time.process_time() - began; "
        "new = sorted(set(sys.modules) - before); "
        "assert new == ['hil_bridge', 'hil_bridge.testing', 'hil_bridge.testing.plugin'], new; "
        "assert took < 0.05, took"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=Path(__file__).parents[2])


def test_suite_test_names_are_unique() -> None:
    """A module may import several suites with `*`: one must not hide the tests of another."""
    owners: dict[str, str] = {}
    for module in SUITE_MODULES:
        for name in module.__all__:
            if name.lower().startswith("test"):
                assert name not in owners, f"{name} is in {owners[name]} and in {module.__name__}"
                owners[name] = module.__name__


OF_OTHERS = """
import shutil

def test_with_odd_properties(request):
    request.node.user_properties += [(["a list"], 1), ("three", 1, 2)]

def test_that_takes_its_folder_away(hil_simulate, tmp_path):
    hil_simulate({"run": {"duration_s": 0.2}})
    shutil.rmtree(tmp_path)
    tmp_path.write_text("no folder")
    raise AssertionError
"""


def test_plugin_does_not_end_third_party_tests(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(test_mine=OF_OTHERS)
    result = pytester.runpytest_inprocess(*PLUGIN, "-q")
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(["* hil_simulate *", "run 0: completed*", "    not saved: *"])
    assert "INTERNALERROR" not in result.stdout.str() + result.stderr.str()


CONFORM = """
import sys
import pytest

@pytest.mark.parametrize("mode", ["pose", "joint"])
def test_my_client(hil_conform, mode):
    play = hil_conform("egm", [sys.executable, {client!r}, "{{port}}"], config={{"cell.egm.mode": mode}}, {rules})
    assert play.seen.orders > 10

def test_a_wrong_rule(hil_conform):
    with pytest.raises(pytest.fail.Exception, match="a rule: .*fire"):
        hil_conform("egm", ["true"], fire=1)
"""
EGM_CLIENT = """
import socket, sys, time
from protocol.devices.egm import PoseMm, SensorMessage, decode_robot, encode_answer
wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
wire.bind(("127.0.0.1", int(sys.argv[1])))
print("this is my client", flush=True)
start = None
for k in range(1, 400):
    data, robot = wire.recvfrom(1500)
    told = decode_robot(data).feedback.pose
    start = start or told
    x, y, z = start.position_mm
    a, b, c, d = start.quaternion
    turn = (b, c, d, a) if sys.argv[2:] == ["turned"] else (a, b, c, d)
    wire.sendto(encode_answer(SensorMessage(k, 0, PoseMm((x, y, z - 0.02 * k), turn))), robot)
"""


def test_unknown_name_fails_test_with_one_line(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        test_mine="def test_my_client(hil_conform):\n    hil_conform('emg', ['true'], 'stopped')\n"
    )
    result = pytester.runpytest_inprocess(*PLUGIN, "-q")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["stopped: unknown robot or sensor 'emg'; known: egm, rsi, *"])
    result.stdout.no_fnmatch_line("*Error*")


@pytest.mark.live
def test_client_verdict_appears_in_junit_file(
    pytester: pytest.Pytester,
) -> None:
    client = pytester.path / "client.py"
    client.write_text(EGM_CLIENT)
    pytester.makepyfile(test_mine=CONFORM.format(client=str(client), rules="run_s=0.5, stand_s=3.0"))
    result = pytester.runpytest_inprocess(*PLUGIN, "-q", "--junitxml=mine.xml", "-o", "junit_logging=all")
    result.assert_outcomes(passed=2, skipped=1)
    cases = {
        case.get("name"): case for case in ElementTree.parse(pytester.path / "mine.xml").iter("testcase")
    }
    passed, skipped = cases["test_my_client[pose]"], cases["test_my_client[joint]"]
    properties = {each.get("name"): each.get("value") for each in passed.iter("property")}
    assert properties["nominal.outcome"] == "passed"
    assert float(properties["nominal.largest_turn_rad"] or "nan") == pytest.approx(0.0, abs=1e-3)
    assert int(properties["nominal.orders"] or 0) > 10
    reason = skipped.find("skipped")
    assert reason is not None
    assert "a pose, but EGM runs in mode joint" in str(reason.get("message"))


@pytest.mark.live
def test_client_with_mistake_fails(pytester: pytest.Pytester) -> None:
    client = pytester.path / "client.py"
    client.write_text(EGM_CLIENT)
    rules = "run_s=0.5, stand_s=0.2"
    text = CONFORM.format(client=str(client), rules=rules).replace('"{port}"', '"{port}", "turned"')
    pytester.makepyfile(test_mine=text)
    result = pytester.runpytest_inprocess(*PLUGIN, "-q", "-k", "pose")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        ["*nominal: *of its orders rotate the tool abruptly*", "* the client in nominal *"]
    )
    assert "this is my client" in result.stdout.str()
