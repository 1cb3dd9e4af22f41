"""Lines of the Remote Motion Interface: JSON objects, each ended by CR LF.

Sources: FANUC-CORPORATION/fanuc_driver, fanuc_libs/rmi (names of the fields, error numbers), and observations in
airo-ugent/airo-fanuc.
"""

import json
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple, TypeAlias

from protocol.endpoint import RemoteProtocolError

PORT = 16001
"""TCP port of the first door. It names the port of the session."""
SESSION_PORT = 16002
"""Port of the session that was observed."""
STREAM_PROGRAM = "STREAM_MOTN"
"""TP program that begins and ends the streaming."""
LINE_MAX = 4096
"""Largest length of a line, bytes. Chosen."""
END = b"\r\n"
CONNECT = "FRC_Connect_STMO"
"""Request at the first door. Derived from the maker's client, and observed; FRC_Connect is that of R912 alone."""

Message: TypeAlias = dict[str, Any]

SERVO_OFF, NOT_RUNNING, NOT_PAUSED, CANNOT_RESUME, CANNOT_RESET = 2556935, 2556937, 2556938, 2556939, 2556940
BAD_COMMAND, BAD_STATE, BAD_INSTRUCTION, HELD, PEER_GONE = 2556941, 2556943, 2556948, 2556952, 2556953
CANNOT_EXECUTE, ALREADY_CONNECTED, NOT_READY, BAD_SEQUENCE = 2556934, 2556954, 2556955, 2556957
BAD_VALUE, BAD_PROGRAM, BAD_POSITION_REGISTER = 2556949, 2556981, 2556932
ERRORS: Mapping[int, str] = {
    BAD_POSITION_REGISTER: "the position register is invalid",
    CANNOT_EXECUTE: "the TP program cannot be executed",
    SERVO_OFF: "the servo is off",
    2556936: "the TP program cannot be executed",
    NOT_RUNNING: "the Remote Motion Interface is not running",
    NOT_PAUSED: "the TP program is not paused",
    CANNOT_RESUME: "the TP program cannot be resumed",
    CANNOT_RESET: "the controller cannot be reset",
    BAD_COMMAND: "the command is invalid",
    2556942: "the command has failed",
    BAD_STATE: "the state of the controller does not allow it",
    2556944: "the controller must be switched off and on",
    BAD_INSTRUCTION: "the instruction is invalid",
    BAD_VALUE: "a value is invalid",
    HELD: "the Remote Motion Interface is held",
    PEER_GONE: "the remote device has disconnected",
    ALREADY_CONNECTED: "another client is connected",
    NOT_READY: "the controller is not ready",
    2556956: "an instruction is not done",
    BAD_SEQUENCE: "the sequence number is invalid",
    2556967: "the group number is invalid",
    2556968: "the group mask is invalid",
    2556971: "the robot is in single-step mode",
    BAD_PROGRAM: "there is no TP program with this name",
}
"""Meaning of the error numbers that a client of Stream Motion meets."""


class ProgramStatus:
    """Values of ProgramStatus."""

    RUNNING = 0
    CANCELLED = 1
    HELD = 2


def describe_error(number: int) -> str:
    """Return the meaning of an error number."""
    return f"{ERRORS.get(number, 'an error')} ({number})"


def encode(message: Mapping[str, Any]) -> bytes:
    """Encode a line."""
    return json.dumps(message, separators=(",", ":")).encode() + END


class Name(NamedTuple):
    """Key and name of a message."""

    key: str
    """`Command`, `Communication` or `Instruction`."""
    name: str


def name_of(message: Mapping[str, Any]) -> Name:
    """Return the key and the name of a message; empty if it has none."""
    for key in ("Command", "Communication", "Instruction"):
        if isinstance(name := message.get(key), str):
            return Name(key, name)
    return Name("", "")


class LineReader:
    """Reader of lines from a stream that may be split at any byte."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> Iterator[Message]:
        """Yield the messages that are complete. Raises RemoteProtocolError for the first line that is not a JSON
        object, or that is too long; the lines after it are kept.
        """
        self._buffer += data
        while (end := self._buffer.find(b"\n")) >= 0:
            line = bytes(self._buffer[:end]).strip()
            del self._buffer[: end + 1]
            if line:
                yield _parse(line)
        if len(self._buffer) > LINE_MAX:
            self._buffer.clear()
            raise RemoteProtocolError(f"a line of more than {LINE_MAX} bytes")


def _parse(line: bytes) -> Message:
    try:
        message = json.loads(line)
    except ValueError as error:
        raise RemoteProtocolError(f"a line that is not JSON: {line[:40]!r}") from error
    if not isinstance(message, dict):
        raise RemoteProtocolError(f"a line that is not a JSON object: {line[:40]!r}")
    return message
