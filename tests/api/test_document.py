"""The examples of docs/reference/api.md."""

import re
from pathlib import Path

import pytest

from hil_bridge import api

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "reference" / "api.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"^## (.+?)$.*?^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


@pytest.mark.full
@pytest.mark.parametrize(("title", "code"), EXAMPLES, ids=[title for title, _ in EXAMPLES])
def test_example_runs(title: str, code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An example with an exception fails the test; it has its own asserts."""
    monkeypatch.chdir(tmp_path)
    exec(compile(code, f"docs/reference/api.md, {title}", "exec"), {"__name__": "example"})


def test_api_document_covers_every_name() -> None:
    assert len(EXAMPLES) == PAGE.count("```python") >= 8
    families = {"Configuration"}  # an alias for annotations
    names = set(re.findall(r"\b\w+\b", PAGE))
    assert set(api.__all__) - families <= names
