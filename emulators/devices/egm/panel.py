"""Panel of an emulated controller with EGM: its buttons, its key, and the state displayed on its pendant."""

import math
from collections.abc import Mapping
from typing import Any

from emulators.devices.egm import operation
from emulators.devices.egm.controller import EgmController
from emulators.devices.egm.faults import EGM_FAULTS
from emulators.devices.egm.state import EMERGENCY_STOP, POWERLESS, Key
from emulators.panel import Controls, Dial, Move, Switch, millimetres, motion_text, numbers_text

_KEY_TEXTS = {Key.AUTO: "auto", Key.MANUAL: "manual", Key.MANUAL_FULL_SPEED: "full-speed"}
"""Texts for the key's positions."""


def _turn(key: Key) -> Move:
    return lambda robot, now: operation.turn_key(robot, key, now)


def _start(robot: EgmController, now: float) -> None:
    """Start RAPID. No effect if it is running."""
    if not operation.runs(robot):
        operation.start_program(robot, now)


_CONTROLS: Mapping[str, Switch | Dial] = {
    "emergency-stop": Switch(
        "Press the emergency stop, or release it. It switches the motors off and stops RAPID.",
        {"press": operation.press_emergency_stop, "release": operation.release_emergency_stop},
        "press",
        lambda state: "press" if EMERGENCY_STOP in state["stops"] else "release",
    ),
    "key": Switch(
        "Turn the key: automatic, manual at reduced speed, or manual at full speed. It switches the motors off.",
        {words: _turn(key) for key, words in _KEY_TEXTS.items()},
        at=lambda state: str(state["key"]),
    ),
    "motors": Switch(
        "Switch the motors; off stops RAPID too.",
        {"on": operation.switch_motors_on, "off": operation.switch_motors_off},
        at=lambda state: str(state["motors"]),
    ),
    "program": Switch(
        "Start RAPID where it was stopped, stop it, or start it from its first line.",
        {"start": _start, "stop": operation.stop_program, "restart": operation.restart_program},
        at=lambda state: "start" if state["rapid"] == "running" else "stop",
    ),
    "speed": Dial(
        "Set the speed ratio of programmed paths. It does not affect guidance by poses or joints.",
        lambda robot, percent, now: operation.set_speed(robot, percent),
        0.0,
        100.0,
        "%",
        lambda state: float(state["speed_percent"]),
    ),
}


def _state(robot: EgmController, now: float) -> dict[str, Any]:
    guidance = robot.session.state.value[1]
    hindrance = robot.hindrance(now)
    pose, joints = robot.reporter.measured
    return {
        "key": _KEY_TEXTS[robot.desk.key],
        "motors": "off" if set(POWERLESS) & set(robot.stops.names) else "on",
        "guidance": guidance.name.lower(),
        "rapid": "running" if operation.runs(robot) else "stopped",
        "hindrance": "" if hindrance is None else hindrance.words,
        "stops": list(robot.stops.names),
        "speed_percent": robot.desk.speed_percent,
        "position_mm": millimetres(pose.position),
        "joints_deg": tuple(round(math.degrees(joint), 3) for joint in joints),
        "counts": dict(robot.counters),
    }


def _rows(state: Mapping[str, Any]) -> dict[str, str]:
    return {
        "key": state["key"],
        "motors": state["motors"],
        "guidance": state["guidance"],
        "RAPID": state["rapid"],
        "motion": motion_text(state["hindrance"]),
        "stops": ", ".join(state["stops"]) or "none",
        "speed": f"{state['speed_percent']} % of a programmed path",
        "position": f"{numbers_text(state['position_mm'])} mm measured",
        "joints": f"{numbers_text(state['joints_deg'])} °",
        "counts": ", ".join(f"{name} {count}" for name, count in state["counts"].items()) or "none",
    }


EGM_CONTROLS = Controls(_CONTROLS, _state, _rows, EGM_FAULTS)
