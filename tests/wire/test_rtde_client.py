"""RTDE client of a controller, against a scripted one: each failure is one line with its remedy."""

import math
import struct
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.devices.rtde import packets
from protocol.devices.rtde.client import ANSWER_S, PLAY_S, TRIES
from protocol.devices.rtde.data_packet import EXPECTED, OUTPUT_NAMES
from protocol.devices.rtde.packets import HEADER, Kind, Text, Types
from protocol.devices.rtde.profile import ClientProfile
from protocol.devices.rtde.program import INPUT_NAMES
from protocol.devices.rtde.states import Runtime
from protocol.devices.rtde.wires import Piece, Port
from protocol.endpoint import Trouble
from protocol.geometry import Pose
from protocol.robot import ReportReceived
from tests.wire.rtde_talk import ANSWERS, FIRST, IN, LINES, NO_DASHBOARD, T0, Talk, data


def test_client_asks_dashboard_negotiates_uploads_and_streams() -> None:
    talk = Talk(ClientProfile())
    talk.hear(b"Connected: Universal Robots Dashboard Server\n", Port.DASHBOARD)
    requests = []
    while talk.sent and talk.sent[-1].port is Port.DASHBOARD:
        requests.append(talk.sent[-1].data.decode())
        talk.hear(LINES[requests[-1]].encode(), Port.DASHBOARD)
    assert requests == list(LINES)
    talk.sent = talk.sent[-1:]
    for answer in ANSWERS.values():
        talk.hear(answer)
    talk.hear(data(100.0, runtime=Runtime.STOPPED))
    talk.hear(b"whatever a script port says", Port.SCRIPT)
    talk.hear(data(100.002))
    assert not talk.reports
    talk.hear(data(100.004))
    assert talk.reports == [""]
    rtde = [piece.data for piece in talk.sent if piece.port is Port.RTDE]
    assert rtde[:4] == [
        packets.version_request(),
        packets.outputs_request(OUTPUT_NAMES, 500.0),
        packets.inputs_request(INPUT_NAMES),
        packets.encode(Kind.START),
    ]
    assert rtde[4:] == [IN.pack(*(0.0,) * 6, 0.002, 0.03, 2000.0, 0, FIRST)] * 3
    script = [number for number, piece in enumerate(talk.sent) if piece.port is Port.SCRIPT]
    assert len(script) == 1
    assert talk.sent[script[0] - 1].data == rtde[4], "a package that orders nothing goes before the program"


@pytest.mark.parametrize(
    ("force", "expected"),
    [
        ((1.5, -2.0, 12.5), (1.5, -2.0, 12.5)),
        ((0.0, 0.0, 0.0), None),
        ((0.0, math.nan, 1.0), None),
        ((math.inf, 0.0, 1.0), None),
    ],
)
def test_valid_arm_force_is_reported_and_invalid_one_is_not(
    force: tuple[float, ...], expected: tuple[float, ...] | None
) -> None:
    """`actual_TCP_force` follows the time stamp, the pose and the speed: big-endian, at index 13."""
    talk = Talk()
    for answer in (*ANSWERS.values(), data(100.0), data(100.002)):
        talk.hear(answer)
    raw = data(100.004)
    place = 3 + 1 + 13 * 8
    talk.client.receive((Piece(Port.RTDE, raw[:place] + struct.pack(">3d", *force) + raw[place + 24 :]),), T0)
    event = talk.client.next_event()
    assert isinstance(event, ReportReceived)
    assert event.report.force == expected


