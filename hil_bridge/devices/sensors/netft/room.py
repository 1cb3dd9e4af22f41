"""Device package for an ATI Net F/T. The URL contains the host and port of the records, and the port of the page.

`netft+udp://192.168.1.1:49152?http_port=80`. In virtual time both are in memory: the records at `udp+memory:NAME`,
the page at the byte wire `memory:NAME-page`.
"""

from typing import Any

from emulators.devices.netft import NETFT_FAULTS, NetBox, NetFtProfile, PageEndpoint, answer
from emulators.seams import SensorFactory
from hil_bridge.devices.kinds import KindSettings, SensorEmulation, SensorKind
from hil_bridge.devices.sensors.netft.emulator_fit import match
from hil_bridge.devices.sensors.netft.page_server import PageServer
from hil_bridge.devices.sensors.netft.page_wire import WithPage
from hil_bridge.devices.wiring import Serving, Wiring
from hil_bridge.errors import ConfigError
from hil_bridge.transports import Transport, connect_datagrams
from hil_bridge.transports.urls import (
    CONNECT_DATAGRAMS,
    LISTEN_DATAGRAMS,
    WireUrl,
    parse_url,
    split_option,
    with_option,
)
from protocol.devices.netft import NetFtClient, NetFtClientProfile, describe

_OPTION = "http_port"
_MEMORY = "udp+memory"


def split_url(url: str) -> tuple[str, int | None]:
    """Split a URL into the wire's URL and the port of the page. The port is None if the URL does not contain it.
    Raises ConfigError if the URL is invalid.
    """
    wire, text = split_option(url, _OPTION)
    if text is None:
        return url, None
    if not (text.isascii() and text.isdigit() and len(text) < 6 and int(text) < 65536):
        raise ConfigError(f"{url!r}: {_OPTION} must be a port from 0 to 65535, got {text!r}")
    return wire, int(text)


def _page_url(wire: WireUrl, port: int) -> str:
    """Return the byte wire of the page for a wire of datagrams."""
    if wire.scheme == _MEMORY:
        return f"memory:{wire.target}-page"
    host, _ = wire.host_port
    return f"tcp://[{host}]:{port}" if ":" in host else f"tcp://{host}:{port}"


def _parse(url: str, settings: KindSettings[NetFtClientProfile, NetFtProfile]) -> WireUrl:
    return parse_url(split_url(url)[0], CONNECT_DATAGRAMS)


async def _connect(
    url: str, settings: KindSettings[NetFtClientProfile, NetFtProfile], wiring: Wiring
) -> tuple[Transport[Any], Any]:
    wire_url, port = split_url(url)
    profile: NetFtClientProfile = settings.client
    page = _page_url(parse_url(wire_url, CONNECT_DATAGRAMS), port or profile.http_port)
    wire = await connect_datagrams(wire_url, wiring.clock, wiring.log.notice)
    with_page = WithPage(wire, page, profile.page_timeout_s, wiring.clock)
    return wiring.tap(with_page), NetFtClient(profile, wiring.clock.now())


def _make(settings: KindSettings[NetFtClientProfile, NetFtProfile]) -> SensorFactory:
    return lambda source, now, seed: NetBox(settings.emulated, source, now, seed)


async def _serve(
    url: str, box: Any, settings: KindSettings[NetFtClientProfile, NetFtProfile], serving: Serving
) -> str:
    wire_url, port = split_url(url)
    parsed = parse_url(wire_url, LISTEN_DATAGRAMS)
    if parsed.scheme == _MEMORY:
        await serving.serve_bytes(_page_url(parsed, 0), PageEndpoint(box))
        return await serving.serve_datagrams(wire_url, box.endpoint)
    host, _ = parsed.host_port
    server = PageServer(lambda request: answer(request, box, serving.clock.now()))
    serving.stack.push_async_callback(server.aclose)
    page_port = await server.listen(host, settings.emulated.http_port if port is None else port)
    address = await serving.serve_datagrams(wire_url, box.endpoint)
    return with_option(address, _OPTION, f"{page_port}")


SENSOR = SensorKind(
    "netft",
    "ATI Net F/T: records over UDP, configuration page over HTTP",
    NetFtClientProfile,
    _connect,
    SensorEmulation(
        NetFtProfile,
        _make,
        _serve,
        lambda settings, virtual: f"{_MEMORY}:netft" if virtual else "udp-bind://127.0.0.1:0",
        NETFT_FAULTS,
        {"status": "status"},
        match,
    ),
    parse=_parse,
    describe=describe,
)
