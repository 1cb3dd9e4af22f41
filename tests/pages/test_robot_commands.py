"""The table of commands by robot: all were run, and the page tells their ends."""

import json

from hil_bridge.devices.kinds import ROBOTS
from tools.documents import DOCS
from tools.robot_commands import COMMANDS, renewed

ROWS = json.loads((DOCS / "reference" / "robot-commands.json").read_text(encoding="utf-8"))
TEXT = (DOCS / "reference" / "commands.md").read_text(encoding="utf-8")


def test_every_command_was_run_with_every_robot_of_ours() -> None:
    ran = [(row["robot"], row["command"]) for row in ROWS]
    assert ran == [(kind, name) for kind in ROBOTS.own for name in COMMANDS]


def test_the_page_tells_these_ends() -> None:
    assert renewed(TEXT, ROWS) == TEXT


def test_a_command_that_fails_is_told_with_its_reason() -> None:
    failed = [{**ROWS[0], "code": 3, "error": "the cable"}, *ROWS[1:]]
    assert "| exit code 3: the cable |" in renewed(TEXT, failed)
