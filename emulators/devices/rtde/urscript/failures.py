"""The errors of a program: values that a controller reports, and the exception that carries one."""

from typing import NamedTuple


class SyntaxFailure(NamedTuple):
    """The text does not compile."""

    line: int
    """1 is the first one."""
    column: int
    text: str
    function: str = ""
    """Name of the function that is called and is not known."""


class RuntimeFailure(NamedTuple):
    """A statement cannot be done; the program ends."""

    line: int
    text: str
    column: int = 1


class ScriptSyntaxError(Exception):
    """The text does not compile: nothing of it is run."""

    def __init__(self, failure: SyntaxFailure) -> None:
        super().__init__(failure.text)
        self.failure = failure


class ScriptError(Exception):
    """A statement cannot be done. The statement that was under way adds its line."""

    def __init__(self, text: str, column: int = 1) -> None:
        super().__init__(text)
        self.text, self.column = text, column
        self.line = 0
        """0 until the statement is known."""


class Halted(Exception):
    """The program has ended itself."""
