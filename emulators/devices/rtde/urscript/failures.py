"""Errors of a program: values that a controller reports, and the exceptions that carry them."""

from typing import NamedTuple


class SyntaxFailure(NamedTuple):
    """Error of a program that does not compile."""

    line: int
    """Line number, starting at 1."""
    column: int
    text: str
    function: str = ""
    """Name of the unknown function that was called; empty for other errors."""


class RuntimeFailure(NamedTuple):
    """Error of a statement that cannot be executed; it ends the program."""

    line: int
    text: str
    column: int = 1


class ScriptSyntaxError(Exception):
    """Error of a program that does not compile. No part of the program is executed."""

    def __init__(self, failure: SyntaxFailure) -> None:
        super().__init__(failure.text)
        self.failure = failure


class ScriptError(Exception):
    """Error of a statement that cannot be executed. The statement adds its line number."""

    def __init__(self, text: str, column: int = 1) -> None:
        super().__init__(text)
        self.text, self.column = text, column
        self.line = 0
        """Line number; 0 while it is unknown."""


class Halted(Exception):
    """Raised by a program that ends itself."""
