"""The pages that the site makes from the code have all that they are to have."""

import ast
from pathlib import Path

from hil_bridge.settings.template import commented_defaults, setting_rows

PACKAGE = Path(__file__).resolve().parents[2] / "hil_bridge"
ANALYSIS = PACKAGE / "record" / "analysis"
"""It makes events for its own use, and records none."""
TOLD_BY = ("notice", "_event", "_on_notice", "on_notice", "tell", "event")
"""Names of functions whose first argument is a kind."""


def kinds_in(text: str) -> set[str]:
    """Kinds of events that stand in a module as plain text."""
    found = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            place = {"EventRecord": 1, **dict.fromkeys(TOLD_BY, 0)}.get(name)
            if place is not None and len(node.args) > place and isinstance(node.args[place], ast.Constant):
                found.add(str(node.args[place].value))  # type: ignore[attr-defined]
    return found


def test_no_kind_of_event_is_plain_text() -> None:
    modules = (path for path in PACKAGE.rglob("*.py") if not path.is_relative_to(ANALYSIS))
    assert {path: kinds for path in modules if (kinds := kinds_in(path.read_text(encoding="utf-8")))} == {}


def test_every_setting_of_a_configuration_file_is_in_the_table() -> None:
    keys = {f"{row.section}.{row.name}".lstrip(".") for row in setting_rows()}
    section = ""
    for line in commented_defaults().splitlines():
        text = line.lstrip("#").strip() if line.startswith("#") and not line.startswith("# ") else line
        if text.startswith("[") and not text.startswith("[["):
            section = text.strip("[]")
        elif " = " in text and not text.startswith("#"):
            assert f"{section}.{text.partition(' = ')[0]}" in keys
    assert {row.meaning for row in setting_rows()} >= {"Seed of every random draw in the emulated cell."}
    assert all(row.type for row in setting_rows())
