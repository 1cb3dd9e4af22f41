"""Parser: it converts a text to a tree for each function, with the names that the function uses.

Source: Universal Robots' script manual, and published programs. Statements are parsed by recursive descent,
expressions by operator precedence. An error is a value with line and column.
"""

from collections.abc import Callable, Generator, Mapping
from typing import TypeAlias, TypeVar

from emulators.devices.rtde.urscript.failures import ScriptSyntaxError, SyntaxFailure
from emulators.devices.rtde.urscript.names import SIGNALS, Code, Node, assigned
from emulators.devices.rtde.urscript.tokens import (
    COMPARE,
    CRITICAL,
    END,
    NAME,
    NEWLINE,
    NUMBER,
    OR,
    SCOPE,
    SIGN,
    STRING,
    TIMES,
    UNKNOWN,
    Token,
    tokens_of,
)

Steps: TypeAlias = Generator[None, None, Node]
"""Parser of a statement that contains other statements. It yields after each of them."""
_POWERS = {OR: 1, "and": 2, COMPARE: 3, SIGN: 4, TIMES: 5}
_CHAINS = ("", "disjunction", "conjunction", "comparison", "sum", "product")
_BLOCK_ENDS = frozenset({"end", "elif", "else", END})
_LITERALS = {NUMBER: "number", STRING: "string", "True": "true", "False": "false", "None": "none"}
_VALUES = frozenset({*_LITERALS, NAME, "(", "[", "run"})
"""Kinds of tokens that can begin a value, except signs."""
_TRAILERS = ("[", ".")
Item = TypeVar("Item")


def parse(text: str) -> Generator[None, None, Code]:
    """Parse the functions of a program, one statement per step. Raises ScriptSyntaxError for an invalid program."""
    parser = _Parser(text)
    root = parser.code
    root.body = yield from parser.block()
    parser.expect(END)
    return root


