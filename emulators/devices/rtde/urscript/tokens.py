"""Tokenizer: it converts a text to words, numbers, strings and signs, and drops line ends that do not end a
statement.

A line end is a token only where a statement may be complete: not inside brackets, and not after an operator, a
comma or a colon.
"""

import re
from collections.abc import Iterator
from typing import Final, TypeAlias

from emulators.devices.rtde.urscript.failures import ScriptSyntaxError, SyntaxFailure
from emulators.devices.rtde.urscript.limits import DEPTH_MAX, TEXT_MAX, TOKENS_MAX

Token: TypeAlias = tuple[str, str, int, int]
"""Kind, text, line and column. The kind of a keyword or a bracket is its text."""
NAME: Final = "name"
NUMBER: Final = "number"
STRING: Final = "string"
COMPARE: Final = "compare"
SIGN: Final = "+-"
TIMES: Final = "*/%"
OR: Final = "or"
SCOPE: Final = "scope"
CRITICAL: Final = "critical"
NEWLINE: Final = "newline"
END: Final = "end of the text"
UNKNOWN: Final = "unknown"
"""Kind of a character that cannot begin a token."""

_TOKEN = re.compile(
    r"""[ \t\f]*(?:\#[^\n]*)?
    (?:([^\W\d]\w*)
    |((?:\r?\n[ \t]*)+)
    |(0[xX][0-9a-fA-F]+|(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)
    |("[^"\n]*"|'[^'\n]*')
    |([=!<>]=|.)
    |$)""",
    re.VERBOSE,
)
_WORD, _LINE_END, _NUMBER, _STRING = 1, 2, 3, 4
_WORDS = {
    **{
        word: word
        for word in ("def", "thread", "sec", "if", "elif", "else", "while", "end", "and", "not", "run")
    },
    **{
        word: word
        for word in ("join", "kill", "return", "break", "continue", "halt", "True", "False", "None")
    },
    **dict.fromkeys(("or", "xor"), OR),
    **dict.fromkeys(("local", "global"), SCOPE),
    **dict.fromkeys(("enter_critical", "exit_critical"), CRITICAL),
}
_SIGNS = {
    **{sign: sign for sign in "()[],.:=$"},
    **dict.fromkeys(("==", "!=", "<=", ">=", "<", ">"), COMPARE),
    **dict.fromkeys("+-", SIGN),
    **dict.fromkeys("*/%", TIMES),
}
_NESTS = {"(": (1, 0), "[": (1, 0), ")": (-1, 0), "]": (-1, 0), "end": (0, -1)} | dict.fromkeys(
    ("def", "thread", "sec", "if", "while"), (0, 1)
)
"""Changes that each token makes to the numbers of open brackets and open blocks."""
_CONTINUES = frozenset({OR, "and", "not", COMPARE, SIGN, TIMES, "=", ",", ":"})
"""Tokens after which a statement continues on the next line."""


def tokens_of(text: str) -> Iterator[Token]:
    """Yield the tokens of a text, then `END` repeatedly. Raises ScriptSyntaxError for a text beyond the limits."""
    if len(text) > TEXT_MAX:
        raise ScriptSyntaxError(SyntaxFailure(1, 1, "the program is too long"))
    brackets = blocks = line_begin = 0
    complete, line, token = False, 1, (END, "", 1, 1)
    for count, match in enumerate(_TOKEN.finditer(text)):
        group = match.lastindex
        if group is None:
            break
        word, at = match[group], match.start(group)
        column = at - line_begin + 1
        if count > TOKENS_MAX:
            raise ScriptSyntaxError(SyntaxFailure(line, column, "the program is too long"))
        if group == _LINE_END:
            if complete and not brackets:
                complete, token = False, (NEWLINE, word, line, column)
                yield token
            line, line_begin = line + word.count("\n"), at + word.rindex("\n") + 1
            continue
        if group == _WORD:  # a member may be called `sec`
            kind = NAME if token[0] == "." else _WORDS.get(word, NAME)
        elif group == _NUMBER:
            kind = NUMBER
        else:
            kind = STRING if group == _STRING else _SIGNS.get(word, UNKNOWN)
        if kind in _NESTS:
            opened, nested = _NESTS[kind]
            brackets, blocks = max(brackets + opened, 0), max(blocks + nested, 0)
            if brackets + blocks > DEPTH_MAX:
                raise ScriptSyntaxError(SyntaxFailure(line, column, "the program is nested too deeply"))
        complete, token = kind not in _CONTINUES, (kind, word, line, column)
        yield token
    while True:
        yield END, "", token[2], token[3]
