"""The panel of an emulated controller that this process serves: its acts, for every interface to it."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple


class LocalPanel(NamedTuple):
    """The controller's panel at the present time."""

    robot: str
    """Kind of the robot."""
    perform: Callable[[Mapping[str, Any]], Mapping[str, Any]]
    """Carries out a request of `emulators.panel` and gives its answer. Raises ValueError, in one line."""

    def view(self) -> "PanelView":
        """The state for people. A panel that fails shows its failure."""
        try:
            answer = self.perform({"do": "show"})
        except ValueError as error:
            return PanelView({"trouble": str(error)}, {})
        return PanelView(answer["rows"], answer["at"])


class PanelView(NamedTuple):
    """A panel as people see it."""

    rows: Mapping[str, str]
    """Text by heading."""
    at: Mapping[str, str | float]
    """Present position of each control that has one."""
