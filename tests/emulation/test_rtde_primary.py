"""Tests of the primary interface of an emulated controller: messages and their times; local control; silent clients."""

import math
from collections.abc import Iterator
from typing import Any

import pytest

from emulators.devices.rtde import RTDE_FAULTS, RtdeProfile, RtdeRobot, Server
from emulators.devices.rtde.state import getter
from emulators.faults import Ledger
from emulators.seams import StartPose
from protocol.devices.rtde import primary
from protocol.devices.rtde.fields import NOT_FOUND, OUTPUTS, type_of
from protocol.devices.rtde.primary import MessageKind, PacketType, Part
from protocol.devices.rtde.states import SafetyMode
from protocol.devices.rtde.wires import Port

T0 = 1000.0
START = StartPose((0.9, -0.1, 0.6), (0.0, 1.0, 0.0, 0.0), 0.2)


class Client:
    """Connection to a port of a robot, and everything received over it."""

    def __init__(self, robot: RtdeRobot, now: float = T0, port: Port = Port.PRIMARY) -> None:
        server = robot.connect(port, now)
        assert server is not None
        self.robot, self.server, self.now = robot, server, now
        self.raw = b""

    def wait(self, seconds: float) -> "Client":
        end = self.now + seconds
        while (due := self.server.next_deadline()) is not None and due <= end:
            self.now = max(self.now, due)
            self.server.handle_deadline(self.now)
            self.raw += self.server.data_to_send(self.now)
        self.now = end
        self.raw += self.server.data_to_send(end)
        return self

    def send(self, text: str) -> None:
        self.server.receive(text.encode(), self.now)
        self.raw += self.server.data_to_send(self.now)

    def messages(self, kind: MessageKind) -> list[primary.Message]:
        result = [
            primary.read_message(body)
            for type_, body in primary.split(self.raw)
            if type_ == PacketType.MESSAGE
        ]
        return [message for message in result if message.kind == kind]

    @property
    def states(self) -> list[dict[Part, dict[str, Any]]]:
        return [dict(parts(body)) for type_, body in primary.split(self.raw) if type_ == PacketType.STATE]

    def keys(self) -> list[bytes]:
        return [message.body[9:] for message in self.messages(MessageKind.KEY)]


def parts(body: bytes) -> Iterator[tuple[Part, dict[str, Any]]]:
    for kind, data in primary.split(body):
        part = Part(kind)
        assert len(data) == primary.PARTS[part].size
        yield part, primary.PARTS[part].unpack(data)


def robot(**profile: Any) -> RtdeRobot:
    return RtdeRobot(RtdeProfile(**profile), START, T0, 7)


def test_version_precedes_ten_states_per_second() -> None:
    client = Client(robot())
    client.raw += client.server.data_to_send(T0)
    (version,) = client.messages(MessageKind.VERSION)
    assert version.body[:12] == b"\x09URControl\x05\x0c"
    assert client.states == []
    client.wait(1.05)
    assert len(client.states) == 11
    assert [*client.states[0]] == list(primary.PARTS)


def test_late_process_skips_missed_states() -> None:
    client = Client(robot()).wait(0.05)
    client.now += 1.0
    client.wait(0.0)
    assert len(client.states) == 2


