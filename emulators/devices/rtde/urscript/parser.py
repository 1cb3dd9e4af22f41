"""The parser: text → tree, by the grammar in `urscript.lark`. An error is a value with line and column."""

from collections.abc import Iterator
from functools import lru_cache
from typing import Any

from lark import Lark, Token, Tree
from lark.exceptions import UnexpectedCharacters, UnexpectedInput, UnexpectedToken

from emulators.devices.rtde.urscript.failures import ScriptSyntaxError, SyntaxFailure
from emulators.devices.rtde.urscript.limits import DEPTH_MAX, TEXT_MAX, TOKENS_MAX

_OPENS = frozenset({"LPAR", "LSQB"})
_CLOSES = frozenset({"RPAR", "RSQB"})
_BLOCKS = frozenset({"DEF", "THREAD", "SEC", "IF", "WHILE"})
_GOES_ON = frozenset({"OR", "AND", "NOT", "COMPARE", "SIGN", "TIMES", "EQUAL", "COMMA", "COLON"})
"""Tokens behind which a statement goes on in the next line."""


class _LineEnds:
    """Takes away line ends that end no statement, and bounds nesting and length."""

    always_accept = ()

    def process(self, stream: Iterator[Token]) -> Iterator[Token]:
        brackets, blocks, complete, before = 0, 0, False, ""
        for number, token in enumerate(stream):
            if number > TOKENS_MAX:
                raise ScriptSyntaxError(_failure(token, "the program is too long"))
            kind = "NAME" if before == "DOT" else token.type  # a member may be called `sec`
            if kind == "_NL":
                if brackets or not complete:
                    continue
                complete = False
                yield token
                continue
            if kind in _OPENS:
                brackets += 1
            elif kind in _CLOSES:
                brackets = max(brackets - 1, 0)
            elif kind in _BLOCKS:
                blocks += 1
            elif kind == "END":
                blocks = max(blocks - 1, 0)
            if brackets + blocks > DEPTH_MAX:
                raise ScriptSyntaxError(_failure(token, "the program is nested too deeply"))
            complete = kind not in _GOES_ON
            yield token if kind == token.type else Token.new_borrow_pos(kind, token, token)
            before = kind


@lru_cache(maxsize=1)
def make_parser() -> Lark:
    """Made once, which takes some tenths of a second: at the first text, or before where no time may be lost then."""
    return Lark.open(
        "urscript.lark",
        rel_to=__file__,
        parser="lalr",
        lexer="basic",
        postlex=_LineEnds(),
        maybe_placeholders=False,
    )


def parse(text: str) -> Tree[Token]:
    """The tree of a text. Raises ScriptSyntaxError for one that is no program."""
    if len(text) > TEXT_MAX:
        raise ScriptSyntaxError(SyntaxFailure(1, 1, "the program is too long"))
    try:
        return make_parser().parse(text)
    except UnexpectedToken as error:
        raise ScriptSyntaxError(_failure(error.token, _unexpected(error.token))) from None
    except UnexpectedCharacters as error:
        failure = SyntaxFailure(error.line, error.column, f"unexpected character {error.char!r}")
        raise ScriptSyntaxError(failure) from None
    except UnexpectedInput as error:
        raise ScriptSyntaxError(SyntaxFailure(error.line, error.column, "unexpected text")) from None


def _unexpected(token: Token) -> str:
    return (
        "the program is not complete" if token.type == "$END" else f"unexpected {str(token)[:40].strip()!r}"
    )


def _failure(token: Any, text: str) -> SyntaxFailure:
    return SyntaxFailure(token.line or 1, token.column or 1, text)
