"""Page updates of an emulated controller's panel: controls and faults once, the state on every change."""

from typing import Any

from hil_bridge.show.web import wire
from hil_bridge.show.web.run_source import Cursor


class PanelUpdates:
    """Updates of one panel for any number of pages."""

    def __init__(self) -> None:
        self._panel: wire.Panel | None = None
        self._state = wire.PanelState({}, {})
        self._versions = (0, 0)
        """Version numbers of the panel and of its state."""

    @property
    def is_there(self) -> bool:
        """Return whether there is a panel."""
        return self._panel is not None

    def take(self, message: wire.Panel | wire.PanelState) -> None:
        """Store a message of the robot's process."""
        panel_version, state = self._versions
        if isinstance(message, wire.Panel):
            self._panel, self._versions = message, (panel_version + 1, state)
        else:
            self._state, self._versions = message, (panel_version, state + 1)

    def updates(self, cursor: Cursor) -> dict[str, Any]:
        """Return the changes that a page has not received, and advance its cursor."""
        panel, (panel_version, state) = self._panel, cursor.panel
        if panel is None or cursor.panel == self._versions:
            return {}
        update: dict[str, Any] = {}
        if panel_version != self._versions[0]:
            update["panel"] = {"robot": panel.robot, "controls": panel.controls, "faults": panel.faults}
        if state != self._versions[1]:
            update["panel_state"] = {"rows": list(self._state.rows.items()), "at": self._state.at}
        cursor.panel = self._versions
        return update
