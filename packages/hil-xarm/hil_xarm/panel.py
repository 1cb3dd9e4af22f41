"""Panel of the emulated control box: the operator's controls, and the state that it displays."""

from collections.abc import Mapping
from typing import Any

from emulators.panel import Controls, Dial, Switch, millimetres, motion_text, numbers_text
from hil_xarm.codes import error_text
from hil_xarm.faults import XARM_FAULTS
from hil_xarm.frames import Mode, State
from hil_xarm.robot import XarmRobot

_CONTROLS: Mapping[str, Switch | Dial] = {
    "emergency-stop": Switch(
        "Press the emergency stop button, or release it. Its error remains until it is cleared.",
        {
            "press": lambda robot, now: robot.box.press_stop(now),
            "release": lambda robot, now: robot.box.release_stop(),
        },
        "press",
        lambda state: "press" if state["emergency_stop"] else "release",
    ),
    "power": Switch(
        "Switch the control box off and on.",
        {"cycle": lambda robot, now: robot.box.cycle_power(now)},
        "cycle",
    ),
}


def _state(robot: XarmRobot, now: float) -> dict[str, Any]:
    box, hindrance = robot.box, robot.hindrance(now)
    return {
        "emergency_stop": box.stop_pressed,
        "enabled": box.is_enabled,
        "mode": Mode(box.mode).name.lower() if box.mode in tuple(Mode) else f"{box.mode}",
        "state": State(box.state).name.lower().replace("_", " "),
        "error": error_text(box.error) if box.error else "none",
        "warning": box.warning,
        "sensor_on": box.sensor is not None and box.sensor.is_on,
        "hindrance": "" if hindrance is None else hindrance.words,
        "position_mm": millimetres(box.motion.path.pose.position),
        "joints_deg": [round(joint, 3) for joint in box.motion.joints],
        "counts": dict(box.counts),
    }


def _rows(state: Mapping[str, Any]) -> dict[str, str]:
    return {
        "emergency stop": "pressed" if state["emergency_stop"] else "released",
        "motors": "on" if state["enabled"] else "off",
        "mode": state["mode"],
        "state": state["state"],
        "error": state["error"],
        "force sensor": "on" if state["sensor_on"] else "off",
        "motion": motion_text(state["hindrance"]),
        "position": f"{numbers_text(state['position_mm'])} mm",
        "joints": f"{numbers_text(state['joints_deg'])} °",
        "counts": ", ".join(f"{name} {count}" for name, count in state["counts"].items() if count) or "none",
    }


XARM_CONTROLS = Controls(_CONTROLS, _state, _rows, XARM_FAULTS)