class _Parser:
    """Recursive-descent parser, with a method for each construct."""

    def __init__(self, text: str) -> None:
        self._tokens = tokens_of(text)
        self.code = Code("", None)
        """Code of the function that is being parsed."""
        self._token: Token = next(self._tokens)
        self._kind = self._token[0]
        self._compound: Mapping[str, Callable[[], Steps]] = {
            **dict.fromkeys(("def", "thread", "sec"), self._definition),
            "if": self._if,
            "while": self._while,
        }
        self._simple: Mapping[str, Callable[[], Node]] = {
            **dict.fromkeys(_VALUES, self._assignment),
            **dict.fromkeys(("break", "continue", "halt", CRITICAL), self._word),
            **dict.fromkeys(("join", "kill"), self._order),
            "return": self._return,
            SCOPE: self._declaration,
            "$": self._label,
        }

    def _advance(self) -> Token:
        """Advance to the next token. Return the previous token."""
        before = self._token
        self._token = token = next(self._tokens)
        self._kind = token[0]
        return before

    def expect(self, kind: str) -> Token:
        """Consume a token of this kind. Raises ScriptSyntaxError for any other."""
        if self._kind != kind:
            raise self._unexpected()
        return self._advance()

    def _unexpected(self) -> ScriptSyntaxError:
        kind, text, line, column = self._token
        if kind == UNKNOWN:
            problem = f"unexpected character {text!r}"
        else:
            problem = "the program is not complete" if kind == END else f"unexpected {text[:40].strip()!r}"
        return ScriptSyntaxError(SyntaxFailure(line, column, problem))

    def _node(self, kind: str, token: Token, *children: object) -> Node:
        self.code.weight += 1
        return Node(kind, token, [*children])

    # --- statements

    def block(self) -> Steps:
        """Parse statements up to the end of the enclosing block."""
        node = self._node("block", self._token)
        while self._kind not in _BLOCK_ENDS:
            if compound := self._compound.get(self._kind):
                node.children.append((yield from compound()))
            elif simple := self._simple.get(self._kind):
                node.children.append(simple())
            else:
                raise self._unexpected()
            if self._kind == NEWLINE:
                self._advance()
            yield
        return node

    def _definition(self) -> Steps:
        word, token, outer = self._advance()[1], self.expect(NAME), self.code
        node = self._node(word, token, token[1])
        self.code = code = Code(token[1], outer)
        self.expect("(")
        self._list(self._parameter, ")")
        self.expect(":")
        code.calls, code.weight = set(), 1  # the calls and steps of the defaults do not count for the body
        code.body = yield from self.block()
        self.expect("end")
        self.code, outer.functions[code.name] = outer, code
        return node

    def _parameter(self) -> None:
        name, code = self.expect(NAME)[1], self.code
        code.parameters.append(name)
        code.slot(name)
        if self._kind == "=":
            self._advance()
            code.default_nodes[name] = self._value()

    def _if(self) -> Steps:
        node = self._node("if", self._token)
        while self._kind in ("if", "elif"):
            self._advance()
            node.children.append(self._value())
            self.expect(":")
            node.children.append((yield from self.block()))
        if self._kind == "else":
            self._advance()
            self.expect(":")
            self.code.weight += 1
            node.children.append((yield from self.block()))
        self.expect("end")
        return node

    def _while(self) -> Steps:
        before = self.code.weight
        node = self._node("while", self._advance(), self._value())
        self.expect(":")
        node.children.append((yield from self.block()))
        self.expect("end")
        node.children.append(self.code.weight - before)
        return node

    def _assignment(self) -> Node:
        """Parse an assignment, or an expression as a statement."""
        place = self._place()
        if self._kind != "=":
            return self._node("expression", place.token, place)
        self._advance()
        name = assigned(place)
        if name is not None and (place.kind == "name" or name not in SIGNALS):
            self.code.assigned[name] = None
        return self._node("assign", place.token, place, self._value())

    def _declaration(self) -> Node:
        scope, name = self._advance(), self.expect(NAME)[1]
        if scope[1] == "global":
            self.code.root.slot(name)
            self.code.globals.add(name)
        else:
            self.code.slot(name)
        node = self._node("declare", scope, name)
        if self._kind == "=":
            self._advance()
            node.children.append(self._value())
        return node

    def _word(self) -> Node:
        """Parse a one-word statement."""
        token = self._advance()
        return self._node(token[0], token)

    def _order(self) -> Node:
        """Parse a statement that controls a thread."""
        token = self._advance()
        self.code.waits = self.code.waits or token[1] == "join"
        return self._node(token[1], token, self._value())

    def _return(self) -> Node:
        node = self._node("return", self._advance())
        if self._kind in _VALUES or self._kind in (SIGN, "not"):
            node.children.append(self._value())
        return node

    def _label(self) -> Node:
        node = self._node("label", self._advance(), self.expect(NUMBER)[1])
        while self._kind == STRING:
            self._advance()
        return node

    # --- expressions

    def _value(self, limit: int = 0) -> Node:
        """Parse a value. It ends before an operator that does not bind more strongly than `limit`."""
        node = self._negation() if self._kind == "not" and limit < _POWERS[COMPARE] else self._unary()
        while (power := _POWERS.get(self._kind, 0)) > limit:
            node = self._node(_CHAINS[power], node.token, node)
            while _POWERS.get(self._kind) == power:
                node.children += self._advance()[1], self._value(power)
        return node

    def _negation(self) -> Node:
        signs = []
        while self._kind == "not":
            signs.append(self._advance())
        node = self._value(_POWERS["and"])
        for token in reversed(signs):
            node = self._node("not", token, node)
        return node

    def _unary(self) -> Node:
        signs = []
        while self._kind == SIGN:
            signs.append(self._advance())
        if self._kind not in _VALUES:
            raise self._unexpected()
        node = self._place()
        for token in reversed(signs):
            node = self._node("sign", token, token[1], node)
        return node

    def _place(self) -> Node:
        """Parse an atom and its suffixes: elements, members, method calls."""
        node = self._atom()
        if self._kind not in _TRAILERS:
            return node
        node = self._node("place", node.token, node)
        while self._kind in _TRAILERS:
            if self._advance()[0] == "[":
                trailer = self._node("index", self._token)
                if self._kind == "]":
                    raise self._unexpected()
                trailer.children += self._list(self._value, "]")
            else:
                token = self.expect(NAME)
                trailer = self._node("member", token, token[1])
                if self._kind == "(":
                    trailer.kind = "method"
                    trailer.children.append(self._arguments())
            node.children.append(trailer)
        return node

    def _atom(self) -> Node:
        token = self._advance()
        kind, text = token[:2]
        if kind == NAME:
            if self._kind != "(":
                return self._node("name", token, text)
            self.code.calls.add(text)
            return self._node("call", token, text, self._arguments())
        if kind == "(":
            node = self._value()
            self.expect(")")
            return node
        if kind == "run":
            token = self.expect(NAME)
            return self._node("run", token, token[1], self._arguments())
        if kind != "[":
            return self._node(_LITERALS[kind], token, text)
        node = self._node("list", token)
        while self._kind != "]":  # a comma may follow the last item
            node.children.append(self._value())
            if self._kind != "]":
                self.expect(",")
        self._advance()
        return node

    def _arguments(self) -> list[Node]:
        self.expect("(")
        self.code.weight += 1
        return self._list(self._argument, ")")

    def _argument(self) -> Node:
        may_be_named = self._kind == NAME
        node = self._value()
        if self._kind == "=" and may_be_named and node.kind == "name":
            self._advance()
            node.kind = "named"
            node.children.append(self._value())
        return node

    def _list(self, item: Callable[[], Item], end: str) -> list[Item]:
        """Parse comma-separated items and the closing token."""
        items = []
        if self._kind != end:
            items.append(item())
            while self._kind == ",":
                self._advance()
                items.append(item())
        self.expect(end)
        return items
