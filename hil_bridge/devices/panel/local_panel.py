"""Panel of an emulated controller in this process. The control socket and the operator page use it."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple


class LocalPanel(NamedTuple):
    """Panel of an emulated controller."""

    robot: str
    """Name of the robot's kind."""
    perform: Callable[[Mapping[str, Any]], Mapping[str, Any]]
    """Executes a request of `emulators.panel` and returns the answer. Raises ValueError with a one-line message if
    the request is invalid.
    """

    def view(self) -> "PanelView":
        """Return the panel's state for display. If the panel fails, the view contains the error."""
        try:
            answer = self.perform({"do": "show"})
        except ValueError as error:
            return PanelView({"trouble": str(error)}, {})
        return PanelView(answer["rows"], answer["at"])


class PanelView(NamedTuple):
    """State of a panel for display."""

    rows: Mapping[str, str]
    """Displayed text by heading."""
    at: Mapping[str, str | float]
    """Present position of each control that has positions."""
