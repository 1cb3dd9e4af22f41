"""Generated reference pages are complete."""

import ast
from pathlib import Path

from hil_bridge.settings.template import commented_defaults, setting_rows

PACKAGE = Path(__file__).resolve().parents[2] / "hil_bridge"
ANALYSIS = PACKAGE / "record" / "analysis"
"""Module that creates events for internal use, and records none."""
NOTICE_FUNCTIONS = ("notice", "_event", "_on_notice", "on_notice", "tell", "event")
"""Names of functions whose first argument is a kind."""


def event_kinds(text: str) -> set[str]:
    """Return the kinds of events that a module contains as plain text."""
    result = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            argument_index = {"EventRecord": 1, **dict.fromkeys(NOTICE_FUNCTIONS, 0)}.get(name)
            if (
                argument_index is not None
                and len(node.args) > argument_index
                and isinstance(node.args[argument_index], ast.Constant)
            ):
                result.add(str(node.args[argument_index].value))  # type: ignore[attr-defined]
    return result


def test_no_event_kind_is_plain_text() -> None:
    modules = (path for path in PACKAGE.rglob("*.py") if not path.is_relative_to(ANALYSIS))
    assert {path: kinds for path in modules if (kinds := event_kinds(path.read_text(encoding="utf-8")))} == {}


def test_every_configuration_setting_is_in_the_table() -> None:
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
