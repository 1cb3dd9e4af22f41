"""Script port: program text, received in pieces of any size.

A program begins at a line `def name(` or `sec name(`. If all further lines are indented, as the script manual
requires, it ends at the first `end` in column 1. A text with other lines in column 1 ends where its blocks are
closed. Any other line is a program of one statement. Comments and numbers may begin in column 1, as in the text of
ur_rtde.
"""

import re
from collections.abc import Callable, Mapping

from emulators.devices.rtde.controller import Controller
from emulators.devices.rtde.programs import run_secondary, start_text
from emulators.devices.rtde.urscript.limits import TEXT_MAX
from emulators.devices.rtde.urscript.table import E_SERIES
from emulators.orders import Act

_BEGIN = re.compile(rb"^(def|sec)\s+(\w{1,64})\s*\(")
_NESTS = re.compile(rb"^\s*(?:(end)|def|sec|thread|if|while)\b")
"""Lines that begin or end a block."""
_FREE = re.compile(rb"^[A-Za-z_]")


def _unlock(controller: Controller) -> None:
    """Unlock a protective stop. No effect if it is too early.

    Derived: if the order has no effect, the C++ client library's examples send it again after 5 s.
    """
    if not controller.state.unlock(controller.now):
        controller.counts["unlock refused"] += 1


def _simulate(controller: Controller) -> None:
    controller.unmodelled.touch("line set sim", "accepted without effect: the arm keeps moving")


_ORDERS: Mapping[bytes, tuple[Act, Callable[[Controller], object]]] = {
    b"stop program": (Act.CONTACT, lambda controller: controller.player.stop(controller.now)),
    b"pause program": (Act.CONTACT, lambda controller: controller.player.pause()),
    b"resume program": (Act.PROGRAM, Controller.play),
    b"power on": (Act.RELEASE, lambda controller: controller.state.power_on(controller.now)),
    b"power off": (Act.CONTACT, Controller.power_off),
    b"set robotmode run": (Act.RELEASE, lambda controller: controller.state.release_brakes(controller.now)),
    b"set unlock protective stop": (Act.RELEASE, _unlock),
}
"""Lines that clients send to the script ports although they are not script."""
_ORDERS_OF_CB3: Mapping[bytes, tuple[Act, Callable[[Controller], object]]] = {
    **_ORDERS,
    b"set sim": (Act.CONTACT, _simulate),
    b"set real": (Act.CONTACT, lambda controller: None),
}
"""Lines of this kind that only a CB3 accepts. Source: python-urx 0.11.0, `set_simulation`. Assumed: an e-Series
rejects them.
"""
_PROGRAMS_MAX = 16
"""Maximum number of programs that a connection delivers at one time. Further programs are dropped, because each
takes time to compile. Chosen.
"""


class ScriptPort:
    """Connection to the script port, as an endpoint of bytes that sends nothing."""

    closing = False

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._rest = b""
        self._at, self._count, self._text = -1.0, 0, 0
        """Time of the newest program, number of programs at that time, and number of their characters."""
        self._forget()

    def _forget(self) -> None:
        """Discard the lines that precede a program."""
        self._lines: list[bytes] = []
        self._size = self._depth = 0
        self._name = ""
        self._secondary = self._free = False

    def receive(self, data: bytes, now: float) -> None:
        self._controller.advance(now)
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            self._take(line.rstrip(b"\r"))
        if len(self._rest) > TEXT_MAX:
            self._rest = b""

    def _take(self, line: bytes) -> None:
        if not self._name:
            begin = _BEGIN.match(line)
            if begin is None:
                self._take_statement(line.strip())
                return
            self._secondary, self._name = begin[1] == b"sec", begin[2].decode()
        elif _FREE.match(line) and line != b"end":
            self._free = True
        self._lines.append(line)
        self._size += len(line) + 1
        ends = False
        if nests := _NESTS.match(line):
            ends = nests[1] is not None
            self._depth += -1 if ends else 1
        if self._size > TEXT_MAX:
            self._forget()
        elif (ends and self._depth <= 0) or (line == b"end" and not self._free):
            name, text, secondary = self._name, b"\n".join(self._lines), self._secondary
            self._forget()
            self._start(name, text, secondary)

    def _take_statement(self, line: bytes) -> None:
        """Accept a program of one statement. Refuse it if it is invalid."""
        if not line or line.startswith(b"#"):
            return
        controller = self._controller
        orders = _ORDERS if controller.version.major >= E_SERIES else _ORDERS_OF_CB3
        if known := orders.get(line.lower()):
            if controller.state.remote:
                act, order = known
                controller.report_order(act, line.decode(), True)
                order(controller)
            return
        self._start("", line)

    def _start(self, name: str, text: bytes, secondary: bool = False) -> None:
        controller = self._controller
        if self._at != controller.now:
            self._at, self._count, self._text = controller.now, 0, 0
        self._count += 1
        self._text += len(text)
        if self._count > _PROGRAMS_MAX or self._text > TEXT_MAX or controller.player.uploads.full:
            controller.counts["programs dropped"] += 1
            return
        if secondary:
            run_secondary(controller, text)
            return
        start_text(controller, name, text)

    def next_event(self) -> None:
        return None

    def data_to_send(self, now: float) -> bytes:
        return b""

    def next_deadline(self) -> float | None:
        return None

    def handle_deadline(self, now: float) -> None:
        """Do nothing: there is no deadline."""

    def close(self, now: float) -> None:
        """End the connection."""
