"""Tests that the page on URScript matches the interpreter."""

import runpy
from pathlib import Path
from typing import Any

import pytest

from emulators.devices.rtde.urscript import FUNCTIONS

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "reference" / "urscript.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def tool() -> dict[str, Any]:
    return runpy.run_path(str(ROOT / "tools" / "urscript_doc.py"))


def test_each_function_is_in_table_once() -> None:
    table = PAGE.partition("<!-- functions: begin -->")[2]
    for name in FUNCTIONS:
        assert table.count(f"`{name}(") == 1, name
