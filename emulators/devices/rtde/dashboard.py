"""The dashboard server: commands in lines, one line for an answer.

Source: ur_rtde 1.6.5, Universal Robots' C++ client library, and a user's extract of the maker's dashboard manual.
"""

from collections.abc import Callable, Mapping

from emulators.devices.rtde.controller import Controller
from emulators.orders import Act
from protocol.devices.rtde.dashboard import GREETING, Lines
from protocol.devices.rtde.states import Runtime, SafetyMode

_MODELS = {"ur5e": "UR5", "ur10e": "UR10", "ur5": "UR5", "ur10": "UR10"}
_EARLY = (
    "Cannot unlock protective stop until 5s after occurrence. "
    "Always inspect cause of protective stop before unlocking"
)
_BUILD = "1101319 (Feb 02 2022)"
_LOCAL = (
    "Command is not allowed due to safety reasons, "
    "please switch robot to Remote Control mode and reconnect to port 29999"
)
"""Observed by users of the ROS driver. A connection that was made in local control is refused later too."""
_ACTS = (
    "play",
    "pause",
    "stop",
    "unlock protective stop",
    "power on",
    "power off",
    "brake release",
    "restart safety",
    "load",
)
"""Begins of commands that local control refuses."""
_RELEASES = ("play", "unlock protective stop", "power on", "brake release", "restart safety")
"""Commands that let a robot move again."""
_E_SERIES = 5
"""Major version of the first e-Series."""
_OF_E_SERIES = ("is in remote control",)
"""Commands that a CB3 does not understand: it has no remote control."""
_OF_THE_MAKER = (
    "load",
    "shutdown",
    "addtolog",
    "log",
    "version",
    "isprogramsaved",
    "setuserrole",
    "getuserrole",
    "set operational mode",
    "get operational mode",
    "clear operational mode",
    "load installation",
    "get variable",
    "generate flight report",
    "generate support file",
    "savelog",
)
"""Begins of commands that a real dashboard understands beside those that are answered here."""
_PLAYS = {Runtime.PLAYING: "PLAYING", Runtime.PAUSED: "PAUSED"}


def _unlock(controller: Controller) -> str:
    return "Protective stop releasing" if controller.unlock_protective_stop() else _EARLY


def _restart(controller: Controller) -> str:
    controller.power_off()
    if controller.safety in (SafetyMode.VIOLATION, SafetyMode.FAULT):
        controller.safety = SafetyMode.NORMAL
    return "Restarting safety"


def _stop(controller: Controller) -> str:
    """Also without a program: ur_rtde ends its own one first, and then expects this answer."""
    controller.stop_program()
    return "Stopped"


def _power_off(controller: Controller) -> str:
    controller.power_off()
    return "Powering off"


def _state(controller: Controller) -> str:
    name = controller.program.name if controller.program is not None else "<unnamed>"
    return f"{_PLAYS.get(controller.runtime, 'STOPPED')} {name}"


def _done(done: bool, command: str, answer: str) -> str:
    return answer if done else f"Failed to execute: {command}"


def _polyscope(controller: Controller) -> str:
    major, minor, bugfix, _ = controller.version
    return f"URSoftware {major}.{minor}.{bugfix}.{_BUILD}"


_ANSWERS: Mapping[str, Callable[[Controller], str]] = {
    "polyscopeversion": _polyscope,
    "get serial number": lambda controller: controller.profile.serial_number,
    "get robot model": lambda controller: _MODELS[controller.profile.model],
    "get loaded program": lambda controller: "No program loaded",
    "is in remote control": lambda controller: str(controller.remote).lower(),
    "robotmode": lambda controller: f"Robotmode: {controller.mode.name}",
    "safetystatus": lambda controller: f"Safetystatus: {controller.safety.name}",
    "safetymode": lambda controller: f"Safetymode: {controller.safety.name}",
    "running": lambda controller: f"Program running: {str(controller.runtime == Runtime.PLAYING).lower()}",
    "programstate": _state,
    "play": lambda controller: _done(controller.play(), "play", "Starting program"),
    "pause": lambda controller: _done(controller.pause(), "pause", "Pausing program"),
    "stop": _stop,
    "unlock protective stop": _unlock,
    "close safety popup": lambda controller: "closing safety popup",
    "close popup": lambda controller: "closing popup",
    "restart safety": _restart,
    "power on": lambda controller: _done(controller.power_on(), "power on", "Powering on"),
    "power off": _power_off,
    "brake release": lambda controller: _done(
        controller.release_brakes(), "brake release", "Brake releasing"
    ),
}


class Dashboard:
    """One connection to the dashboard: an endpoint of bytes. `closing` tells that it is to be closed."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._lines = Lines()
        self._out = [GREETING]
        self._local = not controller.remote
        """The connection was made in local control."""
        self.closing = False

    def receive(self, data: bytes, now: float) -> None:
        self._controller.advance(now)
        for line in self._lines.feed(data):
            if self.closing:
                return
            self._out.append(self._answer(line.strip()))

    def _answer(self, line: str) -> str:
        command = " ".join(line.lower().split())
        if command == "quit":
            self.closing = True
            return "Disconnected"
        if command.startswith("popup "):
            return "showing popup"
        if command in _RELEASES:
            self._controller.told(Act.RELEASE, f"dashboard: {command}", self._controller.remote)
        if (self._local or not self._controller.remote) and command.startswith(_ACTS):
            return _LOCAL
        cb3 = self._controller.version.major < _E_SERIES
        answer = None if cb3 and command in _OF_E_SERIES else _ANSWERS.get(command)
        if answer is None and (real := next(filter(command.startswith, _OF_THE_MAKER), "")):
            self._controller.unmodelled.touch(
                f"dashboard command {real}", "answered as one that is not understood"
            )
        return f"could not understand: '{line[:80]}'" if answer is None else answer(self._controller)

    def next_event(self) -> None:
        return None

    def data_to_send(self, now: float) -> bytes:
        out, self._out = self._out, []
        return "".join(f"{line}\n" for line in out).encode("ascii", "replace")

    def next_deadline(self) -> float | None:
        return None

    def handle_deadline(self, now: float) -> None:
        """There is none."""

    def close(self, now: float) -> None:
        """The connection has ended."""