def test_state_matches_model() -> None:
    ur = robot()
    ur.controller.io.slider = 0.4
    ur.controller.io.write_output("actual_digital_output_bits", 5)
    state = Client(ur).wait(0.2).states[-1]
    mode, joints, place = state[Part.ROBOT_MODE], state[Part.JOINTS], state[Part.CARTESIAN]
    assert (mode["robot_mode"], mode["powered"], mode["running"], mode["speed_scaling"]) == (7, 1, 0, 0.4)
    assert [joints[f"q{n}"] for n in range(6)] == pytest.approx(ur.controller.arm.joints, abs=1e-4)
    assert [joints[f"mode{n}"] for n in range(6)] == [253] * 6
    assert [place[axis] for axis in "xyz"] == pytest.approx(START.position, abs=1e-4)
    assert [place[f"tcp_{axis}"] for axis in "xyz"] == pytest.approx((0.0, 0.0, 0.2))
    assert state[Part.MASTERBOARD]["digital_outputs"] == 5
    assert state[Part.MASTERBOARD]["safety_mode"] == SafetyMode.NORMAL
    assert [state[Part.KINEMATICS][f"a{n}"] for n in range(6)] == [0.0, -0.6127, -0.57155, 0.0, 0.0, 0.0]
    assert state[Part.CONFIGURATION]["d5"] == 0.11655
    assert state[Part.CONFIGURATION]["robot_type"] == 2


def test_check_sum_depends_on_model() -> None:
    def sums(ur: RtdeRobot) -> list[float]:
        kinematics = Client(ur).wait(0.1).states[-1][Part.KINEMATICS]
        return [kinematics[f"checksum{n}"] for n in range(6)]

    assert sums(robot()) == sums(robot())
    assert sums(robot()) != sums(robot(model="ur10"))


def test_program_start_and_end_are_sent_to_each_client() -> None:
    ur = robot()
    first, second = Client(ur), Client(ur)
    first.send('def hello():\n  textmsg("it is ", 3)\n  sleep(0.2)\nend\n')
    first.wait(0.5)
    second.wait(0.5)
    for client in (first, second):
        assert client.keys() == [b"PROGRAM_XXX_STARTEDhello", b"PROGRAM_XXX_STOPPEDhello"]
        assert [message.body for message in client.messages(MessageKind.TEXT)] == [b"it is 3"]
    begun = first.messages(MessageKind.KEY)[0]
    assert begun.time_ns == pytest.approx((100.0 + 0.05) * 1e9, abs=5e6), "by the controller's clock"


def test_error_has_line_and_precedes_end_of_program() -> None:
    client = Client(robot())
    client.send("def wrong():\n  sleep(0.1)\n  a = [1, 2]\n  b = a[7]\nend\n")
    client.wait(1.0)
    (error,) = client.messages(MessageKind.RUNTIME_EXCEPTION)
    assert error.body[:8] == b"\0\0\0\4\0\0\0\1"
    assert client.keys()[-1] == b"PROGRAM_XXX_STOPPEDwrong"
    client.send("def odd(:\nend\n")
    assert len(client.messages(MessageKind.RUNTIME_EXCEPTION)) == 2


def test_unknown_name_has_line_and_column() -> None:
    """As a test of Universal Robots' C++ client library expects."""
    client = Client(robot())
    client.send("def wrong():\n  sleep(0.1)\n  if True:\n    nothing_such()\n  end\nend\n")
    client.wait(0.5)
    (error,) = client.messages(MessageKind.RUNTIME_EXCEPTION)
    assert error.body == b"\0\0\0\4\0\0\0\5compile_error_name_not_found:nothing_such:"


def test_pop_up_has_title_and_text() -> None:
    client = Client(robot())
    client.send('def asks():\n  popup("wait", title="Careful")\nend\n')
    client.wait(0.3)
    (popup,) = client.messages(MessageKind.POPUP)
    assert popup.body[8:] == b"\x07Carefulwait"


def test_each_safety_mode_is_reported_once() -> None:
    ur = robot()
    client = Client(ur).wait(0.1)
    ur.controller.protective_stop("a test")
    client.wait(0.3)
    ur.controller.emergency_stop()
    client.wait(0.3)
    modes = [message.body[8] for message in client.messages(MessageKind.SAFETY_MODE)]
    assert modes == [SafetyMode.PROTECTIVE_STOP, SafetyMode.ROBOT_EMERGENCY_STOP]
    assert [message.body[:4] for message in client.messages(MessageKind.ERROR_CODE)] == [bytes(4)]
    kinds = [body[9] if type_ == PacketType.MESSAGE else 0 for type_, body in primary.split(client.raw)]
    stopped = kinds.index(MessageKind.SAFETY_MODE)
    states = [
        dict(parts(body))
        for type_, body in list(primary.split(client.raw))[:stopped]
        if type_ == PacketType.STATE
    ]
    assert states[-1][Part.ROBOT_MODE]["protective_stopped"] == 1, "the state is told before the message"
    assert client.states[-1][Part.ROBOT_MODE]["emergency_stopped"] == 1
    assert client.states[-1][Part.ROBOT_MODE]["powered"] == 0


