"""Panel of an emulated S3: its buttons and keys, and the state of its lamps and display."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from emulators.devices.s3.controller import S3Controller
from emulators.devices.s3.faults import S3_FAULTS
from emulators.devices.s3.state import status_flags
from emulators.panel import Controls, Switch, millimetres, numbers_text


@dataclass(frozen=True, slots=True)
class PanelState:
    """State of a controller, for display on its panel."""

    mode: str
    """Mode: standby, operation, synchronise or operation synchronise; starting while the controller is not ready."""
    activity: str
    """Source of the arm's orders: none, movement sequence or program."""
    flags: dict[str, bool]
    """Flags of the status answer, and the work stop."""
    program: int
    instruction: int
    points_waiting: int
    """Number of queued points."""
    queue_depth: int
    position_mm: tuple[float, ...]
    """Reported tool position in the base frame, mm."""
    true_position_mm: tuple[float, ...]
    """True tool position in the base frame, mm."""
    joints_deg: tuple[float, ...]
    """Axes 1 to 6 of the true pose, degrees."""
    answered: int
    """Number of answered orders, including refused ones."""
    refused: int
    lost: int
    """Number of orders received while too many were waiting."""
    last_refusal: str


_SWITCHES: Mapping[str, Switch] = {
    "emergency-stop": Switch(
        "Press the emergency stop, or release it.",
        {"press": S3Controller.press_emergency_stop, "release": S3Controller.release_emergency_stop},
        "press",
        lambda state: "press" if state["flags"]["emergency_stop"] else "release",
    ),
    "key": Switch(
        "Turn the key.",
        {
            "auto": lambda robot, now: robot.set_key(True, now),
            "manual": lambda robot, now: robot.set_key(False, now),
        },
        at=lambda state: "auto" if state["flags"]["key_auto"] else "manual",
    ),
    "link-control": Switch(
        "Give the link control at the pendant, or take it back.",
        {
            "give": lambda robot, now: robot.set_link_control(True, now),
            "take": lambda robot, now: robot.set_link_control(False, now),
        },
        at=lambda state: "take" if state["flags"]["local"] else "give",
    ),
    "work-stop": Switch(
        "Stop work, or let it continue.",
        {
            "on": lambda robot, now: robot.set_work_stop(True, now),
            "off": lambda robot, now: robot.set_work_stop(False, now),
        },
        at=lambda state: "on" if state["flags"]["work_stop"] else "off",
    ),
    "programming-unit": Switch(
        "Connect the programming unit, or remove it.",
        {
            "connect": lambda robot, now: robot.set_programming_unit(True, now),
            "remove": lambda robot, now: robot.set_programming_unit(False, now),
        },
        at=lambda state: "connect" if state["flags"]["programming_unit"] else "remove",
    ),
    "interrupt": Switch(
        "Permit or forbid interrupts; the status reports it.",
        {
            "permit": lambda robot, now: robot.set_interrupt(True, now),
            "forbid": lambda robot, now: robot.set_interrupt(False, now),
        },
        at=lambda state: "permit" if state["flags"]["interrupt_permitted"] else "forbid",
    ),
}
_FLAG_TEXTS = {
    "emergency_stop": ("EMERGENCY STOP", ""),
    "work_stop": ("WORK STOP", ""),
    "key_auto": ("key in AUTO", "key in MANUAL"),
    "local": ("link control taken back", "link control given"),
    "programming_unit": ("programming unit connected", ""),
    "interrupt_permitted": ("interrupt permitted", ""),
    "execution": ("execution", ""),
}
"""Texts for each flag: if it is set, and if it is not set."""


def read_state(controller: S3Controller, now: float) -> PanelState:
    """Return the state to display at `now`."""
    motion = controller.motion
    state, run, tally = controller.state, controller.program, controller.tally
    waiting = motion.waiting(now)
    return PanelState(
        mode="starting" if state.starting else state.mode.name.lower().replace("_", " "),
        activity=state.activity.value,
        flags={**status_flags(state, waiting > 0, controller.profile), "work_stop": state.work_stop},
        program=run.number if run is not None else 0,
        instruction=run.instruction if run is not None else 0,
        points_waiting=waiting,
        queue_depth=controller.profile.queue_depth,
        position_mm=millimetres(motion.reported(now)),
        true_position_mm=millimetres(motion.path.trajectory(np.array([now]))[0][0].tolist()),
        joints_deg=tuple(round(math.degrees(angle), 3) for angle in controller.joints(now)),
        answered=tally.answered,
        refused=tally.refused,
        lost=tally.lost,
        last_refusal=tally.last_refusal,
    )


def _rows(state: Mapping[str, Any]) -> dict[str, str]:
    flags = state["flags"]
    flag_texts = [texts[0] if flags[name] else texts[1] for name, texts in _FLAG_TEXTS.items()]
    activity = state["activity"]
    return {
        "mode": state["mode"] if activity == "none" else f"{state['mode']}, {activity}",
        "state": ", ".join(filter(None, flag_texts)),
        "points": f"{state['points_waiting']} of {state['queue_depth']} waiting",
        "program": f"{state['program']}, instruction {state['instruction']}",
        "position": f"{numbers_text(state['position_mm'])} mm reported",
        "": f"{numbers_text(state['true_position_mm'])} mm true",
        "joints": f"{numbers_text(state['joints_deg'])} °",
        "orders": f"{state['answered']} answered, {state['refused']} of them refused, {state['lost']} lost",
        "last refusal": state["last_refusal"] or "none",
    }


S3_CONTROLS = Controls(
    _SWITCHES,
    lambda robot, now: asdict(read_state(robot, now)),
    _rows,
    S3_FAULTS,
    lambda robot: robot.armed,
    S3Controller.disarm,
)
