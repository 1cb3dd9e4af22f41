"""The client that gives a controller a force over RTDE: each way to fail says in one line what to do."""

import math
from collections.abc import Callable

import pytest

from protocol.devices.rtde import packets
from protocol.devices.rtde.fields import Recipe
from protocol.devices.rtde.force import INPUTS, NO_FORCE, OUTPUTS, ForceClient, Lost, Seen
from protocol.devices.rtde.packets import HEADER, Kind, Types
from protocol.devices.rtde.wires import Piece, Pieces, Port
from tests.wire.rtde_talk import SIX, T0

FORCE_OUT = Recipe(1, OUTPUTS, ("DOUBLE", "VECTOR6D", "VECTOR6D", "VECTOR6D"))
FORCE_IN = Recipe(2, INPUTS, ("VECTOR6D",))
FORCE_ANSWERS = [
    packets.accepted(Kind.VERSION, True),
    packets.types_answer(Kind.OUTPUTS, Types(1, FORCE_OUT.types)),
    packets.types_answer(Kind.INPUTS, Types(2, FORCE_IN.types)),
    packets.accepted(Kind.START, True),
]


def hear(client: ForceClient, *raw: bytes) -> Pieces:
    for one in raw:
        client.receive((Piece(Port.SCRIPT, b"state"), Piece(Port.RTDE, one)), T0)
    return client.data_to_send(T0)


@pytest.mark.parametrize("enable", [True, False])
def test_the_force_client_enables_reads_and_gives(enable: bool) -> None:
    client = ForceClient(500.0, enable, T0)
    assert not client.farewell()
    client = ForceClient(500.0, enable, T0)
    said = hear(client, *FORCE_ANSWERS)
    assert [piece.data for piece in said if piece.port is Port.RTDE] == [
        packets.version_request(),
        packets.outputs_request(OUTPUTS, 500.0),
        packets.inputs_request(INPUTS),
        packets.encode(Kind.START),
    ]
    assert (b"def hil_ft():" in said[-1].data) == enable
    tip = (0.0, 0.0, 0.2, 0.0, 0.0, 0.0)
    hear(client, FORCE_OUT.pack(100.0, *SIX, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0, *tip))
    seen = client.next_event()
    assert isinstance(seen, Seen)
    assert (seen.stamp, seen.velocity, seen.tip.position) == (100.0, (1.0, 2.0, 3.0), (0.0, 0.0, 0.2))
    client.give((0.0, 0.0, -12.5, 0.0, 0.25, 0.0))
    assert client.data_to_send(T0)[0].data == FORCE_IN.pack(0.0, 0.0, -12.5, 0.0, 0.25, 0.0)
    assert client.farewell()[0].data == FORCE_IN.pack(*NO_FORCE)


def gone(raw: list[bytes], act: Callable[[ForceClient], object] = lambda client: None) -> str:
    client = ForceClient(500.0, True, T0)
    hear(client, *raw)
    act(client)
    event = client.next_event()
    assert isinstance(event, Lost)
    assert client.next_deadline() is None
    hear(client, *FORCE_ANSWERS)
    assert client.next_event() is None
    return event.text


def test_the_force_client_says_in_one_line_what_is_wrong() -> None:
    used = packets.types_answer(Kind.INPUTS, Types(0, ("IN_USE",)))
    missing = packets.types_answer(Kind.OUTPUTS, Types(0, ("NOT_FOUND",)))
    wild = FORCE_OUT.pack(100.0, math.inf, *(0.0,) * 17)
    assert "another client holds external_force_torque" in gone([*FORCE_ANSWERS[:2], used])
    assert "its software has not all of timestamp" in gone([FORCE_ANSWERS[0], missing])
    assert "refuses to speak version 2" in gone([packets.accepted(Kind.VERSION, False)])
    assert "speaks no RTDE" in gone([HEADER.pack(1, Kind.DATA)])
    assert "speaks no RTDE" in gone([*FORCE_ANSWERS, packets.encode(Kind.DATA, b"\x01")])
    assert "no numbers" in gone([*FORCE_ANSWERS, wild])
    assert "nothing came for 1 s" in gone([], lambda client: client.handle_deadline(T0 + 1.0))