@pytest.mark.parametrize(("port", "remote"), [(Port.READ_ONLY, True), (Port.PRIMARY, False)])
def test_text_to_read_only_interface_is_an_error(port: Port, remote: bool) -> None:
    ur = robot(remote_control=remote)
    client = Client(ur, port=port)
    ur.controller.state.remote = True
    client.send("def moves():\n  sleep(9)\nend\n")
    client.wait(0.5)
    assert [message.body[:4] for message in client.messages(MessageKind.ERROR_CODE)] == [b"\0\0\0\xd2"]
    assert client.keys() == []
    fresh = Client(ur, client.now)
    fresh.send("def moves():\n  sleep(9)\nend\n")
    fresh.wait(0.2)
    assert fresh.keys() == [b"PROGRAM_XXX_STARTEDmoves"], "one that came in remote control may"


def test_silent_interface_resumes_afterwards() -> None:
    ur = robot()
    ledger = Ledger(RTDE_FAULTS)
    ledger.attach("robot", ur.handlers["robot"])
    client = Client(ur).wait(0.05)
    reported = client.raw
    injection = ledger.inject("robot", "primary-silent", T0 + 0.05, {"for_s": 0.5})
    client.send("def moves():\n  sleep(9)\nend\n")
    client.wait(0.45)
    assert client.raw == reported
    assert injection.struck > 0
    ledger.handle_deadline(client.wait(0.2).now)
    client.wait(0.2)
    assert len(client.states) > 1
    assert client.keys() == [], "what it would have said is lost"


@pytest.mark.parametrize(
    ("statement", "code"),
    [("protective_stop()", 209), ("movel(p[9, 9, 9, 0, 0, 0])", 0), ("servoj([0, 0, 0, 0, 0, 0])", 204)],
)
def test_protective_stop_has_code_of_reason(statement: str, code: int) -> None:
    client = Client(robot())
    client.send(f"{statement}\n")
    client.wait(8.0)
    (error,) = client.messages(MessageKind.ERROR_CODE)
    assert int.from_bytes(error.body[:4], "big") == code
    assert error.body[8:12] == b"\0\0\0\2", "a warning"


def test_disconnected_client_receives_nothing() -> None:
    ur = robot()
    client = Client(ur)
    ur.leave(Port.PRIMARY, client.server, T0)
    assert ur.controller.console.listeners == []
    ur.controller.protective_stop("a test")
    assert isinstance(client.server, Server)


# --- outputs over RTDE


