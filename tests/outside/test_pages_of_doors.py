"""Tests that the code on the pages for authors is taken from the examples unchanged."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FILES = [*(ROOT / "examples").glob("*/**/*.py"), *(ROOT / "examples").glob("*/pyproject.toml")]
PAGES = {
    name: (ROOT / "docs" / "how-to" / f"{name}.md").read_text(encoding="utf-8")
    for name in ("controllers", "devices", "steps", "surfaces")
}
CODE = [
    (page, number, block)
    for page, text in PAGES.items()
    for number, (kind, block) in enumerate(re.findall(r"^```(python|toml)\n(.*?)^```", text, re.MULTILINE | re.DOTALL))
    if kind == "python" or block.startswith("[project")
]  # fmt: skip


@pytest.mark.parametrize(
    ("page", "number", "block"), CODE, ids=[f"{page}-{number}" for page, number, _ in CODE]
)
def test_code_block_is_part_of_example(page: str, number: int, block: str) -> None:
    assert any(block.strip("\n") in path.read_text(encoding="utf-8") for path in FILES), block


def test_each_page_has_code_and_names_examples() -> None:
    assert {page for page, _, _ in CODE} == set(PAGES)
    named = {name for text in PAGES.values() for name in re.findall(r"`examples/([a-z-]+)`", text)}
    packages = {path.parent.name for path in FILES if path.name == "pyproject.toml"}
    assert named == packages - {"paper-experiments"}  # repeats the paper, and shows no extension point
