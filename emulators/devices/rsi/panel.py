"""The panel of an emulated controller with RSI: its buttons, and the state that its pendant shows."""

from collections.abc import Mapping
from typing import Any

from emulators.devices.rsi.controller import RsiController
from emulators.devices.rsi.faults import RSI_FAULTS
from emulators.panel import Controls, Move, Switch, millimetres, motion_text, numbers_text


def _press(pressed: bool) -> Move:
    def press(robot: RsiController, now: float) -> None:
        robot.emergency_stopped = pressed

    return press


_SWITCHES: Mapping[str, Switch] = {
    "emergency-stop": Switch(
        "Press the emergency stop, or release it.", {"press": _press(True), "release": _press(False)}, "press"
    ),
    "program": Switch(
        "Reset the program and begin it anew, or end it.",
        {"reset": RsiController.reset_program, "end": RsiController.end_program},
    ),
}


def _state(robot: RsiController, now: float) -> dict[str, Any]:
    hindrance = robot.hindrance(now)
    return {
        "program": robot.state.name,
        "error": robot.error,
        "hindrance": "" if hindrance is None else hindrance.words,
        "position_mm": millimetres(robot.pose(now).position),
        "correction": [round(part, 4) for part in robot.correction[:6]],
        "axis_correction": [round(part, 4) for part in robot.correction[6:]],
        "late": robot.late,
        "not_taken": dict(robot.discarded),
    }


def _rows(state: Mapping[str, Any]) -> dict[str, str]:
    return {
        "program": state["program"],
        "error": state["error"] or "none",
        "motion": motion_text(state["hindrance"]),
        "position": f"{numbers_text(state['position_mm'])} mm",
        "correction": f"{numbers_text(state['correction'])} mm, °",
        "of the axes": f"{numbers_text(state['axis_correction'])} °",
        "late cycles": f"{state['late']} since RSI_ON",
        "not taken": ", ".join(f"{why} {count}" for why, count in state["not_taken"].items()) or "none",
    }


RSI_CONTROLS = Controls(_SWITCHES, _state, _rows, RSI_FAULTS)
