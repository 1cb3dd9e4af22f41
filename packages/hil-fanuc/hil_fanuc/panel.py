"""Panel of the emulated controller: the operator's controls, and the state that its pendant displays."""

from collections.abc import Mapping
from typing import Any

from emulators.panel import Controls, Dial, Switch, millimetres, motion_text, numbers_text
from hil_fanuc.controller import FanucController
from hil_fanuc.faults import FANUC_FAULTS
from hil_fanuc.rmi import ProgramStatus

_PROGRAM_TEXTS = {
    ProgramStatus.RUNNING: "running",
    ProgramStatus.CANCELLED: "not called",
    ProgramStatus.HELD: "held",
}


def _press(robot: FanucController, now: float) -> None:
    robot.program.press_stop(now)


def _release(robot: FanucController, now: float) -> None:
    robot.program.release_stop()


def _pendant(is_on: bool, robot: FanucController) -> None:
    robot.program.pendant_on = is_on
    if is_on:
        robot.abort()


_CONTROLS: Mapping[str, Switch | Dial] = {
    "emergency-stop": Switch(
        "Press the emergency stop, or release it. Its alarms remain until a reset over the Remote Motion Interface.",
        {"press": _press, "release": _release},
        "press",
        lambda state: "press" if state["emergency_stop"] else "release",
    ),
    "pendant": Switch(
        "Switch the teach pendant on or off. While it is on, no program runs.",
        {
            "on": lambda robot, now: _pendant(True, robot),
            "off": lambda robot, now: _pendant(False, robot),
        },
        at=lambda state: "on" if state["pendant_on"] else "off",
    ),
    "program": Switch(
        "Start the TP program of Stream Motion by the start key, without the Remote Motion Interface.",
        {"start": lambda robot, now: robot.program.call(now)},
        "start",
    ),
    "abort-all": Switch(
        "Abort all tasks (FCTN, ABORT ALL). The server of Stream Motion then hangs until the power is cycled.",
        {"press": FanucController.abort_tasks},
        "press",
    ),
    "power": Switch("Switch the controller off and on.", {"cycle": FanucController.cycle_power}, "cycle"),
}


def _state(robot: FanucController, now: float) -> dict[str, Any]:
    hindrance = robot.hindrance(now)
    program, motion = robot.program, robot.motion
    return {
        "emergency_stop": program.stopped_at is not None,
        "pendant_on": program.pendant_on,
        "program": _PROGRAM_TEXTS[program.status],
        "streams": robot.server.is_open,
        "version": robot.server.version,
        "ready": program.is_ready(now),
        "alarms": list(program.alarms.active),
        "contact_stop": robot.reporter.contact_stop.name.lower(),
        "hindrance": "" if hindrance is None else hindrance.words,
        "position_mm": millimetres(motion.path.pose.position),
        "joints_deg": [round(joint, 3) for joint in motion.joints],
        "counts": dict(robot.server.counts),
    }


def _rows(state: Mapping[str, Any]) -> dict[str, str]:
    emergency = "pressed" if state["emergency_stop"] else "released"
    stream = f"version {state['version']}, sends reports" if state["streams"] else "no session"
    return {
        "emergency stop": emergency,
        "pendant": "on" if state["pendant_on"] else "off",
        "program": state["program"],
        "stream": f"{stream}{', ready' if state['ready'] else ''}",
        "alarms": "; ".join(state["alarms"]) or "none",
        "contact stop": state["contact_stop"],
        "motion": motion_text(state["hindrance"]),
        "position": f"{numbers_text(state['position_mm'])} mm",
        "joints": f"{numbers_text(state['joints_deg'])} °",
        "counts": ", ".join(f"{name} {count}" for name, count in state["counts"].items() if count) or "none",
    }


FANUC_CONTROLS = Controls(_CONTROLS, _state, _rows, FANUC_FAULTS)
