"""Device log that keeps notices."""

from hil_bridge.devices.device_log import NullLog


class Notices(NullLog):
    """Log that keeps a device's notices, other than frames and answers."""

    def __init__(self) -> None:
        self.notices: list[tuple[str, str]] = []

    def notice(self, kind: str, text: str) -> None:
        self.notices.append((kind, text))
