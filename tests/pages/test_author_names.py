"""Public names that the pages for authors mention are in the reference."""

import importlib
import pkgutil
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import emulators
import hil_bridge
import protocol
from hil_bridge import api
from tools.author_names import GROUPS, author_names, package_names

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGES = (
    "how-to/controllers.md",
    "how-to/devices.md",
    "how-to/surfaces.md",
    "reference/api.md",
    "reference/conform.md",
    "reference/fidelity.md",
    "reference/surfaces.md",
    "reference/testing.md",
)
"""Pages that name what authors should use."""
EXAMPLE_NAMES = {"Reader", "ROBOT", "SENSOR", "SURFACE"}
"""Names of an author's own package that also exist in ours."""
THIRD_PARTY_NAMES = {"NamedTuple", "Struct"}
"""Names of other libraries."""
CODE = re.compile(r"`([A-Za-z_]\w*)(?:\.\w+)*(?:\([^`]*\))?`")
IMPORT = re.compile(r"^from ((?:hil_bridge|emulators|protocol)[\w.]*) import (.+)$", re.MULTILINE)
REFERENCE = {name for modules in GROUPS.values() for names in modules.values() for name in names}


def defined_names() -> set[str]:
    """Return the capitalised names of all our modules."""
    return {
        name
        for package in (protocol, emulators, hil_bridge)
        for result in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
        if not result.name.endswith("__main__")
        for name in vars(importlib.import_module(result.name))
        if re.fullmatch(r"[A-Z]\w*", name)
    }


def imported_names(text: str) -> Iterator[str]:
    """Return the names that the code on a page imports from us, except star imports."""
    for names in IMPORT.findall(text):
        yield from (name.strip() for name in names[1].split("#")[0].split(",") if name.strip() != "*")


def names_with_file(text: str) -> Iterator[str]:
    """Return the names that a page writes before their file, as in `pose` (`protocol/geometry.py`)."""
    yield from re.findall(r"`(\w+)(?:\([^`]*\))?` \(`(?:protocol|emulators|hil_bridge)/[\w/]+\.py`\)", text)


@pytest.fixture(scope="module")
def known_names() -> set[str]:
    return defined_names()


@pytest.mark.parametrize("page", PAGES)
def test_names_on_pages_are_in_the_reference(page: str, known_names: set[str]) -> None:
    text = (DOCS / page).read_text(encoding="utf-8")
    capitals = (
        {name for name in CODE.findall(text) if name in known_names} - EXAMPLE_NAMES - THIRD_PARTY_NAMES
    )
    named = capitals | set(imported_names(text)) | (set(names_with_file(text)) - EXAMPLE_NAMES)
    assert sorted(named - REFERENCE - set(api.__all__)) == []


def test_pages_contain_many_names() -> None:
    """The search finds what it should: capitalised names, imports, and functions with their file."""
    text = (DOCS / "how-to/devices.md").read_text(encoding="utf-8")
    assert {"SensorClient", "SIGNAL_FAULTS", "OwnFaults"} <= set(CODE.findall(text))
    assert "SensorEventQueue" in set(names_with_file(text))
    assert "RobotCase" in set(imported_names((DOCS / "reference/testing.md").read_text(encoding="utf-8")))


def test_names_exist_and_have_docstrings() -> None:
    for modules in GROUPS.values():
        for module, names in modules.items():
            for name in names:
                getattr(importlib.import_module(module), name)
                assert f"{module}.{name}\n" in author_names()


def test_package_page_lists_every_public_name() -> None:
    assert [name for name in api.__all__ if f"hil_bridge.{name}\n" not in package_names()] == []
