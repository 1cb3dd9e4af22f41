"""Text protocol of the dashboard server: one line per command and one line per response.

Source: ur_rtde 1.6.5, `dashboard_client.cpp`; Universal Robots' C++ client library,
`dashboard_client_implementation_g5.cpp`.
"""

from collections import deque
from collections.abc import Mapping

from protocol.endpoint import NO_TROUBLE, Trouble

GREETING = "Connected: Universal Robots Dashboard Server"
LINE_MAX = 1024
"""Maximum number of bytes in a line. Chosen: a longer line does not come from a dashboard server."""

REMOTE, MODE, SAFETY = "is in remote control", "robotmode", "safetystatus"
QUESTIONS = (REMOTE, SAFETY, MODE)
"""Requests that the client sends before it uploads a program, in order. The safety status comes before the robot
mode: an emergency stop also removes power, and powering on would not clear it.
"""
_READY: Mapping[str, tuple[str, str]] = {
    MODE: ("Robotmode: RUNNING", "power it on and release its brakes"),
    SAFETY: ("Safetystatus: NORMAL", "find the cause of the stop, release it, and start again"),
}


def find_refusal(question: str, answer: str) -> Trouble:
    """Return the trouble if a response prevents the start of a program.

    A CB3 has no remote control and does not know the command that asks for it.
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
    """Splitter of bytes into lines. A line that is too long is returned in pieces."""

    def __init__(self) -> None:
        self._rest = bytearray()

    def feed(self, data: bytes) -> list[str]:
        """Process received bytes and return the lines that they complete, without their line ends."""
        self._rest += data
        *lines, rest = bytes(self._rest).split(b"\n")
        if len(rest) > LINE_MAX:
            lines, rest = [*lines, rest[:LINE_MAX]], b""
        self._rest = bytearray(rest)
        return [line.decode("ascii", "replace").replace("�", "?").rstrip("\r") for line in lines]


class Questioning:
    """Sequence of the client's requests, which are sent one after the other after the server's welcome line."""

    def __init__(self) -> None:
        self.feed = Lines().feed
        self._questions = deque(QUESTIONS)
        self._greeted = False

    @property
    def question(self) -> str:
        """Next request to send; empty after the last response."""
        return self._questions[0] if self._questions else ""

    def take(self, line: str) -> Trouble:
        """Process a line. Return the trouble if the line prevents the start of a program or does not come from a
        dashboard server.
        """
        if self._greeted:
            return find_refusal(self._questions.popleft(), line)
        self._greeted = True
        if line.startswith(GREETING.partition(":")[0]):
            return NO_TROUBLE
        return Trouble("no dashboard server on its port", "check the port, or set dashboard_port to 0")