WRONG: list[tuple[Kind | None, bytes, str]] = [
    (Kind.VERSION, packets.accepted(Kind.VERSION, False), "version 2 of RTDE; update"),
    (Kind.VERSION, HEADER.pack(0, 0), "it does not speak RTDE"),
    (Kind.VERSION, packets.encode(Kind.VERSION, b"ab"), "it does not speak RTDE"),
    (
        Kind.OUTPUTS,
        packets.types_answer(Kind.OUTPUTS, Types(0, ("NOT_FOUND", *EXPECTED[OUTPUT_NAMES][1:]))),
        "its software has no timestamp; update it",
    ),
    (
        Kind.OUTPUTS,
        packets.types_answer(Kind.OUTPUTS, Types(1, ("DOUBLE",))),
        "it answers a request for 13 variables with 1 types and recipe 1",
    ),
    (
        Kind.OUTPUTS,  # as the fake server of the maker's client library answers: with the names
        packets.types_answer(Kind.OUTPUTS, Types(1, OUTPUT_NAMES)),
        "it reports timestamp as type 'timestamp', but the vendor's guide says DOUBLE",
    ),
    (Kind.OUTPUTS, packets.encode(Kind.OUTPUTS), "it does not speak RTDE"),
    (Kind.START, packets.accepted(Kind.START, False), "refuses to start its data"),
    (None, packets.encode(Kind.DATA, b"\x01ab"), "it does not speak RTDE"),
]


@pytest.mark.parametrize(("stage", "packet", "message"), WRONG)
def test_wrong_response_ends_it_in_one_line(stage: Kind | None, packet: bytes, message: str) -> None:
    talk = Talk()
    for kind, answer in ANSWERS.items():
        if kind is stage:
            break
        talk.hear(answer)
    talk.hear(packet)
    assert len(talk.lost) == 1
    assert message in talk.lost[0]
    assert "\n" not in talk.lost[0]
    count = len(talk.sent)
    talk.hear(data(100.0))
    assert len(talk.sent) == count, "it says nothing any more"
    assert talk.client.farewell() == ()
    talk.lost.clear()
    talk.wait(2.0)
    assert message in talk.lost[0], "told again, for those that began to wait later"


@pytest.mark.parametrize(
    ("stage", "message"),
    [
        (Kind.VERSION, "does not respond over RTDE"),
        (Kind.OUTPUTS, "does not respond over RTDE"),
        (Kind.INPUTS, "does not respond over RTDE"),
        (Kind.START, "does not start sending"),
        (Kind.DATA, "sends no data"),
    ],
)
def test_silence_is_reported_after_a_second(stage: Kind, message: str) -> None:
    talk = Talk().up_to(stage)
    talk.wait(ANSWER_S - 0.01)
    assert not talk.lost
    talk.wait(0.02)
    assert message in talk.lost[0]


def test_silent_dashboard_and_wrong_port_are_reported() -> None:
    talk = Talk(ClientProfile())
    talk.wait(2.0)
    assert "set dashboard_port to 0" in talk.lost[0]
    talk = Talk(ClientProfile())
    talk.hear(b"220 ready\n", Port.DASHBOARD)
    assert "no dashboard server" in talk.lost[0]
    talk = Talk(ClientProfile())
    talk.hear(b"Connected: x\nfalse\n", Port.DASHBOARD)
    assert "switch it to Remote Control" in talk.lost[0]
    talk.hear(b"more\n", Port.DASHBOARD)
    assert len(talk.lost) == 1


def test_registers_in_use_are_requested_a_few_times() -> None:
    talk = Talk().up_to(Kind.INPUTS)
    used = packets.types_answer(Kind.INPUTS, Types(0, ("IN_USE",) * 11))
    for _ in range(TRIES):
        assert not talk.lost
        talk.hear(used)
        talk.wait(0.25)
    assert "another client holds its input registers" in talk.lost[0]
    requests = [piece.data for piece in talk.sent].count(packets.inputs_request(INPUT_NAMES))
    assert requests == TRIES
    talk = Talk().up_to(Kind.INPUTS)
    talk.hear(used)
    talk.wait(0.25)
    talk.hear(ANSWERS[Kind.INPUTS])
    assert talk.sent[-1].data == packets.encode(Kind.START)


def test_program_that_is_not_playing_is_reported_with_the_reason() -> None:
    talk = Talk().up_to(Kind.DATA)
    stamp = 100.0
    while not talk.lost and talk.now < T0 + 10.0:
        talk.hear(data(stamp, runtime=Runtime.STOPPED))
        stamp += 0.1
        talk.now += 0.1
    assert talk.now == pytest.approx(T0 + PLAY_S, abs=0.3)
    assert "our program is stopped" in talk.lost[0]


