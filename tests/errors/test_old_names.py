"""Packages for an earlier version are refused at once, with all renamed names."""

import importlib
from pathlib import Path

import pytest

from hil_bridge.control.steps.kinds import step_kind
from hil_bridge.errors import ConfigError
from hil_bridge.errors.moved_names import METHODS, MOVED, PLACES_LIMIT, old_names

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "upgrade-a-package.md"
OLD = '''
from dataclasses import dataclass
from hil_bridge.control.program.state import Felt, ProgramState
from hil_bridge.control.steps.seam import Step, Taken

@dataclass(frozen=True, slots=True)
class Wipe(Step):
    """Wipe."""
    do: str = "wipe"

    def take(self, leg, state: ProgramState, felt: Felt) -> Taken:
        return Taken(state, None)
'''
OLD_METHOD = '''
from dataclasses import dataclass
from hil_bridge.control.steps.seam import Step

@dataclass(frozen=True, slots=True)
class Wipe(Step):
    """Wipe."""
    do: str = "wipe"

    def take(self, leg, state, felt):
        return None
'''


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> str:
    """Create a package with the step `wipe`, with a unique name for each test."""
    name = f"wiping_{abs(hash(request.node.name))}"
    info = tmp_path / f"{name}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[hil_bridge.steps]\nwipe = {name}.steps:Wipe\n")
    (tmp_path / name).mkdir()
    (tmp_path / name / "__init__.py").write_text("")
    (tmp_path / name / "steps.py").write_text(request.param)
    monkeypatch.syspath_prepend(str(tmp_path))
    importlib.invalidate_caches()
    return name


@pytest.mark.parametrize("package", [OLD], indirect=True)
def test_outdated_package_lists_all_renamed_names(package: str) -> None:
    with pytest.raises(ConfigError, match=r"was written for hil-bridge before version 0\.7") as refused:
        step_kind("wipe")
    text = str(refused.value)
    assert "\n" not in text
    for part in (
        f"{package}/steps.py:3: Felt is now hil_bridge.control.course.contact_sample.ContactSample",
        f"{package}/steps.py:3: ProgramState is now hil_bridge.control.course.state.StepState",
        f"{package}/steps.py:4: Taken is now hil_bridge.control.steps.seam.StepResult",
        f"{package}/steps.py:11: take(leg, state, felt) is now take(context, state)",
        "it fails with ImportError",
    ):
        assert part in text


@pytest.mark.parametrize("package", [OLD_METHOD], indirect=True)
def test_method_with_old_parameters_is_refused(package: str) -> None:
    with pytest.raises(ConfigError, match=r"take\(leg, state, felt\) is now take\(context, state\)"):
        step_kind("wipe")


@pytest.mark.parametrize("package", [OLD * 10], indirect=True)
def test_old_names_message_is_bounded(package: str) -> None:
    assert old_names(f"{package}.steps").count("is now") == PLACES_LIMIT
    assert old_names(f"{package}.steps").endswith("; and 28 more")


def test_old_names_have_existing_replacements() -> None:
    for new in MOVED.values():
        module, _, name = new.partition(" ")[0].rpartition(".")
        assert hasattr(importlib.import_module(module), name), new


def test_upgrading_page_has_every_method_and_name() -> None:
    page = PAGE.read_text(encoding="utf-8")
    for method, (_, new) in METHODS.items():
        assert f"{method}({new})" in page or f"{method}(…)" in page
    for old in ("Taken", "Led", "Felt", "ProgramState", "Leg", "Place", "Way", "way_of"):
        assert f"`{old}`" in page or f".{old}`" in page


def test_missing_package_has_no_old_names() -> None:
    assert old_names("no_such_package_of_anyone.steps") == ""
