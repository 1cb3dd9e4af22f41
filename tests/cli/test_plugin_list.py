"""`hil-bridge list plugins` reports each fault of a package in one line, with package and location."""

from pathlib import Path

import pytest
from click.testing import CliRunner

from hil_bridge.cli import cli

LAW = '''
from dataclasses import dataclass
from typing import ClassVar
from hil_bridge import Command
@dataclass(frozen=True)
class C:
    """A law."""
    gain: float = 1e-5
    name: ClassVar[str] = "mine"
    def initial(self): return None
    def step(self, state, measurement, reference):
        return None, Command(measurement.commanded, 0.0)
'''
ARM = """
import dataclasses
from hil_bridge.devices.robots.egm.room import ROBOT
@dataclasses.dataclass(frozen=True)
class S:
    x: float
R = dataclasses.replace(ROBOT, name="mine"{})
"""
SURFACE = """
from dataclasses import dataclass
from hil_bridge.devices.kinds import SurfaceKind
@dataclass(frozen=True)
class P:
    stiffness: float = {}
    def __post_init__(self):
        {}
S = SurfaceKind("{}", "x", P, {})
"""


def law(old: str, new: str) -> str:
    assert old in LAW
    return LAW.replace(old, new)


CASES = {
    "import": (
        "controllers",
        "mine",
        ":C",
        "import nothing_there",
        "the module nothing_there is missing",
    ),
    "syntax": ("controllers", "mine", ":C", "class C:\n  x = = 1", "SyntaxError: invalid syntax"),
    "exit": (
        "controllers",
        "mine",
        ":C",
        "\nraise SystemExit(0)",
        "loaded: SystemExit: 0 (mine 1.0, m_exit.py:2)",
    ),
    "two lines": (
        "controllers",
        "mine",
        ":C",
        "raise OSError('a\\nb')",
        "cannot be loaded: OSError: a (mine 1.0, ",
    ),
    "no such": ("controllers", "mine", ":D", LAW, "has no attribute 'D'"),
    "no object": ("controllers", "mine", ":C:D", LAW, "is not an object reference; use module:object"),
    "type": ("controllers", "mine", ":C", "def C(): pass", ":C is not a dataclass"),
    "no step": ("controllers", "mine", ":C", law("def step", "def stepp"), "has no method step"),
    "name": ("controllers", "mine", ":C", law('"mine"', '"yours"'), "must have that as its attribute `name`"),
    "built in": ("controllers", "pi", ":C", LAW, "is built in, but mine 1.0 also provides one of that name"),
    "nan": ("controllers", "mine", ":C", law("1e-5", "float('nan')"), "its parameter gain is nan by default"),
    "making": (
        "controllers",
        "mine",
        ":C",
        LAW + "    def __post_init__(self): {}['a']",
        "KeyError: 'a' (mine 1.0, m_",
    ),
    "arguments": (
        "controllers",
        "mine",
        ":C",
        law(", reference", ""),
        "it fails at its first sample: TypeError: C.step()",
    ),
    "async": (
        "controllers",
        "mine",
        ":C",
        law("def step", "async def step"),
        "its step returned coroutine, not a state",
    ),
    "command": (
        "controllers",
        "mine",
        ":C",
        law("0.0)", "float('inf'))"),
        "at its first sample (mine 1.0, m_command.py:11)",
    ),
    "sample": (
        "controllers",
        "mine",
        ":C",
        LAW + "    sample_ms: ClassVar = -3",
        "its sample_ms must be above 0, got -3",
    ),
    "robot": ("robots", "mine", ":R", "R = None", ":R must be a RobotKind with that name"),
    "dict": (
        "robots",
        "mine",
        ":R",
        ARM.format(", settings=dict"),
        "its settings must be a dataclass, got dict",
    ),
    "no default": (
        "robots",
        "mine",
        ":R",
        ARM.format(", settings=S"),
        "must have a default for each field; x has none",
    ),
    "connect": ("robots", "mine", ":R", ARM.format(", connect=None"), "its connect is not callable"),
    "letters": (
        "robots",
        "a+b",
        ":R",
        ARM.format("").replace('"mine"', '"a+b"'),
        "must be lower-case letters, digits and hy",
    ),
    "nan of a surface": (
        "surfaces",
        "mine",
        ":S",
        SURFACE.format("float('nan')", "pass", "mine", "len"),
        "stiffness is NaN",
    ),
    "defaults": (
        "surfaces",
        "mine",
        ":S",
        SURFACE.format("1", "1 / 0", "mine", "len"),
        "created from its defaults: ZeroDiv",
    ),
    "make": (
        "surfaces",
        "mine",
        ":S",
        SURFACE.format("1", "pass", "mine", "None"),
        "its make is not callable",
    ),
    "section": (
        "surfaces",
        "tool",
        ":S",
        SURFACE.format("1", "pass", "tool", "len"),
        "[cell.tool] is reserved",
    ),
}


def list_plugins(folder: Path, package: str, points: str, monkeypatch: pytest.MonkeyPatch) -> None:
    info = folder / f"{package}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(points)
    monkeypatch.syspath_prepend(str(folder))


@pytest.mark.parametrize("case", CASES)
def test_list_plugins_fault_names_package(case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    group, name, source, text, message = CASES[case]
    module = f"m_{case.replace(' ', '_')}"
    (tmp_path / f"{module}.py").write_text(text, encoding="utf-8")
    list_plugins(tmp_path, "mine", f"[hil_bridge.{group}]\n{name} = {module}{source}\n", monkeypatch)
    result = CliRunner().invoke(cli, ["list", "plugins"], catch_exceptions=False)
    assert result.exit_code == 2
    (line,) = result.output.splitlines()
    assert line.startswith(f"{group[:-1]}  {name}  mine 1.0  WRONG: ")
    assert message in line


def test_list_plugins_duplicate_name_lists_both_packages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "m_twice.py").write_text(LAW, encoding="utf-8")
    for package in ("mine", "yours"):
        list_plugins(tmp_path, package, "[hil_bridge.controllers]\nmine = m_twice:C\n", monkeypatch)
    result = CliRunner().invoke(cli, ["list", "plugins"], catch_exceptions=False)
    assert result.exit_code == 2
    lines = result.output.splitlines()
    assert len(lines) == 2
    assert all(
        "controller 'mine' is provided by mine 1.0 and by yours 1.0; uninstall one" in line for line in lines
    )


def test_list_plugins_accepts_required_parameter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "m_given.py").write_text(law(" = 1e-5", ""), encoding="utf-8")
    list_plugins(tmp_path, "mine", "[hil_bridge.controllers]\nmine = m_given:C\n", monkeypatch)
    result = CliRunner().invoke(cli, ["list", "plugins"], catch_exceptions=False)
    assert (result.exit_code, result.output) == (0, "controller  mine  mine 1.0  A law.\n")


def test_list_plugins_shows_commands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    points = "[hil_bridge.commands]\nmine = mine:greet\n[hil_bridge.commands.list]\nlost = mine:absent\n"
    (tmp_path / "mine.py").write_text(
        "import click\n\n@click.command(short_help='Greet a robot.')\ndef greet(): pass\n"
    )
    list_plugins(tmp_path, "mine", points, monkeypatch)
    result = CliRunner().invoke(cli, ["list", "plugins"])
    assert result.exit_code == 2
    assert "command       mine  mine 1.0  Greet a robot." in result.output
    assert "list command  lost  mine 1.0  WRONG: command 'lost' of mine 1.0 cannot be loaded" in result.output
