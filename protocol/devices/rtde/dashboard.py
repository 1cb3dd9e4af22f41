"""Lines of the dashboard server: a command, and one line for an answer.

Source: ur_rtde 1.6.5, `dashboard_client.cpp`; Universal Robots' C++ client library,
`dashboard_client_implementation_g5.cpp`.
"""

from collections import deque
from collections.abc import Mapping

from protocol.endpoint import NO_TROUBLE, Trouble

GREETING = "Connected: Universal Robots Dashboard Server"
LINE_MAX = 1024
"""Chosen: a longer line is none of a dashboard."""

REMOTE, MODE, SAFETY = "is in remote control", "robotmode", "safetystatus"
QUESTIONS = (REMOTE, SAFETY, MODE)
"""Asked by our client before it uploads a program. Safety comes before the mode: an emergency stop takes the power too,
and powering on is no remedy of it.
"""
_READY: Mapping[str, tuple[str, str]] = {
    MODE: ("Robotmode: RUNNING", "power it on and release its brakes"),
    SAFETY: ("Safetystatus: NORMAL", "see the stop's cause, release it, and begin again"),
}


def find_refusal(question: str, answer: str) -> Trouble:
    """Trouble for an answer that forbids a program to start.

    A CB3 has no remote control and does not understand the question.
    """
    if question == REMOTE:
        local = answer.strip().lower() == "false"
        return (
            Trouble("it is in local control", "switch it to Remote Control at the pendant")
            if local
            else NO_TROUBLE
        )
    ready, remedy = _READY[question]
    if answer.strip().lower() == ready.lower():
        return NO_TROUBLE
    return Trouble(f"its dashboard says {answer.strip()[:80]!r}", remedy)


class Lines:
    """Cuts bytes into lines. A line that is too long is given in pieces."""

    def __init__(self) -> None:
        self._rest = bytearray()

    def feed(self, data: bytes) -> list[str]:
        """Return the lines completed by these bytes, without their ends."""
        self._rest += data
        *lines, rest = bytes(self._rest).split(b"\n")
        if len(rest) > LINE_MAX:
            lines, rest = [*lines, rest[:LINE_MAX]], b""
        self._rest = bytearray(rest)
        return [line.decode("ascii", "replace").replace("�", "?").rstrip("\r") for line in lines]


class Questioning:
    """The questions of our client, one after the other, behind the greeting."""

    def __init__(self) -> None:
        self.feed = Lines().feed
        self._questions = deque(QUESTIONS)
        self._greeted = False

    @property
    def question(self) -> str:
        """The next question; empty behind the last answer."""
        return self._questions[0] if self._questions else ""

    def take(self, line: str) -> Trouble:
        """Trouble for a line that forbids a program to start, or that no dashboard says."""
        if self._greeted:
            return find_refusal(self._questions.popleft(), line)
        self._greeted = True
        if line.startswith(GREETING.partition(":")[0]):
            return NO_TROUBLE
        return Trouble("no dashboard answers on its port", "look at the port, or set dashboard_port to 0")
