"""Tests that text made for an operator is never parsed: code that needs a part of it reads a field."""

from pathlib import Path

import pytest

from tools.own_texts import parsed_texts, places

ROOT = Path(__file__).resolve().parents[2]
ALLOWED = {
    ("hil_bridge/record/records.py", "self.text.strip().partition('\\n')"),  # the first line, for a view
    (
        "hil_bridge/transports/can/message.py",
        "str(error).startswith(('Transmit buffer full', 'Could not send message",
    ),
    (
        "hil_bridge/transports/reasons.py",
        "str(error).split()",
    ),  # from the operating system, joined into one line
    ("hil_bridge/transports/urls.py", "self.text.partition('?')"),  # a URL, as an operator wrote it
}
"""Third-party texts, and lines of a text. An expression is given by its start."""


def test_no_own_text_is_parsed() -> None:
    left = dict.fromkeys(ALLOWED, False)
    for file, expression in parsed_texts(ROOT):
        known = [place for place in ALLOWED if place[0] == file and expression.startswith(place[1])]
        assert known, f"{file}: {expression} parses a part of a text; add a field for it"
        left[known[0]] = True
    assert all(left.values()), "an allowed expression no longer exists"


@pytest.mark.parametrize(
    "line",
    [
        "number, _, rest = str(error).partition(': ')",
        "rest = str(error).removeprefix('configuration: ')",
        "if 'swings' in reason.text: pass",
        "if 'swings' not in str(error): pass",
        "found = PATTERN.search(event.text.lower())",
        "found = re.match('the (.*)', stop.cause)",
        "short = span.label.split(' (')[0]",
    ],
)
def test_each_parsing_method_is_detected(line: str) -> None:
    module = f"try:\n    act()\nexcept ValueError as error:\n    {line}\n"
    assert len(list(places(module))) == 1


def test_displayed_text_is_not_reported() -> None:
    module = "def show(event):\n    print(event.text, len(event.text), event.kind.split('-'), f'{event.label}: x')\n"
    assert not list(places(module))
