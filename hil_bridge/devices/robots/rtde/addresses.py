"""Addresses of a controller's ports, all from one URL.

| URL | ports |
|---|---|
| `tcp://10.0.0.5` | 30004, and the dashboard and script ports of the settings |
| `tcp://127.0.0.1:41000?dashboard=41001&script=41002` | the ports in the URL |
| `tcp-listen://127.0.0.2` | the ports of the real controller: 30001 to 30004, 30011 to 30013, 29999 |
| `tcp-listen://127.0.0.1:0` | free ports |
| `memory:NAME` | in memory |
"""

from collections.abc import Mapping
from dataclasses import dataclass
from urllib.parse import parse_qsl, urlsplit

from hil_bridge.errors import ConfigError
from hil_bridge.transports.urls import WireUrl
from protocol.devices.rtde.wires import Port

RTDE_PORT = 30004
PORTS: Mapping[Port, tuple[int, ...]] = {
    Port.RTDE: (RTDE_PORT,),
    Port.DASHBOARD: (29999,),
    Port.SCRIPT: (),
    Port.PRIMARY: (30001,),
    Port.SECONDARY: (30002,),
    Port.READ_ONLY: (30011,),
    Port.SECONDARY_READ_ONLY: (30012,),
    Port.REALTIME: (30003,),
    Port.REALTIME_READ_ONLY: (30013,),
}
"""TCP ports of a real controller. Every port that accepts programs also sends data."""
_EXAMPLE = "tcp://10.0.0.5, or tcp://127.0.0.1:41000?dashboard=41001&script=41002"
_OPTIONS = {
    "dashboard": Port.DASHBOARD,
    "script": Port.SCRIPT,
    "primary": Port.PRIMARY,
    "read-only": Port.READ_ONLY,
    "secondary": Port.SECONDARY,
    "secondary-read-only": Port.SECONDARY_READ_ONLY,
    "realtime": Port.REALTIME,
    "realtime-read-only": Port.REALTIME_READ_ONLY,
}


@dataclass(frozen=True, slots=True)
class Address:
    """Ports of a controller on a host, or in memory."""

    text: str
    host: str
    """Host name or address; empty for ports in memory."""
    ports: Mapping[Port, int]
    """Ports that the URL names explicitly; 0 for any free port."""
    name: str = ""
    """Common name of the ports in memory."""
    options: str = ""
    """Further options of a wire in memory, such as `?latency_ms=1`."""

    def memory_name(self, port: Port) -> str:
        """Return the name of a port in memory."""
        return self.name if port is Port.RTDE else f"{self.name}-{port}"

    def memory_url(self, port: Port) -> str:
        """Return the URL of a port in memory."""
        return f"memory:{self.memory_name(port)}{self.options}"

    @property
    def wire(self) -> WireUrl:
        """Wire URL of the RTDE port."""
        if self.name:
            return WireUrl(self.text, "memory", self.name, {})
        return WireUrl(self.text, "tcp", f"{self.authority}:{self.ports.get(Port.RTDE, RTDE_PORT)}", {})

    @property
    def authority(self) -> str:
        """Host in the notation of a URL."""
        return f"[{self.host}]" if ":" in self.host else self.host


def parse_address(url: str, scheme: str = "tcp") -> Address:
    """Parse an address with this scheme, or an address in memory. Raises ConfigError if the address is invalid."""
    if url.startswith("memory:"):
        name, mark, options = url.removeprefix("memory:").partition("?")
        if not name:
            raise ConfigError(f"{url!r}: the ports in memory need a name, as in memory:ur")
        return Address(url, "", {}, name, mark + options)
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError as error:
        raise ConfigError(f"{url!r}: {error}; write {_EXAMPLE}") from error
    if parts.scheme != scheme or not parts.hostname or parts.path not in ("", "/") or parts.fragment:
        raise ConfigError(f"{url!r}: a robot over RTDE needs {_EXAMPLE.replace('tcp', scheme, 1)}")
    ports = {} if port is None else {Port.RTDE: port}
    for key, text in parse_qsl(parts.query, keep_blank_values=True):
        if key not in _OPTIONS:
            raise ConfigError(f"{url!r}: unknown option {key!r}; allowed: {', '.join(_OPTIONS)}")
        if not (text.isascii() and text.isdigit() and int(text[:9]) <= 65535):
            raise ConfigError(f"{url!r}: {key} must be a TCP port, got {text!r}")
        ports[_OPTIONS[key]] = int(text)
    return Address(url, parts.hostname, ports)
