"""Dashboard server: one line for each command, and one line for each answer.

Source: ur_rtde 1.6.5, Universal Robots' C++ client library, and a user's extract of the maker's dashboard manual.
"""

from collections import deque
from collections.abc import Callable, Mapping

from emulators.devices.rtde.controller import Controller
from emulators.devices.rtde.programs import start_text
from emulators.devices.rtde.running import ProgramMessage
from emulators.devices.rtde.safety import Stimulus
from emulators.devices.rtde.urscript import Message
from emulators.orders import Act
from protocol.devices.rtde.dashboard import GREETING, Lines
from protocol.devices.rtde.states import RobotMode, Runtime

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
"""Refusal in local control. Observed by users of the ROS driver. A connection made in local control is refused even
after a change to remote control.
"""
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
    "shutdown",
)
"""Prefixes of commands that local control refuses."""
_RELEASES = ("play", "unlock protective stop", "power on", "brake release", "restart safety")
"""Commands that allow a robot to move again."""
_E_SERIES = 5
"""Major version of the first e-Series."""
_OF_E_SERIES = (
    "is in remote control",
    "get operational mode",
    "set operational mode",
    "clear operational mode",
    "version",
)
"""Commands that only an e-Series controller understands."""
_OF_CB3 = ("setuserrole", "getuserrole")
"""Commands that only a CB3 controller understands."""
_OF_THE_MAKER = ("get variable", "log")
"""Prefixes of further commands that a real dashboard understands."""
_WITHOUT_EFFECT = (
    "load installation",
    "shutdown",
    "set operational mode",
    "setuserrole",
    "generate flight report",
    "generate support file",
    "savelog",
)
"""Commands that are answered without effect."""
_ROLES = ("programmer", "operator", "none", "locked", "restricted")
_MODES = ("manual", "automatic")
ARGUMENT_MAX = 200
"""Maximum number of characters that are read of an argument. Chosen."""
_PLAYS = {Runtime.PLAYING: "PLAYING", Runtime.PAUSED: "PAUSED"}


def _unlock(controller: Controller) -> str:
    return "Protective stop releasing" if controller.state.unlock(controller.now) else _EARLY


def _restart(controller: Controller) -> str:
    controller.power_off()
    controller.state.apply(Stimulus.RESTART)
    return "Restarting safety"


def _stop(controller: Controller) -> str:
    """Stop the program. It also succeeds if none is running: ur_rtde ends its own program first, and then expects
    this answer.
    """
    controller.player.stop(controller.now)
    return "Stopped"


def _power_off(controller: Controller) -> str:
    controller.power_off()
    return "Powering off"


def _state(controller: Controller) -> str:
    player = controller.player
    name = player.program.name if player.program is not None else ""
    return f"{_PLAYS.get(player.runtime, 'STOPPED')} {player.loaded or name or '<unnamed>'}"


def _load(controller: Controller, file: str) -> str:
    name = file.rpartition("/")[2].removesuffix(".urp")
    if name not in controller.player.stored:
        return f"File not found: {file}"
    controller.player.stop(controller.now)
    controller.player.loaded = f"{name}.urp"
    return f"Loading program: {file}, {controller.player.loaded}"


def _power_on(controller: Controller) -> str:
    """Switch the power on. It also succeeds if the power is already on."""
    state = controller.state
    on = state.power_on(controller.now) or state.mode in (
        RobotMode.POWER_ON,
        RobotMode.IDLE,
        RobotMode.RUNNING,
    )
    return _done(on, "power on", "Powering on")


def _release(controller: Controller) -> str:
    """Release the brakes, powering up first. Idempotent."""
    released = controller.state.release_brakes(controller.now) or controller.state.mode == RobotMode.RUNNING
    return _done(released, "brake release", "Brake releasing")


def _close_popup(controller: Controller) -> str:
    controller.console.popup_open = False
    return "closing popup"


def _done(done: bool, command: str, answer: str) -> str:
    return answer if done else f"Failed to execute: {command}"


def _polyscope(controller: Controller) -> str:
    major, minor, bugfix, _ = controller.version
    return f"URSoftware {major}.{minor}.{bugfix}.{_BUILD}"


class Settings:
    """Settings that are shared by all connections to the dashboard."""

    def __init__(self) -> None:
        self.role, self.operational_mode = "PROGRAMMER", "NONE"
        self.reports = 0
        """Number of flight reports."""


def _set_role(controller: Controller, settings: Settings, role: str) -> str:
    if role.lower() not in _ROLES:
        return f"Failed setting user role: {role}"
    settings.role = role.upper()
    return f"Setting user role: {role}"


def _set_mode(controller: Controller, settings: Settings, mode: str) -> str:
    if mode.lower() not in _MODES:
        return f"Failed setting operational mode: {mode}"
    settings.operational_mode = mode.upper()
    return f"Operational mode {settings.operational_mode} is set"


def _report(controller: Controller, settings: Settings, kind: str) -> str:
    settings.reports += 1
    return f"Flight Report generated with id: {settings.reports}"


def _open_popup(controller: Controller, settings: Settings, text: str) -> str:
    controller.console.tell(ProgramMessage(controller.now, Message.POPUP, text))
    return "showing popup"


def _log(controller: Controller, settings: Settings, text: str) -> str:
    controller.console.tell(ProgramMessage(controller.now, Message.TEXT, text))
    return "Added log message"