def streaming() -> Talk:
    talk = Talk().up_to(Kind.DATA)
    for stamp in (100.0, 100.002):
        talk.hear(data(stamp))
    return talk


FAULTS: list[tuple[dict[str, float], str]] = [
    ({"safety": 0x4C0}, "emergency stop"),
    ({"safety": 0x500}, "safety violation or fault"),
    ({"safety": 0x404}, "protective stop"),
    ({"safety": 0x410}, "safeguard stop"),
    ({"safety": 0x008}, "recovery mode"),
    ({"safety": 0x000}, "stopped for safety"),
    ({"safety": 0x002}, ""),
    ({"mode": 5}, "in the mode 'idle'"),
    ({"mode": 44}, "in the mode '44'"),
    ({"runtime": 4}, "our program is paused"),
    ({"state": 4}, "no joints near the current ones reach"),
    ({"state": 5}, "our program has ended"),
    ({"state": 3}, ""),
    ({"scaling": 0.4}, "speed slider is at 40 %"),
    ({"scaling": math.nan}, "speed slider is at nan %"),
]


@pytest.mark.parametrize(("values", "message"), FAULTS)
def test_obstacles_to_motion_are_reported_with_a_remedy(values: dict[str, float], message: str) -> None:
    talk = streaming()
    talk.hear(data(100.004, **values))  # type: ignore[arg-type]
    assert message in talk.reports[-1]
    assert bool(message) == bool(talk.reports[-1])


def test_invalid_pose_does_not_hide_an_emergency_stop() -> None:
    talk = streaming()
    talk.hear(data(100.004, safety=0x4C0, pose=(math.nan,) * 6))
    assert "emergency stop" in talk.reports[-1]
    assert "; it reports " in talk.reports[-1]


def test_text_of_the_controller_is_handed_on() -> None:
    talk = streaming()
    talk.hear(packets.text(Text("hello", "CON", 2)))
    assert talk.notices == ["CON: hello"]


def test_numbers_follow_the_controller_clock_over_its_restart() -> None:
    talk = streaming()
    numbers = []
    for stamp in (100.004, 100.006, 100.012, 3.0, 3.002, math.nan, 3.006, 1e300):
        talk.client.receive((Piece(Port.RTDE, data(stamp)),), talk.now)
        event = talk.client.next_event()
        assert isinstance(event, ReportReceived)
        numbers.append(event.report.sequence)
    steps = [b - a for a, b in pairwise(numbers)]
    assert steps == [1, 3, 1, 1, 1, 2, 1_000_000]


def test_clock_beyond_all_numbers_is_survived() -> None:
    talk = streaming()
    talk.hear(data(1e308))
    assert not talk.lost
    assert not talk.reports[-1]
    again = Talk().up_to(Kind.DATA)
    again.hear(data(1e308))
    assert not again.lost


def test_movement_is_answered_and_ends_at_its_set_point() -> None:
    talk = streaming()
    client = talk.client
    pose = Pose((0.1, 0.2, 0.3), (1.0, 0.0, 0.0, 0.0))
    client.begin(pose)
    client.receive((Piece(Port.RTDE, data(100.004)),), talk.now)
    client.next_event()
    client.target(pose, talk.now)
    (piece,) = client.data_to_send(talk.now)
    assert piece.data == IN.pack(0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 0.002, 0.03, 2000.0, 1, FIRST + 1)
    client.end()
    talk.sent = []
    stamp = 100.004
    for _ in range(77):
        stamp += 0.002
        talk.hear(data(stamp, state=2, taken=IN.unpack(piece.data[3:])[10]))
        piece = talk.sent[-1]
    commands = [IN.unpack(piece.data[3:])[9:] for piece in talk.sent]
    assert commands == [*((1, FIRST + number) for number in range(2, 77)), *[(0, FIRST + 76)] * 2]
    goodbye = client.farewell()
    assert [IN.unpack(goodbye[0].data[3:])[9], goodbye[1].data] == [255, packets.encode(Kind.PAUSE)]


