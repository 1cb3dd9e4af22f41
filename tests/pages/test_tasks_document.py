"""The page on programs matches the code: tables, examples and printed file."""

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


def test_setting_without_description_is_detected(tool: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"no description of press.for_s"):
        tool["section_table"]("press", Hold)


def test_every_example_has_picture_and_link() -> None:
    for path in (ROOT / "examples" / "tasks").glob("*.toml"):
        assert f"../examples/tasks/{path.name}" in PAGE
        assert f"/task-{path.stem}.png)" in PAGE
        assert (ROOT / "docs" / "pictures" / f"task-{path.stem}.png").stat().st_size < 100_000


def test_programs_on_page_are_valid(tmp_path: Path) -> None:
    result = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    assert len(result) == 2
    for text in result:
        path = tmp_path / "program.toml"
        path.write_text(text)
        overrides = {"task.file": str(path)} if is_program(parse_toml(text, "page")) else {}
        assert load_config(None if overrides else path, overrides).task.step
