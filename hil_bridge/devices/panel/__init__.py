"""Control socket of an emulated controller's panel: its server, its client, and the panel as text."""

from hil_bridge.devices.panel.client import ask
from hil_bridge.devices.panel.local_panel import LocalPanel, PanelView
from hil_bridge.devices.panel.messages import ANSWER_LIMIT, REQUEST_LIMIT, decode, encode
from hil_bridge.devices.panel.server import CLIENT_LIMIT, PanelServer, panel_address
from hil_bridge.devices.panel.text import controls_text, faults_text, state_text

__all__ = [
    "ANSWER_LIMIT",
    "CLIENT_LIMIT",
    "REQUEST_LIMIT",
    "LocalPanel",
    "PanelServer",
    "PanelView",
    "ask",
    "controls_text",
    "decode",
    "encode",
    "faults_text",
    "panel_address",
    "state_text",
]
