"""Requests of a client at its start, each with the answer that it waits for. The script of a start is a generator that
yields requests and receives their answers.
"""

from collections.abc import Callable, Generator
from typing import Any, NamedTuple, TypeAlias

from hil_fanuc import rmi
from hil_fanuc.channels import Channel, OpenSession, Piece
from hil_fanuc.packets import Report, ToClient, ToRobot, encode_to_robot
from protocol.endpoint import Trouble

Answer: TypeAlias = ToClient | rmi.Message | None
"""Packet of the stream, line of the Remote Motion Interface, or None after a request without an answer."""


class Failed(Exception):
    """Start that cannot continue."""

    def __init__(self, trouble: Trouble) -> None:
        super().__init__(str(trouble))
        self.trouble = trouble


class Request(NamedTuple):
    """Pieces to send, and what ends the wait."""

    pieces: tuple[Piece | OpenSession, ...]
    accepts: Callable[[Any], bool] | None
    """Whether a packet or a line is the answer; None for a request without an answer, which ends after its patience."""
    patience_s: float
    late: Trouble
    """Trouble if no answer arrives in time."""
    repeats: bool = False
    """Whether the request is sent again while no answer arrives, because a datagram can be lost."""


Script: TypeAlias = Generator[Request, Answer, None]

_NETWORK = "check its address, and whether it has the option S636"


class Requests:
    """Requests with the time limits of one client."""

    def __init__(self, answer_s: float) -> None:
        self._answer_s = answer_s

    def packet(
        self, packet: ToRobot, accepts: Callable[[Any], bool], name: str
    ) -> Generator[Request, Any, Any]:
        """Ask over Stream Motion, and return the answer."""
        piece = Piece(Channel.STREAM, encode_to_robot(packet))
        late = Trouble(
            f"it does not answer the {name} over Stream Motion",
            f"{_NETWORK}; if it answered before, switch it off and on",
        )
        answer = yield Request((piece,), accepts, self._answer_s, late, repeats=True)
        return answer

    def send(self, packet: ToRobot, pause_s: float) -> Generator[Request, Any, None]:
        """Send a packet without an answer, then pause."""
        piece = Piece(Channel.STREAM, encode_to_robot(packet))
        yield Request((piece,), None, pause_s, Trouble())

    def line(
        self,
        message: rmi.Message,
        channel: Channel = Channel.SESSION,
        first: tuple[OpenSession, ...] = (),
        late: Trouble | None = None,
    ) -> Generator[Request, Any, rmi.Message]:
        """Ask over the Remote Motion Interface, and return the answer, whatever its ErrorID. `first` opens the
        channel.
        """
        key, name = rmi.name_of(message)
        piece = Piece(channel, rmi.encode(message))
        late = late or Trouble(f"it does not answer {name}", _NETWORK)

        def accepts(answer: Any) -> bool:
            return isinstance(answer, dict) and answer.get(key) == name

        answer: rmi.Message = yield Request((*first, piece), accepts, 3.0 * self._answer_s, late)
        return answer

    def done(self, message: rmi.Message, remedy: str) -> Generator[Request, Any, rmi.Message]:
        """Ask over the Remote Motion Interface. Raises Failed for an answer with an error."""
        answer = yield from self.line(message)
        if number := error_of(answer):
            raise Failed(
                Trouble(f"it refuses {rmi.name_of(message).name}: {rmi.describe_error(number)}", remedy)
            )
        return answer


def error_of(answer: rmi.Message) -> int:
    """Return the ErrorID of an answer; 0 for none."""
    number = answer.get("ErrorID")
    return number if isinstance(number, int) else 0


def number_of(answer: rmi.Message, key: str) -> int:
    """Return a number of an answer. Raises Failed if it is missing."""
    number = answer.get(key)
    if not isinstance(number, int):
        raise Failed(Trouble(f"its answer to {rmi.name_of(answer).name} has no {key}", "update its software"))
    return number


def is_ready(answer: Any) -> bool:
    """Return whether an answer is a report of a controller that is ready for commands."""
    return isinstance(answer, Report) and bool(answer.status & 1)