def test_program_that_accepts_no_targets_is_a_fault() -> None:
    talk = streaming()
    pose = Pose((0.1, 0.2, 0.3), (1.0, 0.0, 0.0, 0.0))
    talk.client.begin(pose)
    faults = []
    for number in range(60):
        talk.client.receive((Piece(Port.RTDE, data(100.004 + 0.002 * number, state=2)),), talk.now)
        event = talk.client.next_event()
        assert isinstance(event, ReportReceived)
        faults.append(str(Trouble(event.report.fault, event.report.remedy)))
        talk.client.target(pose, talk.now)
    assert [bool(fault) for fault in faults] == [False] * 51 + [True] * 9
    assert "check whether another client's program is playing" in faults[-1]


def test_state_left_by_an_older_program_is_ignored() -> None:
    talk = Talk().up_to(Kind.DATA)
    for number in range(20):
        talk.hear(data(100.0 + 0.002 * number, taken=FIRST - 7))
    assert not talk.reports
    talk.hear(data(100.04))
    talk.hear(data(100.042))
    assert talk.reports == [""]


def test_fault_in_a_movement_is_final_for_it() -> None:
    talk = streaming()
    client = talk.client
    pose = Pose((0.1, 0.2, 0.3), (1.0, 0.0, 0.0, 0.0))
    client.begin(pose)
    sent = []
    for safety in (0x404, 0x001):
        client.receive((Piece(Port.RTDE, data(100.004, safety=safety)),), talk.now)
        client.next_event()
        client.target(pose, talk.now)
        sent.append(IN.unpack(client.data_to_send(talk.now)[0].data[3:])[9])
    client.end()
    sent.append(IN.unpack(client.data_to_send(talk.now)[0].data[3:])[9])
    assert sent == [0, 0, 2]
    client.begin(pose)
    client.receive((Piece(Port.RTDE, data(100.01)),), talk.now)
    client.target(pose, talk.now)
    assert IN.unpack(client.data_to_send(talk.now)[0].data[3:])[9] == 1


def test_silence_ends_only_a_movement() -> None:
    talk = streaming()
    talk.wait(5.0)
    assert not talk.lost
    talk = streaming()
    talk.client.begin(Pose((0.1, 0.2, 0.3), (1.0, 0.0, 0.0, 0.0)))
    talk.wait(0.11)
    assert "nothing received for 100 ms" in talk.lost[0]


@pytest.mark.full
@given(
    st.lists(
        st.tuples(
            st.sampled_from(list(Port)),
            st.one_of(
                st.binary(max_size=60),
                st.sampled_from([*ANSWERS.values(), data(100.0), data(100.002), b"Connected: \n", b"true\n"]),
            ),
        ),
        max_size=20,
    ),
    st.booleans(),
)
@settings(max_examples=300)
def test_no_bytes_raise(pieces: list[tuple[Port, bytes]], dashboard: bool) -> None:
    talk = Talk(ClientProfile() if dashboard else NO_DASHBOARD)
    for port, raw in pieces:
        talk.hear(raw, port)
    talk.wait(1.5)
    assert len(talk.lost) <= 2 + len(pieces)


def test_pose_of_packet_read_late_is_as_much_older() -> None:
    talk = streaming()
    begin, ages = talk.now, []
    for stamp, late in (
        (100.010, 0.0),
        (100.012, 0.040),
        (100.014, 0.038),
        (100.2, 0.0),
        (3.0, 0.0),
        (3.002, 0.0),
    ):
        now = begin + (stamp - 100.0 if stamp > 50.0 else 0.3 + stamp - 3.0) + late
        talk.client.receive((Piece(Port.RTDE, data(stamp)),), now)
        event = talk.client.next_event()
        assert isinstance(event, ReportReceived)
        ages.append(now - event.report.pose_at - 0.002)
    assert ages == pytest.approx([0.0, 0.040, 0.038, 0.0, 0.0, 0.0], abs=3e-3), "a clock that jumps restarts"
