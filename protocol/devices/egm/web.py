"""Constants of Robot Web Services 1.0 that both ends use. Source: abb_librws (9ba0837)."""

USER, PASSWORD = "Default User", "robotics"
"""Default credentials of the vendor."""
SUBSCRIPTION = "robapi2_subscription"
"""WebSocket subprotocol for subscriptions."""
PORT = 80
"""TCP port on a real controller."""
