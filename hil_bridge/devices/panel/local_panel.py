"""Panel of an emulated controller in this process, for the socket and the page by which an operator uses it."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple


class LocalPanel(NamedTuple):
    """Panel of the controller."""

    robot: str
    """Kind of the robot."""
    perform: Callable[[Mapping[str, Any]], Mapping[str, Any]]
    """Executes a request of `emulators.panel` and returns its answer. Raises ValueError with a one-line message."""

    def view(self) -> "PanelView":
        """Return the state for display. If the panel fails, the view contains the error."""
        try:
            answer = self.perform({"do": "show"})
        except ValueError as error:
            return PanelView({"trouble": str(error)}, {})
        return PanelView(answer["rows"], answer["at"])


class PanelView(NamedTuple):
    """State of a panel for display."""

    rows: Mapping[str, str]
    """Text by heading."""
    at: Mapping[str, str | float]
    """Present position of each control that has one."""
