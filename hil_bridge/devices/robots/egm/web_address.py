"""Address of a controller's web services, an option of its URL: `egm+udp-bind://0.0.0.0:6510?rws=HOST:PORT`."""

import ipaddress
from typing import NamedTuple

from hil_bridge.errors import ConfigError
from hil_bridge.transports.urls import split_option
from protocol.devices.egm.web import PORT

OPTION = "rws"


class WebAddress(NamedTuple):
    """Host and port of web services."""

    host: str
    port: int

    @property
    def authority(self) -> str:
        """Host and port as in a URL."""
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"

    @property
    def is_loopback(self) -> bool:
        """Whether the address can be reached from this computer only."""
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"


def split_web(url: str) -> tuple[str, WebAddress | None]:
    """Split a URL into the URL of the datagrams and the address of the web services, None if the URL does not
    contain one. Raises ConfigError if the address is invalid.
    """
    wire, text = split_option(url, OPTION)
    return wire, None if text is None else _parse(url, text)


def _parse(url: str, text: str) -> WebAddress:
    host, colon, port = text.rpartition(":")
    if not colon or text.endswith("]"):
        host, port = text, f"{PORT}"
    host = host.strip("[]")
    plain = host.replace(".", "").replace("-", "").replace(":", "")
    if not (
        plain.isascii()
        and plain.isalnum()
        and port.isascii()
        and port.isdigit()
        and len(port) < 6
        and int(port) < 65536
    ):
        raise ConfigError(f"{url!r}: {OPTION} must be HOST:PORT, such as 192.168.125.1:80, got {text!r}")
    return WebAddress(host, int(port))
