"""Every name of ours that a page tells an author to use stands in the reference of names."""

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
"""Pages that tell authors which names to use."""
OF_THE_EXAMPLE = {"Reader", "ROBOT", "SENSOR", "SURFACE"}
"""Names of an author's own package, which one of ours has too."""
OF_OTHERS = {"NamedTuple", "Struct"}
"""Names of other libraries."""
CODE = re.compile(r"`([A-Za-z_]\w*)(?:\.\w+)*(?:\([^`]*\))?`")
IMPORT = re.compile(r"^from ((?:hil_bridge|emulators|protocol)[\w.]*) import (.+)$", re.MULTILINE)
REFERENCE = {name for modules in GROUPS.values() for names in modules.values() for name in names}


def defined_names() -> set[str]:
    """Names with a capital of all modules of ours."""
    return {
        name
        for package in (protocol, emulators, hil_bridge)
        for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
        if not found.name.endswith("__main__")
        for name in vars(importlib.import_module(found.name))
        if re.fullmatch(r"[A-Z]\w*", name)
    }


def imported(text: str) -> Iterator[str]:
    """Names that the code of a page imports from us, a star aside."""
    for names in IMPORT.findall(text):
        yield from (name.strip() for name in names[1].split("#")[0].split(",") if name.strip() != "*")


def with_their_file(text: str) -> Iterator[str]:
    """Names that a page writes before their file, as in `pose` (`protocol/geometry.py`)."""
    yield from re.findall(r"`(\w+)(?:\([^`]*\))?` \(`(?:protocol|emulators|hil_bridge)/[\w/]+\.py`\)", text)


@pytest.fixture(scope="module")
def ours() -> set[str]:
    return defined_names()


@pytest.mark.parametrize("page", PAGES)
def test_each_name_of_a_page_is_in_the_reference(page: str, ours: set[str]) -> None:
    text = (DOCS / page).read_text(encoding="utf-8")
    capitals = {name for name in CODE.findall(text) if name in ours} - OF_THE_EXAMPLE - OF_OTHERS
    named = capitals | set(imported(text)) | (set(with_their_file(text)) - OF_THE_EXAMPLE)
    assert sorted(named - REFERENCE - set(api.__all__)) == []


def test_the_pages_name_many() -> None:
    """The search itself finds what it should: names with capitals, imports, and functions with their file."""
    text = (DOCS / "how-to/devices.md").read_text(encoding="utf-8")
    assert {"SensorClient", "SIGNAL_FAULTS", "OwnFaults"} <= set(CODE.findall(text))
    assert "SensorEventQueue" in set(with_their_file(text))
    assert "RobotCase" in set(imported((DOCS / "reference/testing.md").read_text(encoding="utf-8")))


def test_each_name_is_there_and_has_words() -> None:
    for modules in GROUPS.values():
        for module, names in modules.items():
            for name in names:
                getattr(importlib.import_module(module), name)
                assert f"{module}.{name}\n" in author_names()


def test_the_package_page_has_every_public_name() -> None:
    assert [name for name in api.__all__ if f"hil_bridge.{name}\n" not in package_names()] == []
