"""The commands that measure the house: its arrows, its lines, and whether a run is the same as before."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import grimp
import pytest

from tools import house_doc
from tools.device_rooms import DeviceRooms
from tools.same_run import Run, compared, read
from tools.size import Function, too_long, too_wide

ROOT = Path(__file__).resolve().parents[2]
ARCHITECTURE = ROOT / "docs" / "explanation" / "architecture.md"


def written(tree, **modules):
    """A checkout with these modules; a name's double underscore is a folder's border."""
    for name, text in modules.items():
        path = tree.joinpath(*name.split("__")).with_suffix(".py")
        path.parent.mkdir(parents=True, exist_ok=True)
        (path.parent / "__init__.py").touch()
        path.write_text(text, encoding="utf-8")
    (tree / "hil_bridge" / "__init__.py").touch()
    return tree


def run(tool, tree):
    """Output of the tool for a checkout, and its exit code."""
    command = [sys.executable, "-m", f"tools.{tool}", "--tree", tree]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert not done.stderr
    return done.stdout.splitlines(), done.returncode


def test_arrows_are_counted_by_room_and_a_circle_is_named(tmp_path):
    modules = {
        "hil_bridge__errors": "",
        "hil_bridge__lower__base": "import hil_bridge.errors\n",
        "hil_bridge__upper__run": "import hil_bridge.lower.base\nimport hil_bridge.errors\n",
        "hil_bridge__upper__show": "import hil_bridge.lower.base\nimport hil_bridge.upper.run\n",
    }
    tree = written(tmp_path, **modules)
    straight = ["hil_bridge: 3 rooms, 3 arrows (4 imports)", "at any depth: 3 folders, 3 arrows (4 imports)"]
    assert run("arrows", tree) == (straight, 0)
    written(tmp_path, hil_bridge__lower__base="import hil_bridge.upper.run\n")
    circular, code = run("arrows", tree)
    assert code == 1
    assert circular[2:] == [
        "circle: hil_bridge.lower, hil_bridge.upper",
        "upward, within hil_bridge: hil_bridge.lower.base → hil_bridge.upper.run",
    ]


def test_lines_are_counted_by_room_and_wide_functions_named(tmp_path):
    wide = "class Wide:\n    def take(self, a, *b, c=1, **d):\n        return a\n"
    long = "def act():\n" + "    pass\n" * 600
    tree = written(tmp_path, hil_bridge__room__wide=wide, tools__long=long, tests__wire__test_it="\n" * 7)
    said, code = run("size", tree)
    assert code == 0
    assert said == [
        "product: 3 lines",
        "       3 hil_bridge/room",
        "       0 hil_bridge",
        "tests: 7 lines",
        "       7 tests/wire",
        "tools: 601 lines",
        "     601 tools",
        "modules above 500 lines",
        "     601 tools/long.py",
        "longest functions, in lines",
        "     601 tools/long.py:1 act",
        "       2 hil_bridge/room/wide.py:2 take",
        "widest parameter lists",
        "       4 hil_bridge/room/wide.py:2 take",
        "       0 tools/long.py:1 act",
    ]


def test_a_function_with_too_many_parameters_is_found_but_not_a_command(tmp_path):
    six = "def take(a, b, /, c, *d, e=1, **f):\n    return a\n"
    five = "class Five:\n    async def take(self, a, b, c, d, e):\n        return a\n"
    tree = written(tmp_path, hil_bridge__cli__run=six, protocol__room__five=five, tools__six=six)
    assert run("size", tree)[1] == 1
    assert too_wide(tree) == [Function("tools/six.py:1 take", 2, 6)]


def test_no_function_of_ours_has_too_many_parameters():
    assert [each.place for each in too_wide(ROOT)] == []


def test_no_function_is_longer_than_the_style_allows():
    assert [each.place for each in too_long(ROOT)] == []


def test_the_figures_of_the_architecture_are_those_of_the_house():
    page = ARCHITECTURE.read_text(encoding="utf-8")
    assert house_doc.renewed(page) == page, "run python -m tools.documents house"


def test_lines_may_be_off_a_little_and_other_figures_not(monkeypatch):
    page = ARCHITECTURE.read_text(encoding="utf-8")
    told = house_doc.lines_told(page)
    counted = int(house_doc.lines_told("").replace(" ", ""))
    assert house_doc.lines_told(page.replace(told, str(counted + 1000))) == str(counted + 1000)
    assert house_doc.lines_told(page.replace(told, str(counted + 3000))) == house_doc.lines_told("")
    monkeypatch.setattr(house_doc, "contracts", lambda: 99)
    assert "| import contracts | 6 | 8 | 99 |" in house_doc.renewed(page)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Three short virtual runs: two of one seed, one of another."""
    place = tmp_path_factory.mktemp("runs")
    paths = [place / f"{name}.mcap" for name in ("one", "again", "other")]
    for path, seed in zip(paths, (7, 7, 8), strict=True):
        command = f"run --virtual --no-view --duration 3 --seed {seed} --record {path}".split()
        subprocess.run(
            [sys.executable, "-m", "hil_bridge", *command], cwd=ROOT, check=True, stdout=subprocess.DEVNULL
        )
    return [read(path) for path in paths]


