"""Commands from entry points: of a plug-in, and of a missing or broken package."""

import sys
from importlib.metadata import EntryPoints
from pathlib import Path

import pytest

import hil_bridge.cli.entry_points
from tests.command_line import Command, refused

HELLO = 'import click\n\n@click.command()\ndef hello():\n    """Say hello."""\n    click.echo("hello")\n'


def offer(folder: Path, package: str, points: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make a package provide commands."""
    info = folder / f"{package}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[hil_bridge.commands]\n{points}\n")
    monkeypatch.syspath_prepend(str(folder))


def test_plugin_command_runs_and_is_in_help(
    hil: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "m_hello.py").write_text(HELLO)
    offer(tmp_path, "mine", "hello = m_hello:hello", monkeypatch)
    assert hil("hello") == (0, "hello\n", "")
    _, output, _ = hil("--help")
    _, _, last = output.partition("\nPlug-ins:\n")
    assert last.split() == ["hello", "Say", "hello."]


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (
            "other = m_nowhere.cli:other",
            "command 'other' of mine 1.0 cannot be loaded: the module m_nowhere is missing; "
            "install it: pip install mine",
        ),
        (
            "other = m_needs:other",
            "command 'other' of mine 1.0 cannot be loaded: the module m_absent is missing; "
            "install it: pip install m_absent",
        ),
        ("other = m_needs_nothing:absent", "command 'other' of mine 1.0 cannot be loaded: AttributeError"),
        ("other = m_needs_nothing:NUMBER", "the command 'other' of mine 1.0 is of type int; it must be"),
        ("run = m_needs_nothing:NUMBER", "command 'run' is provided by hil-bridge "),
    ],
)
def test_command_that_cannot_be_loaded_is_one_line(
    points: str, message: str, hil: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "m_needs.py").write_text("import m_absent\n")
    (tmp_path / "m_needs_nothing.py").write_text("NUMBER = 1\n")
    offer(tmp_path, "mine", points, monkeypatch)
    name = points.split()[0]
    assert message in refused(hil(name))
    code, output, _ = hil("--help")
    assert code == 0
    assert f"\n  {name} " in output


def test_missing_built_in_command_reports_remedy(hil: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hil_bridge.cli.entry_points, "offered", lambda: EntryPoints(()))
    assert "the command 'tune' is not installed; install hil-bridge again: pip install " in refused(
        hil("tune")
    )
    assert "No such command 'nothing'" in refused(hil("nothing"))


def test_missing_device_module_is_one_line(hil: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "hil_bridge.devices.robots.egm.room", None)
    assert (
        "cannot be loaded: the module hil_bridge.devices.robots.egm.room is missing; install it: pip install "
        in refused(hil("run", "--virtual", "--no-view", "--robot", "egm"))
    )


def test_missing_subcommand_keeps_help_of_group(hil: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "hil_bridge.device_commands.s3.commands", None)
    assert "command 'computer-link' of hil-bridge " in refused(hil("decode", "computer-link", "10"))
    code, output, _ = hil("decode", "--help")
    assert code == 0
    assert "cannot be loaded" in " ".join(output.split())
    assert "\n  jr3-can " in output


def test_missing_extension_names_what_to_install(hil: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "hil_bridge.lab.commands.results", None)
    line = refused(hil("compare", "a.sqlite", "b.sqlite"))
    assert "extension 'compare-results' of hil-bridge " in line
    assert "the module hil_bridge.lab.commands.results is missing; install it: pip install " in line
