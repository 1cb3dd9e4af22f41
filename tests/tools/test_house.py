"""Tests of size limits, the import contract of device packages, and the version of the package."""

import re
import tomllib
from pathlib import Path

import grimp
import pytest

from tools.device_rooms import DeviceRooms
from tools.same_run import compare, read
from tools.size import exceeded, exceeded_functions, lines_by_room

ROOT = Path(__file__).resolve().parents[2]


LIMITS = {
    "five parameters": ("def act(self, a, *b, c=1, d, **e):\n    pass\n", []),
    "six parameters": ("def act(a, b, /, c, *d, e=1, **f):\n    pass\n", ["1 act: 6 parameters"]),
    "a method that is too long": (
        "class Act:\n    async def act(self):\n" + "        pass\n" * 60,
        ["2 act: 61 lines"],
    ),
}


@pytest.mark.parametrize("name", LIMITS)
def test_functions_above_limit_are_named(name):
    text, excesses = LIMITS[name]
    assert list(exceeded_functions(text)) == excesses


def test_long_modules_are_named_except_commands(tmp_path):
    for name in ("hil_bridge/cli/run.py", "tools/run.py"):
        path = tmp_path / name
        path.parent.mkdir(parents=True)
        path.write_text("def act(a, b, c, d, e, f): ...\n" + "\n" * 500, encoding="utf-8")
    assert list(exceeded(tmp_path)) == [
        "hil_bridge/cli/run.py: 501 lines",
        "tools/run.py: 501 lines",
        "tools/run.py:1 act: 6 parameters",
    ]
    assert lines_by_room(tmp_path) == {"hil_bridge/cli": 501, "tools": 501}


def test_code_is_within_style_limits():
    assert list(exceeded(ROOT)) == []


def rooms_contract(*imports):
    """Return whether the contract of device packages allows these imports, and those that break it."""
    graph = grimp.ImportGraph()
    for folder in ("wire.devices", "house.robots"):
        for room in ("red", "blue"):
            graph.add_module(f"{folder}.{room}")
            graph.add_module(f"{folder}.{room}.part")
    for importer, imported in imports:
        graph.add_import(importer=importer, imported=imported)
    options = {"folders": ["wire.devices", "house.robots"]}
    checked = DeviceRooms("rooms", {}, options).check(graph, verbose=False)
    return checked.kept, checked.metadata["broken"]


def test_device_imports_only_its_own_packages():
    own = ("house.robots.red.part", "wire.devices.red.part")
    shell = ("house.robots.red.part", "house.robots.shell")
    assert rooms_contract(own, shell) == (True, [])
    other = ("house.robots.red.part", "wire.devices.blue.part")
    general = ("house.run", "wire.devices.red")
    assert rooms_contract(own, other, general) == (False, [other, general])


CHANGES = ("Added", "Changed", "Deprecated", "Removed", "Fixed", "Security")


def test_changelog_begins_with_package_version():
    """Changes of a development version are under Unreleased, and `make release-check` refuses such a version."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    newest, last = re.findall(
        r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE
    )[:2]
    developed = ".dev" in project["version"]
    assert newest == ("Unreleased" if developed else project["version"])
    assert not developed or numbers(project["version"]) > numbers(last)


def test_changelog_lists_short_changes_under_known_headings():
    """The headings are those of Keep a Changelog; a line of a change has at most 200 characters."""
    heading = ""
    for line in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").splitlines():
        if line.startswith("#"):
            heading = line
        elif line.startswith(("- ", "  ")):
            assert heading.removeprefix("### ") in CHANGES, line
            assert len(line) <= 200, line


def numbers(version):
    """Return the numbers of a version, for comparison."""
    return tuple(map(int, version.partition(".dev")[0].split(".")))


@pytest.fixture
def seeded(tmp_path, hil):
    """Return three short virtual runs: two with one seed, one with another."""
    paths = [tmp_path / f"{name}.mcap" for name in ("one", "again", "other")]
    for path, seed in zip(paths, (7, 7, 8), strict=True):
        hil(*f"run --virtual --no-view --duration 3 --seed {seed} --record {path}".split())
    return [read(path) for path in paths]


def test_same_seed_gives_same_run(seeded):
    one, again, other = seeded
    assert compare(one, again) == ([], True)
    reported, equal = compare(one, other)
    assert not equal
    assert any(line.startswith("DIFFERENT forces: force in ") for line in reported)
    assert "metadata: run.seed: 7 before, 8 after" in reported
