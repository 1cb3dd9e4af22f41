"""A text that was made for people is never taken apart: what needs a part of it reads a field."""

from pathlib import Path

import pytest

from tools.own_texts import places, taken_apart

ROOT = Path(__file__).resolve().parents[2]
ALLOWED = {
    ("hil_bridge/record/records.py", "self.text.strip().partition('\\n')"),  # the first line, for a view
    (
        "hil_bridge/transports/can/message.py",
        "str(error).startswith(('Transmit buffer full', 'Could not send message",
    ),
    ("hil_bridge/transports/reasons.py", "str(error).split()"),  # of the operating system, put into one line
    ("hil_bridge/transports/urls.py", "self.text.partition('?')"),  # a URL, as an operator wrote it
}
"""Texts of others, and lines of a text. An expression is given by its begin."""


def test_no_text_of_ours_is_taken_apart() -> None:
    left = dict.fromkeys(ALLOWED, False)
    for file, expression in taken_apart(ROOT):
        known = [place for place in ALLOWED if place[0] == file and expression.startswith(place[1])]
        assert known, f"{file}: {expression} reads a part of a text; give it a field"
        left[known[0]] = True
    assert all(left.values()), "a place that is allowed is not there any more"


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
def test_each_way_to_take_a_text_apart_is_seen(line: str) -> None:
    module = f"try:\n    act()\nexcept ValueError as error:\n    {line}\n"
    assert len(list(places(module))) == 1


def test_a_text_that_is_only_shown_is_no_such_place() -> None:
    module = "def show(event):\n    print(event.text, len(event.text), event.kind.split('-'), f'{event.label}: x')\n"
    assert not list(places(module))
