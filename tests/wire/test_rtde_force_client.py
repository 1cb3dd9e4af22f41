"""Client that supplies a controller with a force over RTDE: each failure is one line with its remedy."""

import math
from collections.abc import Callable

import pytest

from protocol.devices.rtde import packets
from protocol.devices.rtde.fields import Recipe
from protocol.devices.rtde.force import INPUTS, LOADED_OUTPUTS, OUTPUTS, ForceClient, Lost, Seen
from protocol.devices.rtde.packets import HEADER, Kind, Types
from protocol.devices.rtde.wires import Piece, Pieces, Port
from tests.wire.rtde_talk import SIX, T0

FORCE_OUT = Recipe(1, LOADED_OUTPUTS, ("DOUBLE", "VECTOR6D", "VECTOR6D", "VECTOR6D", "DOUBLE", "VECTOR3D"))
OLD_OUT = Recipe(1, OUTPUTS, FORCE_OUT.types[:4])
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
def test_force_client_enables_reads_and_writes(enable: bool) -> None:
    client = ForceClient(500.0, enable, T0)
    assert not client.farewell()
    client = ForceClient(500.0, enable, T0)
    output = hear(client, *FORCE_ANSWERS)
    assert [piece.data for piece in output if piece.port is Port.RTDE] == [
        packets.version_request(),
        packets.outputs_request(LOADED_OUTPUTS, 500.0),
        packets.inputs_request(INPUTS),
        packets.encode(Kind.START),
    ]
    assert (b"def hil_ft():" in output[-1].data) == enable
    tip = (0.0, 0.0, 0.2, 0.0, 0.0, 0.0)
    straight = (*SIX[:3], 0.0, 0.0, 0.0)
    hear(client, FORCE_OUT.pack(100.0, *straight, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0, *tip, 2.0, 0.1, 0.0, 0.0))
    event = client.next_event()
    assert isinstance(event, Seen)
    assert (event.stamp, event.velocity, event.tip.position) == (100.0, (1.0, 2.0, 3.0), (0.0, 0.0, 0.2))
    client.give((0.0, 0.0, -12.5, 0.0, 0.25, 0.0))
    weight = -2.0 * 9.82
    assert FORCE_IN.unpack(client.data_to_send(T0)[0].data[3:]) == pytest.approx(
        (0.0, 0.0, weight - 12.5, 0.0, 0.25 - 0.1 * weight, 0.0)
    )
    left = FORCE_IN.unpack(client.farewell()[0].data[3:])
    assert left == pytest.approx((0.0, 0.0, weight, 0.0, -0.1 * weight, 0.0)), (
        "the contact goes, the weight stays"
    )


def test_force_client_retries_an_old_controller_without_payload() -> None:
    client = ForceClient(500.0, False, T0)
    missing = packets.types_answer(Kind.OUTPUTS, Types(0, (*OLD_OUT.types, "NOT_FOUND", "NOT_FOUND")))
    old = packets.types_answer(Kind.OUTPUTS, Types(1, OLD_OUT.types))
    output = hear(client, FORCE_ANSWERS[0], missing, old, *FORCE_ANSWERS[2:])
    assert packets.outputs_request(OUTPUTS, 500.0) in [piece.data for piece in output]
    hear(client, OLD_OUT.pack(100.0, *SIX, *(0.0,) * 12))
    client.give((0.0, 0.0, -12.5, 0.0, 0.25, 0.0))
    assert client.data_to_send(T0)[0].data == FORCE_IN.pack(0.0, 0.0, -12.5, 0.0, 0.25, 0.0)


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


def test_force_client_reports_errors_in_one_line() -> None:
    used = packets.types_answer(Kind.INPUTS, Types(0, ("IN_USE",)))
    missing = packets.types_answer(Kind.OUTPUTS, Types(0, ("NOT_FOUND",)))
    wild = FORCE_OUT.pack(100.0, math.inf, *(0.0,) * 21)
    assert "another client holds external_force_torque" in gone([*FORCE_ANSWERS[:2], used])
    assert "its software does not support all of timestamp" in gone([FORCE_ANSWERS[0], missing, missing])
    assert "refuses to speak version 2" in gone([packets.accepted(Kind.VERSION, False)])
    assert "does not speak RTDE" in gone([HEADER.pack(1, Kind.DATA)])
    assert "does not speak RTDE" in gone([*FORCE_ANSWERS, packets.encode(Kind.DATA, b"\x01")])
    assert "not numbers" in gone([*FORCE_ANSWERS, wild])
    assert "nothing received for 1 s" in gone([], lambda client: client.handle_deadline(T0 + 1.0))