def test_a_run_of_the_same_seed_is_the_same_run(recordings):
    one, again, other = recordings
    assert compared(one, again) == ([], True)
    told, equal = compared(one, other)
    assert not equal
    assert any(line.startswith("DIFFERENT forces: force in ") for line in told)
    assert "metadata: run.seed: 7 before, 8 after" in told


def test_a_field_or_a_key_that_one_recording_lacks_is_named(recordings):
    one = recordings[0]
    cycles = [
        {("bias" if name == "gain" else name): value for name, value in each.items()} for each in one.cycles
    ]
    keys = {name.replace("run.config.task", "run.config.aim"): value for name, value in one.metadata.items()}
    told, equal = compared(one, Run(cycles, keys))
    assert equal
    assert told[:2] == ["field only before: gain", "field only after: bias"]
    assert "metadata only before: run.config.task.force_n" in told
    assert "metadata only after: run.config.aim.force_n" in told
    without = [{name: value for name, value in each.items() if name != "force"} for each in one.cycles]
    assert not compared(one, Run(without, one.metadata))[1]
    assert not compared(Run([], {}), Run([], {}))[1]


def rooms_contract(*imports):
    """Whether the contract of the devices' rooms keeps these imports, and those that break it."""
    graph = grimp.ImportGraph()
    for folder in ("wire.devices", "house.robots"):
        for room in ("red", "blue"):
            graph.add_module(f"{folder}.{room}")
            graph.add_module(f"{folder}.{room}.part")
    for importer, imported in imports:
        graph.add_import(importer=importer, imported=imported)
    options = {"folders": ["wire.devices", "house.robots"], "allowed_importers": ["house.shop"]}
    checked = DeviceRooms("rooms", {}, options).check(graph, verbose=False)
    return checked.kept, checked.metadata["broken"]


def test_a_device_knows_its_own_rooms_and_no_other():
    own = ("house.robots.red.part", "wire.devices.red.part")
    shell = ("house.robots.red.part", "house.robots.shell")
    shop = ("house.shop.red", "house.robots.red")
    assert rooms_contract(own, shell, shop) == (True, [])
    other = ("house.robots.red.part", "wire.devices.blue.part")
    general = ("house.run", "wire.devices.red")
    assert rooms_contract(own, other, general) == (False, [other, general])


def test_changelog_begins_with_the_version_of_the_package():
    """Changes of a development version are under Unreleased, and `make release-check` refuses such a version."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    newest, last = re.findall(
        r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE
    )[:2]
    developed = ".dev" in project["version"]
    assert newest == ("Unreleased" if developed else project["version"])
    assert not developed or numbers(project["version"]) > numbers(last)


def numbers(version):
    """Numbers of a version, to compare it with another one."""
    return tuple(map(int, version.partition(".dev")[0].split(".")))
