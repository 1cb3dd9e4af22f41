"""Panel of an emulated controller with RSI: its buttons, its key, and the state displayed on its pendant."""

from collections.abc import Callable, Mapping
from typing import Any

from emulators.devices.rsi.controller import RsiController
from emulators.devices.rsi.desk import Desk, Key, RefusedAct
from emulators.devices.rsi.faults import RSI_FAULTS
from emulators.devices.rsi.session import State
from emulators.panel import Controls, Dial, Move, Switch, millimetres, motion_text, numbers_text


def _act(act: Callable[[Desk], object]) -> Move:
    return lambda robot, now: act(robot.desk)


def _release(desk: Desk) -> None:
    desk.emergency_stop = False


def _stop(desk: Desk) -> None:
    desk.started = False


def _turn(key: Key) -> Move:
    return _act(lambda desk: desk.turn_key(key))


def _start(robot: RsiController, now: float) -> None:
    """Start the program where it was stopped."""
    if robot.state in (State.ERROR, State.CREATED):
        raise RefusedAct(f"{robot.error or 'the program has ended'}; reset the program")
    robot.desk.start()


def _reset(robot: RsiController, now: float) -> None:
    """Reset the program and start it from its beginning."""
    robot.desk.start()
    robot.reset_program(now)


def _override(robot: RsiController, percent: float, now: float) -> None:
    robot.desk.override_percent = round(percent)


_CONTROLS: Mapping[str, Switch | Dial] = {
    "emergency-stop": Switch(
        "Press the emergency stop, or release it. It switches the drives off and stops the program.",
        {"press": _act(Desk.press_emergency_stop), "release": _act(_release)},
        "press",
        lambda state: "press" if state["emergency_stop"] else "release",
    ),
    "key": Switch(
        "Turn the key: T1 for 250 mm/s, T2, AUT, EXT. It switches the drives off.",
        {key.value: _turn(key) for key in Key},
        at=lambda state: str(state["key"]),
    ),
    "drives": Switch(
        "Switch the drives; off stops the program too.",
        {"on": _act(Desk.switch_drives_on), "off": _act(Desk.switch_drives_off)},
        at=lambda state: str(state["drives"]),
    ),
    "program": Switch(
        "Start the program where it was stopped, stop it, reset and restart it, or end it by RSI_OFF.",
        {"start": _start, "stop": _act(_stop), "reset": _reset, "end": RsiController.end_program},
        at=lambda state: "start" if state["started"] else "stop",
    ),
    "message": Switch(
        "Confirm that a sensor correction becomes active; T1 and T2 require it at each start.",
        {"confirm": _act(Desk.confirm)},
        "confirm",
    ),
    "override": Dial(
        "Set the override; telegrams with OvPro.R report it. Corrections are not affected.",
        _override,
        0.0,
        100.0,
        "%",
        lambda state: float(state["override_percent"]),
    ),
}


def _state(robot: RsiController, now: float) -> dict[str, Any]:
    hindrance = robot.hindrance(now)
    desk = robot.desk
    return {
        "key": desk.key.value,
        "emergency_stop": desk.emergency_stop,
        "drives": "on" if desk.drives else "off",
        "started": desk.started,
        "override_percent": desk.override_percent,
        "to_confirm": desk.to_confirm,
        "program": robot.state.name,
        "error": robot.error,
        "hindrance": "" if hindrance is None else hindrance.words,
        "position_mm": millimetres(robot.pose(now).position),
        "correction": [round(part, 4) for part in robot.correction[:6]],
        "axis_correction": [round(part, 4) for part in robot.correction[6:]],
        "late": robot.late,
        "not_taken": dict(robot.discarded),
    }


_PROGRAM_TEXTS = {
    State.CREATED: "RSI is off",
    State.ON: "RSI is on, no correction acts yet",
    State.MOVECORR: "RSI_MOVECORR",
    State.ERROR: "ended by an error",
}


def _rows(state: Mapping[str, Any]) -> dict[str, str]:
    emergency = ", EMERGENCY STOP" if state["emergency_stop"] else ""
    started = "started" if state["started"] else "stopped"
    return {
        "key": f"{state['key'].upper()}{emergency}",
        "drives": state["drives"],
        "program": f"{started}, {_PROGRAM_TEXTS[State[state['program']]]}",
        "error": state["error"] or "none",
        "message": "confirm: a sensor correction becomes active" if state["to_confirm"] else "none",
        "motion": motion_text(state["hindrance"]),
        "override": f"{state['override_percent']} %",
        "position": f"{numbers_text(state['position_mm'])} mm",
        "correction": f"{numbers_text(state['correction'])} mm, °",
        "of the axes": f"{numbers_text(state['axis_correction'])} °",
        "late cycles": f"{state['late']} since RSI_ON",
        "not taken": ", ".join(f"{why} {count}" for why, count in state["not_taken"].items()) or "none",
    }


RSI_CONTROLS = Controls(_CONTROLS, _state, _rows, RSI_FAULTS)
