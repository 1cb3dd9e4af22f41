"""A log of a device that keeps what the device says."""

from hil_bridge.devices.device_log import NullLog


class Notices(NullLog):
    """Keeps what a device says beside its frames and answers."""

    def __init__(self) -> None:
        self.notices: list[tuple[str, str]] = []

    def notice(self, kind: str, text: str) -> None:
        self.notices.append((kind, text))
