"""The panel of an emulated controller with EGM: its buttons, and the state that its pendant shows."""

import math
from collections.abc import Mapping
from typing import Any

from emulators.devices.egm.controller import EgmController
from emulators.devices.egm.faults import EGM_FAULTS
from emulators.panel import Controls, Move, Switch, millimetres, motion_text, numbers_text


def _stop(name: str) -> Move:
    return lambda robot, now: robot.stop(name, now)


def _start(name: str) -> Move:
    return lambda robot, now: robot.start(name, now)


_SWITCHES: Mapping[str, Switch] = {
    "emergency-stop": Switch(
        "Press the emergency stop, or release it.",
        {"press": _stop("emergency-stop"), "release": _start("emergency-stop")},
        "press",
    ),
    "motors": Switch("Switch the motors.", {"on": _start("motors-off"), "off": _stop("motors-off")}),
    "program": Switch(
        "Start the RAPID program where it was stopped, stop it, or start it from its first line.",
        {
            "start": _start("program-stopped"),
            "stop": _stop("program-stopped"),
            "restart": EgmController.restart_program,
        },
    ),
}


def _state(robot: EgmController, now: float) -> dict[str, Any]:
    motors, guidance, rapid = robot.state.value[:3]
    hindrance = robot.hindrance(now)
    pose, joints = robot.measured
    return {
        "motors": motors.name.lower(),
        "guidance": guidance.name.lower(),
        "rapid": rapid.name.lower(),
        "hindrance": "" if hindrance is None else hindrance.words,
        "stops": list(robot.stops),
        "position_mm": millimetres(pose.position),
        "joints_deg": tuple(round(math.degrees(joint), 3) for joint in joints),
        "counts": dict(robot.counters),
    }


def _rows(state: Mapping[str, Any]) -> dict[str, str]:
    return {
        "motors": state["motors"],
        "guidance": state["guidance"],
        "RAPID": state["rapid"],
        "motion": motion_text(state["hindrance"]),
        "stops": ", ".join(state["stops"]) or "none",
        "position": f"{numbers_text(state['position_mm'])} mm measured",
        "joints": f"{numbers_text(state['joints_deg'])} °",
        "counts": ", ".join(f"{name} {count}" for name, count in state["counts"].items()) or "none",
    }


EGM_CONTROLS = Controls(_SWITCHES, _state, _rows, EGM_FAULTS)
