"""Panel of an emulated Universal Robot: its buttons, and the state displayed on its pendant."""

import math
from collections.abc import Callable, Mapping
from typing import Any

from emulators.devices.rtde.controller import Controller
from emulators.devices.rtde.faults import RTDE_FAULTS
from emulators.devices.rtde.robot import RtdeRobot
from emulators.devices.rtde.safety import Stimulus
from emulators.panel import Controls, Dial, Move, Switch, millimetres, motion_text, numbers_text
from protocol.devices.rtde.states import SafetyMode

_OPERATOR = "an operator"
_RUNTIME_AT = {
    "playing": "play",
    "resuming": "play",
    "pausing": "pause",
    "paused": "pause",
    "stopped": "stop",
}
"""Position of the program control for each state of the program."""


def _act(act: Callable[[Controller], object]) -> Move:
    """Return the action, delayed until the controller has reached the time."""

    def move(robot: RtdeRobot, now: float) -> object:
        robot.controller.advance(now)
        return act(robot.controller)

    return move


def _give_control(remote: bool) -> Move:
    def give(controller: Controller) -> None:
        controller.state.remote = remote

    return _act(give)


def _unlock(controller: Controller) -> None:
    if controller.state.unlock(controller.now):
        return
    if controller.state.safety != SafetyMode.PROTECTIVE_STOP:
        raise ValueError("there is no protective stop")
    raise ValueError(
        f"the controller refuses to unlock a protective stop earlier than {controller.profile.unlock_s:g} s after it"
    )


def _close_popup(controller: Controller) -> None:
    controller.console.popup_open = False


def _slide(robot: RtdeRobot, percent: float, now: float) -> None:
    robot.controller.advance(now)
    robot.controller.io.slider = percent / 100.0


_CONTROLS: Mapping[str, Switch | Dial] = {
    "emergency-stop": Switch(
        "Press the emergency stop, or release it.",
        {
            "press": _act(lambda controller: controller.emergency_stop(by=_OPERATOR)),
            "release": _act(lambda controller: controller.state.release_emergency_stop(_OPERATOR)),
        },
        "press",
        lambda state: "press" if state["safety"] == "robot emergency stop" else "release",
    ),
    "safeguard": Switch(
        "Open a safeguard, or close it.",
        {
            "open": _act(lambda controller: controller.open_safeguard()),
            "close": _act(lambda controller: controller.state.apply(Stimulus.SAFEGUARD_CLOSED)),
        },
        at=lambda state: "open" if state["safety"] == "safeguard stop" else "close",
    ),
    "protective-stop": Switch("Unlock a protective stop.", {"unlock": _act(_unlock)}, "unlock"),
    "control": Switch(
        "Switch between remote and local control.",
        {"remote": _give_control(True), "local": _give_control(False)},
        at=lambda state: str(state["control"]),
    ),
    "power": Switch(
        "Switch the arm's power.",
        {
            "on": _act(lambda controller: controller.state.power_on(controller.now)),
            "off": _act(Controller.power_off),
        },
        at=lambda state: "off" if state["mode"] == "power off" else "on",
    ),
    "brakes": Switch(
        "Release the brakes.",
        {"release": _act(lambda controller: controller.state.release_brakes(controller.now))},
        "release",
    ),
    "program": Switch(
        "Resume, pause or stop the program.",
        {
            "play": _act(Controller.play),
            "pause": _act(lambda controller: controller.player.pause()),
            "stop": _act(lambda controller: controller.player.stop(controller.now)),
        },
        at=lambda state: _RUNTIME_AT.get(state["runtime"], ""),
    ),
    "popup": Switch("Close a pop-up.", {"close": _act(_close_popup)}, "close"),
    "speed": Dial(
        "Move the speed slider.", _slide, 0.0, 100.0, "%", lambda state: float(state["speed_percent"])
    ),
}


def _words(member: Any) -> str:
    return str(member.name).lower().replace("_", " ")


def _state(robot: RtdeRobot, now: float) -> dict[str, Any]:
    controller = robot.controller
    controller.advance(now)
    snapshot = controller.snapshots[-1]
    hindrance = controller.state.hindrance(now)
    program = controller.player.program
    return {
        "mode": _words(controller.state.mode),
        "safety": _words(controller.state.safety),
        "hindrance": "" if hindrance is None else hindrance.words,
        "control": "remote" if controller.state.remote else "local",
        "program": "" if program is None else program.name,
        "runtime": _words(controller.player.runtime),
        "speed_percent": round(100.0 * controller.io.slider, 1),
        "position_mm": millimetres(snapshot.pose.position),
        "true_position_mm": millimetres(snapshot.now.position),
        "joints_deg": tuple(round(math.degrees(joint), 3) for joint in snapshot.joints),
        "force_n": tuple(round(part, 3) for part in snapshot.force[:3]),
        "counts": dict(controller.counts),
    }


def _rows(state: Mapping[str, Any]) -> dict[str, str]:
    return {
        "mode": f"{state['mode']}, {state['control']} control",
        "safety": state["safety"],
        "motion": motion_text(state["hindrance"]),
        "program": f"{state['runtime']} {state['program']}".rstrip(),
        "speed slider": f"{state['speed_percent']:g} %",
        "position": f"{numbers_text(state['position_mm'])} mm reported",
        "": f"{numbers_text(state['true_position_mm'])} mm true",
        "joints": f"{numbers_text(state['joints_deg'])} °",
        "force": f"{numbers_text(state['force_n'])} N",
        "counts": ", ".join(f"{name} {count}" for name, count in state["counts"].items()) or "none",
    }


RTDE_CONTROLS = Controls(_CONTROLS, _state, _rows, RTDE_FAULTS)
