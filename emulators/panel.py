"""The panel of an emulated controller: its buttons, keys and lamps, for tests and for a control socket.

A request is a table as JSON has it, from a client that is not trusted:

| `do` | more | what it does |
|---|---|---|
| show | | nothing |
| a control's name | `to`: one of its positions, or a number | moves the control |
| inject | `target`, `fault`, `with`: table of parameters | one fault; without a target one of the controller's |
| disarm | | forgets the faults that wait for their moment |
| mend | | ends the faults that last |
| faults | | answers the table of faults |
| controls | | answers the table of controls |

All but the last two are answered with the state afterwards: as values, as rows for people, and with the present
position of each control that has one (`at`).
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from emulators.faults import Fault, FaultNews, Ledger, describe_faults, target_of
from protocol.faults import FaultStage

Move: TypeAlias = Callable[[Any, float], object]
"""Moves a control of a robot at a time, s. False: the controller refuses. ValueError says more about that."""


@dataclass(frozen=True, slots=True)
class Switch:
    """A button, a key, a switch: a control with positions."""

    meaning: str
    positions: Mapping[str, Move]
    usual: str = ""
    """The position where an operator names none; empty where one has to be named."""
    at: Callable[[Mapping[str, Any]], str] | None = None
    """The present position in a state; empty where it is in none of them. None for a button that springs back."""

    def move(self, name: str, robot: Any, to: object, now: float) -> str:
        """Move it. Gives the position. Raises ValueError for a position that is none, and where it is refused."""
        to = self.usual or None if to is None else to
        if not isinstance(to, str) or to not in self.positions:
            raise ValueError(f"{name} goes to {' or '.join(self.positions)}, not {to!r}")
        if self.positions[to](robot, now) is False:
            raise ValueError(f"the controller refuses {name} {to} in its present state")
        return to

    @property
    def choices(self) -> tuple[str, ...]:
        """Its positions."""
        return tuple(self.positions)

    @property
    def facts(self) -> dict[str, Any]:
        """More about it, as JSON has it."""
        return {"usual": self.usual}


@dataclass(frozen=True, slots=True)
class Dial:
    """A control that is set to a number."""

    meaning: str
    turn: Callable[[Any, float, float], object]
    """Sets a robot's control to a number at a time, s."""
    least: float
    greatest: float
    unit: str
    at: Callable[[Mapping[str, Any]], float]
    """The present number in a state."""

    def move(self, name: str, robot: Any, to: object, now: float) -> str:
        """Set it. Gives the value and its unit. Raises ValueError for no number of its range."""
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
        """Its range, in words."""
        return (f"{self.least:g} … {self.greatest:g} {self.unit}",)

    @property
    def facts(self) -> dict[str, Any]:
        """Its range and its unit, as JSON has it."""
        return {"least": self.least, "greatest": self.greatest, "unit": self.unit}


@dataclass(frozen=True, slots=True)
class Controls:
    """The panel of one kind of controller, as data."""

    controls: Mapping[str, Switch | Dial]
    """By name."""
    state: Callable[[Any, float], dict[str, Any]]
    """State of a robot that a panel shows at a time, s, as JSON has it."""
    rows: Callable[[Mapping[str, Any]], dict[str, str]]
    """The same for people: text by heading."""
    faults: Mapping[str, Mapping[str, Fault]]
    """Faults of the controller by target: a fault of these needs no target."""
    armed: Callable[[Any], Mapping[str, int]] | None = None
    """Faults that wait for their moment, by name, and how often they will strike; None where the ledger knows."""
    disarm: Callable[[Any], object] | None = None
    """Makes the robot forget them; None where the ledger does."""


class Panel:
    """The panel of one robot. Times are those of the robot's endpoint, s."""

    def __init__(self, robot: Any, controls: Controls, ledger: Ledger) -> None:
        """`ledger` is that of the cell, or of the robot alone."""
        self._robot, self._controls, self._ledger = robot, controls, ledger

    def perform(self, request: Mapping[str, object], now: float) -> dict[str, Any]:
        """Carry out a request. Raises ValueError, in one line, for one that cannot be."""
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
                raise ValueError(f"no action is called {action!r}; known: {known}")
        return self.show(now)

    def show(self, now: float) -> dict[str, Any]:
        """State to show at `now`, with the faults of the cell that last or wait."""
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
            raise ValueError("inject needs a target's name, or none")
        self._ledger.inject(target, fault, now, parameters)


def millimetres(position: Sequence[float]) -> tuple[float, ...]:
    """Return a position in m, in mm, to the µm."""
    return tuple(round(part * 1000.0, 3) for part in position)


def motion_text(hindrance: str) -> str:
    """Whether the arm may move, for a hindrance in words; empty for none."""
    return f"not possible: {hindrance}" if hindrance else "possible"


def numbers_text(values: Sequence[float]) -> str:
    """Numbers of a row, in columns."""
    return "".join(f"{value:>10.3f}" for value in values)
