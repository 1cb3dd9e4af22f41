"""Commands of a client one after the other, each with its answer and its time limit.

A script yields each command as an `Ask`, and receives the reply. Nothing is sent before the reply to the command before
has arrived, as the maker's client does it.
"""

import math
from collections.abc import Generator
from dataclasses import dataclass
from typing import Any, TypeAlias

from hil_xarm.codes import error_text
from hil_xarm.frames import ALL_JOINTS, PRIVATE, Bit, Function, Mode, Reply, Request, State, next_transaction
from hil_xarm.reports import Port
from protocol import pieces
from protocol.endpoint import Trouble

Piece: TypeAlias = pieces.Piece[Port, bytes]
VERSION_TRIES, VERSION_PAUSE_S = 100, 0.1
"""Number of requests of the version, and the time between them, s. Source: the maker's client."""


@dataclass(frozen=True, slots=True)
class Ask:
    """Command of a script."""

    function: Function
    data: bytes = b""


@dataclass(frozen=True, slots=True)
class Wait:
    """Pause of a script."""

    seconds: float


Script: TypeAlias = Generator[Ask | Wait, Reply | None, None]


class Failed(Exception):
    """A script cannot continue."""

    def __init__(self, trouble: Trouble) -> None:
        super().__init__(trouble.fact)
        self.trouble = trouble


class Dialogue:
    """Command channel of a client: at most one command waits for its reply."""

    def __init__(self, answer_s: float, keep_alive_s: float) -> None:
        self._answer_s, self._keep_alive_s = answer_s, keep_alive_s
        self._transaction = 0
        self._function: int | None = None
        """Function of the command whose reply is awaited."""
        self._late_at = self._idle_at = math.inf

    @property
    def is_free(self) -> bool:
        """Whether no reply is awaited."""
        return self._function is None

    @property
    def due(self) -> float:
        """Time of the next event, s."""
        return self._late_at if self._function is not None else self._idle_at

    def ask(self, function: Function, data: bytes, now: float) -> Piece:
        """Return a command to send."""
        self._transaction = next_transaction(self._transaction)
        self._function, self._late_at = function, now + self._answer_s
        return pieces.Piece(Port.COMMAND, Request(self._transaction, PRIVATE, function, data).encode())

    def is_reply(self, reply: Reply, now: float) -> bool:
        """Return whether this is the reply that is awaited. Any other one is skipped, as by the maker's client."""
        if self._function is None or (reply.transaction, reply.function) != (
            self._transaction,
            self._function,
        ):
            return False
        self._function, self._late_at, self._idle_at = None, math.inf, now + self._keep_alive_s
        return True

    def end(self) -> None:
        """Await nothing any more."""
        self._function, self._late_at, self._idle_at = None, math.inf, math.inf

    def late(self, now: float) -> Trouble | None:
        """Return the trouble with a command whose reply is late."""
        if self._function is None or now < self._late_at:
            return None
        name = Function(self._function).label
        return Trouble(
            f"it does not answer the command {name} within {self._answer_s:g} s",
            "check its cable and whether it is overloaded, then start again",
        )


def ask_version(facts: dict[str, Any]) -> Script:
    """Ask for the version until it can be read, and note it in the facts."""
    for _ in range(VERSION_TRIES):
        reply = yield Ask(Function.VERSION)
        assert reply is not None, "a command has a reply"
        text = reply.data.partition(b"\0")[0].decode("ascii", "replace")
        parts = text.split(",")
        if len(parts) >= 5 and parts[0].isdigit() and parts[1].isdigit():
            facts["robot"] = f"UFACTORY, {parts[0]} axes, type {parts[1]}"
            facts["serial"], facts["firmware"] = parts[2], parts[4]
            return
        yield Wait(VERSION_PAUSE_S)
    raise Failed(Trouble("its version cannot be read", "check whether the address is that of a control box"))


def ask_error() -> Generator[Ask | Wait, Reply | None, int]:
    """Return the error of the box."""
    reply = yield Ask(Function.ERROR)
    assert reply is not None, "a command has a reply"
    return reply.data[0] if reply.data else 0


def prepare(clears_error: bool) -> Script:
    """Enable the motors, set servo mode, and set the state to move. Raises Failed for an error that remains."""
    error = yield from ask_error()
    if error and clears_error:
        yield Ask(Function.CLEAR_ERROR)
        yield Ask(Function.CLEAR_WARNING)
        error = yield from ask_error()
    if error:
        raise Failed(error_trouble(error))
    yield Ask(Function.ENABLE, bytes((ALL_JOINTS, 1)))
    yield Ask(Function.SET_MODE, bytes((Mode.SERVO,)))
    reply = yield Ask(Function.SET_STATE, bytes((State.MOVE,)))
    assert reply is not None, "a command has a reply"
    if reply.state & Bit.ERROR:
        raise Failed(error_trouble((yield from ask_error())))


def error_trouble(error: int) -> Trouble:
    """Return the trouble of a box that is stopped by an error."""
    return Trouble(
        f"it reports {error_text(error)}",
        "correct its cause, then start the run again: the client clears the error",
    )
