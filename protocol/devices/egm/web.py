"""Facts of Robot Web Services 1.0 that both ends need. Source: abb_librws (9ba0837)."""

USER, PASSWORD = "Default User", "robotics"
"""The maker's defaults."""
SUBSCRIPTION = "robapi2_subscription"
"""WebSocket protocol of a subscription."""
PORT = 80
"""TCP port of a real controller."""
