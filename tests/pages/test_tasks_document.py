"""The page on programs says what the code has: its tables, its examples, and a file as it prints it."""

import re
import runpy
from pathlib import Path
from typing import Any

import pytest

from hil_bridge.control.steps.hold import Hold
from hil_bridge.errors.text_files import parse_toml
from hil_bridge.settings.configuration import load_config
from hil_bridge.settings.program import is_program

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "reference" / "tasks.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def tool() -> dict[str, Any]:
    return runpy.run_path(str(ROOT / "tools" / "tasks_doc.py"))


def test_a_setting_without_a_meaning_is_missed(tool: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"cannot tell what press.for_s means"):
        tool["section_table"]("press", Hold)


def test_every_example_has_its_picture_and_its_link() -> None:
    for path in (ROOT / "examples" / "tasks").glob("*.toml"):
        assert f"../examples/tasks/{path.name}" in PAGE
        assert f"/task-{path.stem}.png)" in PAGE
        assert (ROOT / "docs" / "pictures" / f"task-{path.stem}.png").stat().st_size < 100_000


def test_the_programs_on_the_page_can_be(tmp_path: Path) -> None:
    found = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    assert len(found) == 2
    for text in found:
        path = tmp_path / "program.toml"
        path.write_text(text)
        overrides = {"task.file": str(path)} if is_program(parse_toml(text, "page")) else {}
        assert load_config(None if overrides else path, overrides).task.step