_WITH_ARGUMENT: Mapping[str, Callable[[Controller, Settings, str], str]] = {
    "load installation": lambda controller, settings, name: f"Loading installation: {name}",
    "load": lambda controller, settings, name: _load(controller, name),
    "popup": _open_popup,
    "addtolog": _log,
    "setuserrole": _set_role,
    "set operational mode": _set_mode,
    "generate flight report": _report,
    "generate support file": lambda controller, settings, place: (
        f"Completed successfully: {place}/support.zip"
    ),
}
"""Commands with an argument, by prefix. A longer prefix precedes any shorter prefix that it starts with."""
_ANSWERS: Mapping[str, Callable[[Controller], str]] = {
    "polyscopeversion": _polyscope,
    "get serial number": lambda controller: controller.profile.serial_number,
    "get robot model": lambda controller: _MODELS[controller.profile.model],
    "get loaded program": lambda controller: (
        f"Loaded program: /programs/{controller.player.loaded}"
        if controller.player.loaded
        else "No program loaded"
    ),
    "is in remote control": lambda controller: str(controller.state.remote).lower(),
    "robotmode": lambda controller: f"Robotmode: {controller.state.mode.name}",
    "safetystatus": lambda controller: f"Safetystatus: {controller.state.safety.name}",
    "safetymode": lambda controller: f"Safetymode: {controller.state.safety.name}",
    "running": lambda controller: (
        f"Program running: {str(controller.player.runtime == Runtime.PLAYING).lower()}"
    ),
    "programstate": _state,
    "pause": lambda controller: _done(controller.player.pause(), "pause", "Pausing program"),
    "stop": _stop,
    "unlock protective stop": _unlock,
    "close safety popup": lambda controller: "closing safety popup",
    "close popup": _close_popup,
    "restart safety": _restart,
    "power on": _power_on,
    "power off": _power_off,
    "brake release": _release,
    "version": lambda controller: ".".join(map(str, controller.version)),
    "isprogramsaved": lambda controller: f"true {controller.player.loaded or '<unnamed>'}",
    "savelog": lambda controller: "Log saved to disk",
    "shutdown": lambda controller: "Shutting down",
}


class Dashboard:
    """Connection to the dashboard, as an endpoint of bytes. `closing` states whether it is about to be closed."""

    def __init__(self, controller: Controller, settings: Settings) -> None:
        self._controller, self._settings = controller, settings
        self._lines = Lines()
        self._out = [GREETING]
        self._local = not controller.state.remote
        """Whether the connection was made in local control."""
        self._waiting: deque[str] = deque()
        """Commands that have not been answered yet."""
        self._starts = False
        """Whether a program is being started. The answer follows when the program has been compiled."""
        self.closing = False

    def receive(self, data: bytes, now: float) -> None:
        self._controller.advance(now)
        self._waiting += self._lines.feed(data)
        self._answer_waiting()

    def _answer_waiting(self) -> None:
        while self._waiting and not self._starts and not self.closing:
            answer = self._answer(self._waiting.popleft().strip())
            if answer is not None:
                self._out.append(answer)

    def _answer(self, line: str) -> str | None:
        """Return the answer to a command; None if the answer follows later."""
        command = " ".join(line.lower().split())
        if command == "quit":
            self.closing = True
            return "Disconnected"
        if command in _RELEASES:
            self._controller.report_order(Act.RELEASE, f"dashboard: {command}", self._controller.state.remote)
        if (self._local or not self._controller.state.remote) and command.startswith(_ACTS):
            return _LOCAL
        if command == "play":
            self._play()
            return None
        cb3 = self._controller.version.major < _E_SERIES
        if not command.startswith(_OF_E_SERIES if cb3 else _OF_CB3):
            answer = self._known(command, line)
            if answer is not None:
                if tag := next(filter(command.startswith, _WITHOUT_EFFECT), ""):
                    self._controller.unmodelled.touch(f"dashboard command {tag}", "answered without effect")
                return answer
            if real := next(filter(command.startswith, _OF_THE_MAKER), ""):
                detail = "answered as not understood"
                self._controller.unmodelled.touch(f"dashboard command {real}", detail)
                self._controller.report_order(Act.REFUSED, f"dashboard command {real}", False)
        return f"could not understand: '{line[:80]}'"

    def _play(self) -> None:
        """Resume a paused program, or start the stored one. The answer follows when the program has been compiled."""
        controller, name = self._controller, self._controller.player.loaded.removesuffix(".urp")
        self._starts = True
        if controller.play():
            self._report_play(True)
        elif name and controller.player.runtime == Runtime.STOPPED and controller.state.takes_programs:
            start_text(controller, name, controller.player.stored[name], self._report_play)
        else:
            self._report_play(False)

    def _report_play(self, started: bool) -> None:
        self._starts = False
        self._out.append(_done(started, "play", "Starting program"))

    def _known(self, command: str, line: str) -> str | None:
        """Return the answer to a known command."""
        settings = self._settings
        match command:
            case "getuserrole":
                return settings.role
            case "get operational mode":
                return settings.operational_mode
            case "clear operational mode":
                settings.operational_mode = "NONE"
                return "No longer controlling the operational mode."
        if command in _ANSWERS:
            return _ANSWERS[command](self._controller)
        for begin, act in _WITH_ARGUMENT.items():
            if command == begin or command.startswith(f"{begin} "):
                argument = " ".join(line.split()[len(begin.split()) :])[:ARGUMENT_MAX]
                return act(self._controller, settings, argument)
        return None

    def next_event(self) -> None:
        return None

    def data_to_send(self, now: float) -> bytes:
        self._answer_waiting()
        out, self._out = self._out, []
        return "".join(f"{line}\n" for line in out).encode("ascii", "replace")

    def next_deadline(self) -> float | None:
        """Return the time of the next cycle while an answer is due, s."""
        path = self._controller.path
        return path.cycle_at(path.cycle + 1) if self._starts else None

    def handle_deadline(self, now: float) -> None:
        self._controller.advance(now)

    def close(self, now: float) -> None:
        """End the connection."""
