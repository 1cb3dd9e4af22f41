"""The script port: text that may hold programs, in any pieces.

Rule, laxer than the script manual because ur_rtde's text breaks it: a program begins at a line `def name(` or
`sec name(`, and ends at the first later line that is exactly `end`.
"""

import re

from emulators.devices.rtde.controller import Controller
from emulators.devices.rtde.programs import intent, is_known, program, tag_calls
from emulators.orders import Act

_BEGIN = re.compile(rb"^(def|sec)\s+(\w{1,64})\s*\(")
TEXT_MAX = 1 << 20
"""Chosen: a longer program is thrown away; ur_rtde's has 50 kB."""


class ScriptPort:
    """One connection to the script port: an endpoint of bytes that says nothing."""

    closing = False

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._rest = b""
        self._lines: list[bytes] = []
        self._size = 0
        self._name = ""
        self._secondary = False

    def receive(self, data: bytes, now: float) -> None:
        self._controller.advance(now)
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            self._take(line.rstrip(b"\r"))
        if len(self._rest) > TEXT_MAX:
            self._rest = b""

    def _take(self, line: bytes) -> None:
        if not self._name:
            if begin := _BEGIN.match(line):
                self._secondary = begin[1] == b"sec"
                self._name, self._lines, self._size = begin[2].decode(), [line], len(line)
            return
        self._lines.append(line)
        self._size += len(line)
        if self._size > TEXT_MAX:
            self._name, self._lines = "", []
        elif line == b"end":
            controller, text = self._controller, b"\n".join(self._lines)
            if self._secondary:  # runs beside a program and cannot move the arm
                controller.counts["secondary programs"] += 1
                tag_calls(controller, text)
            else:
                known = is_known(self._name)
                controller.told(Act.PROGRAM, f"program {self._name}", controller.takes_programs, not known)
                controller.intent = intent(controller, self._name, text)
                controller.start_program(program(controller, self._name, text))
            self._name, self._lines = "", []

    def next_event(self) -> None:
        return None

    def data_to_send(self, now: float) -> bytes:
        return b""

    def next_deadline(self) -> float | None:
        return None

    def handle_deadline(self, now: float) -> None:
        """There is none."""

    def close(self, now: float) -> None:
        """The connection has ended."""
