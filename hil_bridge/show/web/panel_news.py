"""The panel of an emulated controller as a page shows it: controls and faults once, its state when it changes."""

from typing import Any

from hil_bridge.show.web import wire
from hil_bridge.show.web.teller import Cursor


class PanelNews:
    """News of one panel for any number of pages."""

    def __init__(self) -> None:
        self._panel: wire.Panel | None = None
        self._state = wire.PanelState({}, {})
        self._versions = (0, 0)
        """Of the panel, and of its state."""

    @property
    def is_there(self) -> bool:
        """Whether there is a panel."""
        return self._panel is not None

    def take(self, message: wire.Panel | wire.PanelState) -> None:
        """Take what the robot's process tells."""
        whole, state = self._versions
        if isinstance(message, wire.Panel):
            self._panel, self._versions = message, (whole + 1, state)
        else:
            self._state, self._versions = message, (whole, state + 1)

    def news(self, cursor: Cursor) -> dict[str, Any]:
        """News that a page was not told yet; its cursor moves on."""
        panel, (whole, state) = self._panel, cursor.panel
        if panel is None or cursor.panel == self._versions:
            return {}
        news: dict[str, Any] = {}
        if whole != self._versions[0]:
            news["panel"] = {"robot": panel.robot, "controls": panel.controls, "faults": panel.faults}
        if state != self._versions[1]:
            news["panel_state"] = {"rows": list(self._state.rows.items()), "at": self._state.at}
        cursor.panel = self._versions
        return news
