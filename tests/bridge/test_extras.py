"""The command for an extra works for the installation that tells it."""

from pathlib import Path

import pytest

import hil_bridge
from hil_bridge.errors.extras import install_command, requirement


@pytest.mark.parametrize("origin", [None, [], {"url": 3}, {"url": "https://h/x.whl", "archive_info": {}}])
def test_a_package_from_an_index_is_named(origin: object) -> None:
    assert requirement(origin, "web") == "'hil-bridge[web]'"


@pytest.mark.parametrize(("editable", "flag"), [(True, "-e "), (False, "")])
def test_a_checkout_is_named_by_its_folder(tmp_path: Path, editable: bool, flag: str) -> None:
    place = tmp_path / "my checkout"
    place.mkdir()
    origin = {"url": place.as_uri(), "dir_info": {"editable": editable}}
    assert requirement(origin, "web") == "'hil-bridge[web]'", "the folder is gone"
    (place / "pyproject.toml").touch()
    assert requirement(origin, "web") == f"{flag}'{place}[web]'"


def test_the_command_is_one_of_pip() -> None:
    assert install_command("tune").startswith("pip install ")
    assert "[tune]" in install_command("tune")


def test_no_message_names_an_extra_by_another_way() -> None:
    package = Path(hil_bridge.__file__).parent
    named = [file for file in package.rglob("*.py") if "hil-bridge[" in file.read_text(encoding="utf-8")]
    assert not named
