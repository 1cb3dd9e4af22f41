"""Tables and pictures of the documents are up to date with the code and the stored figures."""

import pytest

from tools.documents import DOCUMENTS, contents
from tools.pages import placed

pytestmark = pytest.mark.sweep


@pytest.mark.parametrize("name", DOCUMENTS)
def test_document_is_up_to_date(name: str) -> None:
    stale = [path.name for path, text in contents(name) if path.read_text(encoding="utf-8") != text]
    assert not stale, f"run python -m tools.documents {name}"


def test_table_without_placeholder_is_refused() -> None:
    page = "before\n<!-- one: begin -->\nold\n<!-- one: end -->\nafter\n"
    assert placed(page, {"one": "new"}) == page.replace("old", "new")
    for text in (page.replace("one: begin", "two: begin"), page.replace("one: end", "two: end")):
        with pytest.raises(ValueError, match="no marks for 'one'"):
            placed(text, {"one": "new"})