def test_outputs_are_set_according_to_masks() -> None:
    ur = robot()
    controller = ur.controller

    def write(**values: float) -> None:
        controller.write_inputs(tuple(values), values)
        controller.advance(controller.now + controller.period)

    def read(name: str) -> float:
        return getter(name)(controller.snapshots[-1])[0]

    write(standard_digital_output_mask=0b11, standard_digital_output=0b101)
    assert read("actual_digital_output_bits") == 0b001
    write(configurable_digital_output_mask=1, configurable_digital_output=1)
    write(tool_digital_output_mask=2, tool_digital_output=2)
    assert read("actual_digital_output_bits") == 0b10_00000001_00000001
    assert read("actual_configurable_digital_output_bits") == 1
    assert (read("standard_analog_output0"), read("analog_io_types")) == (0.004, 0)
    write(standard_analog_output_mask=3, standard_analog_output_type=2, standard_analog_output_0=0.5)
    assert (read("standard_analog_output0"), read("standard_analog_output1")) == pytest.approx((0.012, 0.0))
    write(standard_analog_output_1=0.25)
    assert read("standard_analog_output1") == 0.0, "without its mask in the package nothing is set"
    write(standard_analog_output_mask=2, standard_analog_output_1=0.25)
    assert (read("standard_analog_output0"), read("standard_analog_output1")) == pytest.approx((0.012, 2.5))
    assert read("analog_io_types") == 0b1000
    write(standard_analog_output_mask=1, standard_analog_output_0=math.nan)
    assert read("standard_analog_output0") == pytest.approx(0.012)
    board = Client(ur, controller.now).wait(0.2).states[-1][Part.MASTERBOARD]
    assert (board["output_domain0"], board["output_domain1"], board["output1"]) == (0, 1, 2.5)


@pytest.mark.parametrize(
    ("version", "there", "missing"),
    [
        ((5, 12, 0), ("tool_output_mode", "ft_raw_wrench", "elbow_position"), ("collision_detection_ratio",)),
        ((5, 15, 0), ("collision_detection_ratio",), ("time_scale_source",)),
        ((5, 4, 0), ("safety_status",), ("tcp_offset", "ft_raw_wrench")),
        (
            (3, 15, 8),
            ("tcp_offset", "payload", "safety_status", "payload_inertia"),
            ("ft_raw_wrench", "tool_output_mode"),
        ),
        ((3, 12, 2), ("safety_status",), ("tcp_offset", "payload")),
    ],
)
def test_outputs_depend_on_controller_version(
    version: tuple[int, int, int], there: tuple[str, ...], missing: tuple[str, ...]
) -> None:
    assert [name for name in there if type_of(OUTPUTS, name, version) == NOT_FOUND] == []
    assert [name for name in missing if type_of(OUTPUTS, name, version) != NOT_FOUND] == []


@pytest.mark.parametrize(
    ("version", "mode", "cartesian", "board", "count"),
    [
        ("3.0.0.0", 38, 53, 72, 7),
        ("3.1.0.0", 38, 53, 72, 7),
        ("3.2.0.0", 46, 101, 74, 9),
        ("3.4.0.0", 46, 101, 74, 9),
        ("3.5.0.0", 47, 101, 75, 9),
        ("5.0.0.0", 47, 101, 75, 9),
    ],
)
def test_state_sizes_match_version(version: str, mode: int, cartesian: int, board: int, count: int) -> None:
    """Source: python-urx's reader, and the static checks of ur_modern_driver."""
    client = Client(robot(version=version, model="ur10" if version[0] == "3" else "ur10e"))
    client.wait(0.1)
    states = [body for kind, body in primary.split(client.raw) if kind == PacketType.STATE]
    sizes = {kind: len(body) + primary.HEADER.size for kind, body in primary.split(states[-1])}
    assert [sizes[part] for part in (Part.ROBOT_MODE, Part.CARTESIAN, Part.MASTERBOARD)] == [
        mode,
        cartesian,
        board,
    ]
    assert len(sizes) == count


@pytest.mark.parametrize("port", [Port.SECONDARY, Port.SECONDARY_READ_ONLY])
def test_secondary_interface_sends_version_and_states_only(port: Port) -> None:
    ur = robot()
    client, speaker = Client(ur, port=port), Client(ur)
    speaker.send('def hello():\n  textmsg("it")\n  popup("it")\n  x = 1 / 0\nend\n')
    ur.controller.protective_stop("a test")
    client.wait(0.5)
    kinds = [kind for kind, _ in primary.split(client.raw)]
    assert kinds[0] == PacketType.MESSAGE
    assert set(kinds[1:]) == {PacketType.STATE}
    assert len(client.messages(MessageKind.VERSION)) == 1
