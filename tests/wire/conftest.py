"""Fixtures with both gateway clients of a JR3 sensor and the data on their wires."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import pytest
from hypothesis import strategies as st

from protocol.can.frame import CanFrame
from protocol.devices.jr3 import (
    GatewayClient,
    GatewayClientProfile,
    UartGatewayClient,
    UartGatewayClientProfile,
    encode_sample,
    parse_frame,
)
from protocol.devices.jr3.counts import facts_of
from protocol.devices.jr3.firmware import first_order_delay
from protocol.devices.jr3.uart_gateway import encode_data
from protocol.wrench import SensorEvent, SensorReady, WrenchFrame

T0 = 1000.25
READY = SensorReady(facts_of((115.0, 111.0, 185.0, 5.6, 5.2, 6.1), 0.01, first_order_delay(10.0)))


@dataclass(frozen=True)
class Wire:
    """A client and its wire data: orders and answers as text, samples and noise as data."""

    name: str
    client: Callable[[Any, float], Any]
    profile: Callable[..., Any]
    text: Callable[[Any], list[str]]
    data: Callable[[str], Any]
    ok: str
    not_ready: str
    boot_up: str
    state: str
    scales: tuple[tuple[str, Callable[[list[int]], str]], ...]
    """Requests for full scales, and the answer to each with six words."""
    start: Callable[[str], str]
    """Start order, with the cut-off as encoded on the wire; likewise the new filter."""
    set_filter: Callable[[str], str]
    zero: str
    stop: str
    second: str
    """Description of the second order after the first."""
    step: float
    """Time from an acknowledge until the next order may be sent, s."""
    timeout: float
    """Time-out for an acknowledge, s."""
    sample: Callable[[int], Any]
    noise: Any
    """Bytes that count as malformed once."""
    garbage: st.SearchStrategy[Any]

    def begin(self, **changes: object) -> Any:
        """Return a client that has just started."""
        return self.client(self.profile(**changes), T0)

    def session(self, cutoff: str = "E803") -> list[tuple[str, str]]:
        """Orders up to the stream, each with its answer."""
        scales = [(order, answer([115, 111, 185, 56, 52, 61])) for order, answer in self.scales]
        start = [(self.start(cutoff), self.ok)]
        return [(self.state, self.ok), *(start + scales if "start" in self.second else scales + start)]

    def orders(self, client: Any, now: float) -> list[str]:
        """Return the bytes that the client sends."""
        return self.text(client.data_to_send(now))

    def exchange(self, client: Any, now: float, answer: str, *, expect: str) -> None:
        """Expect one order and answer it at once."""
        assert self.orders(client, now) == [expect]
        client.receive(self.data(answer), now)

    def establish(self, client: Any, now: float, cutoff: str = "E803") -> float:
        """Bring the client to READY; return the time when it may send again."""
        for order, answer in self.session(cutoff):
            self.exchange(client, now, answer, expect=order)
            now += self.step
        steady_at = now - self.step + 0.1
        assert client.next_deadline() == pytest.approx(steady_at)
        client.handle_deadline(steady_at + 1e-6)
        return now + 0.1

    def ready(self, **changes: object) -> Any:
        """Return a client that has been READY for a while at T0 + 10."""
        client = self.begin(**changes)
        self.establish(client, T0)
        assert self.events(client) == [READY]
        return client

    def events(self, client: Any) -> list[SensorEvent]:
        """Return the client's events since the last call."""
        return list(iter(client.next_event, None))

    def feed(self, client: Any, counters: Iterable[int], now: float = T0 + 10) -> list[WrenchFrame]:
        """Return the samples for these counters."""
        for counter in counters:
            client.receive(self.sample(counter % 65536), now)
        return [event for event in self.events(client) if isinstance(event, WrenchFrame)]


def _words(words: list[int]) -> str:
    return b"".join(word.to_bytes(2, "little") for word in words).hex().upper()


CAN = Wire(
    name="gateway node 1",
    client=GatewayClient,
    profile=GatewayClientProfile,
    text=lambda frames: [str(frame) for frame in frames],
    data=lambda texts: [parse_frame(text) for text in texts.split()],
    ok="101#00",
    not_ready="101#01",
    boot_up="701#",
    state="401#",
    scales=(
        ("481#", lambda words: f"101#00{_words(words[:3])}"),
        ("501#", lambda words: f"101#00{_words(words[3:])}"),
    ),
    start=lambda cutoff: f"201#{cutoff}10270000",
    set_filter=lambda cutoff: f"381#{cutoff}",
    zero="301#",
    stop="281#",
    second="start async",
    step=0.0,
    timeout=0.25,
    sample=lambda counter: [*encode_sample(1, [counter % 7] * 6, counter)],
    noise=[parse_frame("601#00")],
    garbage=st.lists(
        st.builds(CanFrame, st.sampled_from(range(0x7FF)) | st.just(0x101), st.binary(max_size=8))
    ),
)
UART = Wire(
    name="UART gateway",
    client=UartGatewayClient,
    profile=UartGatewayClientProfile,
    text=lambda frame: [f"<{frame[1:3].decode()}{frame[3:-1].hex().upper()}>"] if frame else [],
    data=lambda text: f"<{text[1:3]}".encode() + bytes.fromhex(text[3:-1]) + b">",
    ok="<0100>",
    not_ready="<0101>",
    boot_up="<10>",
    state="<06>",
    scales=(("<07>", lambda words: f"<0100{_words(words)}>"),),
    start=lambda cutoff: f"<02{cutoff}10270000>",
    set_filter=lambda cutoff: f"<05{cutoff}>",
    zero="<04>",
    stop="<03>",
    second="get full scales",
    step=1.125,
    timeout=1.25,
    sample=lambda counter: encode_data([0x3E3C - counter % 7] * 6, counter),
    noise=b"noise",
    garbage=st.binary(max_size=30).map(lambda noise: noise + bytes(20)),
)


@pytest.fixture(scope="session", params=[CAN, UART], ids=["can", "uart"])
def wire(request: pytest.FixtureRequest) -> Wire:
    """Every gateway in turn."""
    return request.param


@pytest.fixture(scope="session")
def can() -> Wire:
    """The CAN gateway."""
    return CAN


@pytest.fixture(scope="session")
def uart() -> Wire:
    """The UART gateway."""
    return UART
