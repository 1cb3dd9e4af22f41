"""Result of a command in this process, and the arguments of a virtual run; the fixture `hil` runs commands."""

from collections.abc import Callable
from typing import TypeAlias

Result: TypeAlias = tuple[int, str, str]
Command: TypeAlias = Callable[..., Result]

VIRTUAL = ("run", "--virtual", "--no-view")


def refused(result: Result) -> str:
    """Return the single line of a refusal."""
    code, _, errors = result
    assert code == 2, errors
    assert errors.startswith("hil-bridge: ")
    assert errors.count("\n") == 1
    return errors
