"""Panel of an emulated controller with buttons, switches and indicators, for tests and for a control socket.

A request is a JSON object from an untrusted client:

| `do` | further keys | effect |
|---|---|---|
| show | | none |
| name of a control | `to`: one of its positions, or a number | moves the control |
| inject | `target`, `fault`, `with`: table of parameters | injects a fault; the default target is the controller |
| disarm | | cancels the faults that wait for an opportunity |
| mend | | ends the active faults |
| faults | | returns the table of faults |
| controls | | returns the table of controls |

All requests except the last two return the state after the request: as values, as rows of text, and with the present
position of each control that has a position (`at`).
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from emulators.faults import Fault, FaultNews, Ledger, describe_faults, target_of
from protocol.faults import FaultStage

Move: TypeAlias = Callable[[Any, float], object]
"""Function that moves a control of a robot at a time, s. It returns False or raises ValueError if the robot refuses."""


@dataclass(frozen=True, slots=True)
class Switch:
    """Control with discrete positions, such as a button, a key or a switch."""

    meaning: str
    positions: Mapping[str, Move]
    usual: str = ""
    """Default position; empty if a request must name a position."""
    at: Callable[[Mapping[str, Any]], str] | None = None
    """Function that returns the present position in a state; empty if there is none. None for a button that springs
    back.
    """

    def move(self, name: str, robot: Any, to: object, now: float) -> str:
        """Move the control and return its position.

        Raises ValueError for an unknown position, and if the robot refuses.
        """
        to = self.usual or None if to is None else to
        if not isinstance(to, str) or to not in self.positions:
            raise ValueError(f"{name} goes to {' or '.join(self.positions)}, not {to!r}")
        if self.positions[to](robot, now) is False:
            raise ValueError(f"the controller refuses {name} {to} in its present state")
        return to

    @property
    def choices(self) -> tuple[str, ...]:
        """Possible positions of the control."""
        return tuple(self.positions)

    @property
    def facts(self) -> dict[str, Any]:
        """Further properties of the control, ready for JSON."""
        return {"usual": self.usual}


@dataclass(frozen=True, slots=True)
class Dial:
    """Control that is set to a numeric value."""

    meaning: str
    turn: Callable[[Any, float, float], object]
    """Function that sets a control of a robot to a value at a time, s."""
    least: float
    greatest: float
    unit: str
    at: Callable[[Mapping[str, Any]], float]
    """Function that returns the present value in a state."""

    def move(self, name: str, robot: Any, to: object, now: float) -> str:
        """Set the control and return the value with its unit. Raises ValueError if the value is out of range."""
        try:
            value = float(to) if isinstance(to, str | int | float) and not isinstance(to, bool) else math.nan
        except (ValueError, OverflowError):
            value = math.nan
        if not self.least <= value <= self.greatest:
            raise ValueError(f"{name} goes to a number of {self.choices[0]}, not {to!r}")
        self.turn(robot, value, now)
        return f"{value:g} {self.unit}"

    @property
    def choices(self) -> tuple[str, ...]:
        """Range of the control, as text."""
        return (f"{self.least:g} … {self.greatest:g} {self.unit}",)

    @property
    def facts(self) -> dict[str, Any]:
        """Range and unit of the control, ready for JSON."""
        return {"least": self.least, "greatest": self.greatest, "unit": self.unit}


@dataclass(frozen=True, slots=True)
class Controls:
    """Definition of the panel of one kind of controller."""

    controls: Mapping[str, Switch | Dial]
    """Controls by name."""
    state: Callable[[Any, float], dict[str, Any]]
    """Function that returns the state that the panel of a robot displays at a time, s, ready for JSON."""
    rows: Callable[[Mapping[str, Any]], dict[str, str]]
    """Function that formats a state as texts by heading."""
    faults: Mapping[str, Mapping[str, Fault]]
    """Faults of the controller by target. A request to inject one of them needs no target."""
    armed: Callable[[Any], Mapping[str, int]] | None = None
    """Function that counts the waiting faults of a robot by name; None if the ledger counts them."""
    disarm: Callable[[Any], object] | None = None
    """Function that cancels the pending faults of a robot; None if the ledger cancels them."""


class Panel:
    """Panel of one robot. Times are on the clock of the robot's endpoint, s."""

    def __init__(self, robot: Any, controls: Controls, ledger: Ledger) -> None:
        """`ledger` is the ledger of the cell, or of the robot if there is no cell."""
        self._robot, self._controls, self._ledger = robot, controls, ledger

    def perform(self, request: Mapping[str, object], now: float) -> dict[str, Any]:
        """Carry out a request and return the response. Raises ValueError, in one line, for an invalid request."""
        action = request.get("do")
        controls = self._controls.controls
        match action:
            case "show":
                pass
            case "faults":
                return {"faults": describe_faults(self._ledger.table)}
            case "controls":
                return {
                    "controls": {
                        name: {"meaning": control.meaning, "to": control.choices, **control.facts}
                        for name, control in controls.items()
                    }
                }
            case "inject":
                self._inject(request, now)
            case "disarm":
                if self._controls.disarm is not None:
                    self._controls.disarm(self._robot)
                self._ledger.disarm(now)
            case "mend":
                self._ledger.mend(now)
            case str() if action in controls:
                to = controls[action].move(action, self._robot, request.get("to"), now)
                text = f"robot: {action} {to} at the panel"
                self._ledger.on_fault(FaultNews(FaultStage.BY_HAND, "robot", action, text))
            case _:
                known = ", ".join(("show", *controls, "inject", "disarm", "mend", "faults", "controls"))
                raise ValueError(f"unknown action {action!r}; known: {known}")
        return self.show(now)

    def show(self, now: float) -> dict[str, Any]:
        """Return the state at `now`, with the active and the waiting faults of the cell."""
        robot, controls = self._robot, self._controls
        state = controls.state(robot, now)
        armed = dict(controls.armed(robot)) if controls.armed else self._ledger.waiting(now)
        state["armed"] = armed
        state["lasting"] = lasting = self._ledger.lasting(now)
        at = {name: one.at(state) for name, one in controls.controls.items() if one.at is not None}
        rows = {
            **controls.rows(state),
            "faults": ", ".join(f"{name} ({count})" for name, count in armed.items()) or "none waiting",
            "lasting": ", ".join(lasting) or "none",
        }
        return {"state": state, "rows": rows, "at": at}

    def _inject(self, request: Mapping[str, object], now: float) -> None:
        fault, parameters = request.get("fault"), request.get("with", {})
        if not isinstance(fault, str) or not isinstance(parameters, dict):
            raise ValueError("inject needs the name of a fault and a table of parameters")
        target = request.get("target") or target_of(fault, self._controls.faults)
        if not isinstance(target, str):
            raise ValueError("the target of inject must be a name, or be left out")
        self._ledger.inject(target, fault, now, parameters)


def millimetres(position: Sequence[float]) -> tuple[float, ...]:
    """Return a position in mm, rounded to 1 µm, from a position in m."""
    return tuple(round(part * 1000.0, 3) for part in position)


def motion_text(hindrance: str) -> str:
    """Return text that states whether the arm can move.

    `hindrance` is the reason why it cannot; empty if it can.
    """
    return f"not possible: {hindrance}" if hindrance else "possible"


def numbers_text(values: Sequence[float]) -> str:
    """Format the numbers of a row as text in columns."""
    return "".join(f"{round(value, 3) + 0.0:>10.3f}" for value in values)  # no negative zero
