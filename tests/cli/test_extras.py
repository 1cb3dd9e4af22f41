"""The printed install command of an extra works for the present installation."""

import ast
from importlib.util import find_spec
from pathlib import Path

import pytest
from click.testing import CliRunner

from hil_bridge.cli import cli
from hil_bridge.errors import extras
from hil_bridge.errors.extras import install_command, requirement

PACKAGES = [Path(str(find_spec(name).submodule_search_locations[0])) for name in ("hil_bridge", "emulators")]  # type: ignore[union-attr, index]


@pytest.mark.parametrize("origin", [None, [], {"url": 3}, {"url": "https://h/x.whl", "archive_info": {}}])
def test_install_command_names_package_from_index(origin: object) -> None:
    assert requirement(origin, "web") == "'hil-bridge[web]'"


@pytest.mark.parametrize(("editable", "flag"), [(True, "-e "), (False, "")])
def test_install_command_names_folder_of_checkout(tmp_path: Path, editable: bool, flag: str) -> None:
    folder = tmp_path / "my checkout"
    folder.mkdir()
    origin = {"url": folder.as_uri(), "dir_info": {"editable": editable}}
    assert requirement(origin, "web") == "'hil-bridge[web]'", "the folder no longer exists"
    (folder / "pyproject.toml").touch()
    assert requirement(origin, "web") == f"{flag}'{folder}[web]'"


def test_install_command_is_valid_for_pip() -> None:
    assert install_command("tune").startswith("pip install ")
    assert "[tune]" in install_command("tune")


@pytest.mark.parametrize(
    ("command", "extra"), [("export", "mdf"), ("report", "figures"), ("campaign hunt", "tune")]
)
def test_help_contains_install_command(
    command: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "pyproject.toml").touch()
    origin = {"url": tmp_path.as_uri(), "dir_info": {"editable": True}}
    monkeypatch.setattr(extras, "_origin", lambda: origin)
    text = CliRunner().invoke(cli, [*command.split(), "--help"]).output
    assert any(line.endswith(f"pip install -e '{tmp_path}[{extra}]'") for line in text.splitlines()), text


@pytest.mark.full
def test_messages_use_common_install_command() -> None:
    """Only docstrings of modules and classes may contain one, for the pages; help texts and errors may not."""
    mentions = []
    for path in (path for package in PACKAGES for path in package.rglob("*.py")):
        tree = ast.parse(path.read_text())
        texts = [
            node.body[0]
            for node in ast.walk(tree)
            if isinstance(node, (ast.Module, ast.ClassDef)) and node.body
        ]
        modules = {id(text.value) for text in texts if isinstance(text, ast.Expr)}
        mentions += [
            f"{path}:{node.lineno}"
            for node in ast.walk(tree)
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in modules
            if "hil-bridge[" in node.value
        ]
    assert mentions == []
