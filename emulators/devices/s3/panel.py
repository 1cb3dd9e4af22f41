"""The panel of an emulated controller: its buttons, keys and lamps, for tests and for a control socket.

A request is a table as JSON has it, from a client that is not trusted:

| `do` | more | what it does |
|---|---|---|
| show | | nothing |
| emergency-stop | `to`: press, release | |
| key | `to`: auto, manual | |
| link-control | `to`: give, take | |
| work-stop | `to`: on, off | |
| programming-unit | `to`: connect, remove | |
| interrupt | `to`: permit, forbid | |
| inject | `target`, `fault`, `with`: table of parameters | one fault; without a target one of the controller's |
| disarm | | forgets the faults that wait for their moment |
| mend | | ends the faults that last |
| faults | | answers the table of faults |

All but the last are answered with the state afterwards.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from emulators.devices.s3.controller import S3Controller
from emulators.devices.s3.faults import S3_FAULTS, target_of
from emulators.devices.s3.state import status_flags
from emulators.faults import FOREVER, Fault, FaultNews, Ledger
from protocol.faults import FaultStage


@dataclass(frozen=True, slots=True)
class PanelState:
    """State of a controller that a panel shows."""

    mode: str
    """standby, operation, synchronise, operation synchronise; starting while it is not ready."""
    activity: str
    """Source of the arm's orders: none, movement sequence, program."""
    flags: dict[str, bool]
    """Flags of the status answer, and the work stop."""
    program: int
    instruction: int
    points_waiting: int
    """Points queued and not reached."""
    queue_depth: int
    position_mm: tuple[float, ...]
    """Reported tool position in the base frame."""
    true_position_mm: tuple[float, ...]
    """Where the tool really is."""
    joints_deg: tuple[float, ...]
    """Axes 1 to 6 of the true pose."""
    answered: int
    """Orders answered, the refused ones included."""
    refused: int
    lost: int
    """Orders that came while too many were waiting."""
    last_refusal: str
    armed: dict[str, int]
    """Faults that wait for their moment, and how often they will strike."""
    lasting: tuple[str, ...]
    """Faults that last, as target and name."""


_ACTS: Mapping[str, Mapping[str, Callable[[S3Controller, float], None]]] = {
    "emergency-stop": {
        "press": S3Controller.press_emergency_stop,
        "release": S3Controller.release_emergency_stop,
    },
    "key": {
        "auto": lambda robot, now: robot.set_key(True, now),
        "manual": lambda robot, now: robot.set_key(False, now),
    },
    "link-control": {
        "give": lambda robot, now: robot.set_link_control(True, now),
        "take": lambda robot, now: robot.set_link_control(False, now),
    },
    "work-stop": {
        "on": lambda robot, now: robot.set_work_stop(True, now),
        "off": lambda robot, now: robot.set_work_stop(False, now),
    },
    "programming-unit": {
        "connect": lambda robot, now: robot.set_programming_unit(True, now),
        "remove": lambda robot, now: robot.set_programming_unit(False, now),
    },
    "interrupt": {
        "permit": lambda robot, now: robot.set_interrupt(True, now),
        "forbid": lambda robot, now: robot.set_interrupt(False, now),
    },
}


class Panel:
    """The panel of one controller. Times are those of the controller's endpoint, s."""

    def __init__(
        self,
        controller: S3Controller,
        faults: Ledger | None = None,
        table: Mapping[str, Mapping[str, Fault]] = S3_FAULTS,
    ) -> None:
        """`faults` and `table` are those of the cell, where there is more than the controller."""
        self._controller = controller
        self._faults = faults or controller.faults
        self._table = table

    def perform(self, request: Mapping[str, object], now: float) -> dict[str, Any]:
        """Carry out a request. Raises ValueError, in one line, for one that cannot be."""
        action = request.get("do")
        controller = self._controller
        if action == "faults":
            return {"faults": fault_table(self._table)}
        if action == "inject":
            fault, parameters = request.get("fault"), request.get("with", {})
            if not isinstance(fault, str) or not isinstance(parameters, dict):
                raise ValueError("inject needs the name of a fault and a table of parameters")
            target = request.get("target") or target_of(fault)
            if not isinstance(target, str):
                raise ValueError("inject needs a target's name, or none")
            self._faults.inject(target, fault, now, parameters)
        elif action == "disarm":
            controller.disarm()
            self._faults.disarm(now)
        elif action == "mend":
            self._faults.mend(now)
        elif isinstance(action, str) and action in _ACTS:
            acts, to = _ACTS[action], request.get("to")
            if not isinstance(to, str) or to not in acts:
                raise ValueError(f"{action} goes to {' or '.join(acts)}, not {to!r}")
            acts[to](controller, now)
            text = f"robot: {action} {to} at the panel"
            self._faults.on_fault(FaultNews(FaultStage.BY_HAND, "robot", action, text))
        elif action != "show":
            known = ", ".join(("show", *_ACTS, "inject", "disarm", "mend", "faults"))
            raise ValueError(f"no action is called {action!r}; known: {known}")
        return {"state": asdict(self.state(now))}

    def state(self, now: float) -> PanelState:
        """State to show at `now`."""
        controller, motion = self._controller, self._controller.motion
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
            position_mm=_millimetres(motion.reported(now)),
            true_position_mm=_millimetres(motion.path.trajectory(np.array([now]))[0][0].tolist()),
            joints_deg=tuple(round(math.degrees(angle), 3) for angle in controller.joints(now)),
            answered=tally.answered,
            refused=tally.refused,
            lost=tally.lost,
            last_refusal=tally.last_refusal,
            armed=dict(controller.armed),
            lasting=self._faults.lasting(now),
        )


def fault_table(table: Mapping[str, Mapping[str, Fault]]) -> dict[str, Any]:
    """Every fault by target, with its meaning and its parameters' meanings, ranges and defaults, as JSON has it."""
    return {
        target: {
            name: {
                "meaning": fault.meaning,
                "parameters": {
                    key: {
                        "meaning": parameter.meaning,
                        "range": parameter.range_text,
                        "unit": parameter.unit,
                        "default": None if parameter.default == FOREVER else parameter.default,
                    }
                    for key, parameter in fault.all_parameters.items()
                },
            }
            for name, fault in faults.items()
        }
        for target, faults in table.items()
    }


def _millimetres(position: Sequence[float]) -> tuple[float, ...]:
    return tuple(round(part * 1000.0, 3) for part in position)
