"""Recorded sessions of compiled third-party drivers, replayed against our emulated devices and through our decoders.

Their sources were compiled outside of this project. The KUKA drivers, with stubs for ROS, move three axes in a sine of
10° about their start; some 60 cycles of each are kept. KUKA's own client library reads telegrams by the position of
each character, and ends with its stop. FZI's driver has a separate thread for the wire. Universal Robots' C++ client
library is called by programs of ours. Its own program for the controller is replaced by ours, which uses the same
messages. Their client in Python records seven samples with its own configuration. ABB's managers for a driver guide by
joints: axis 1 at 0.1 rad/s, ordered by a program of ours. What a driver read and sent is in its own output.
"""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from protocol.devices.egm import Guidance, RobotMessage, SensorMessage, decode_answer, decode_robot
from protocol.devices.rsi import axis_tags, decode, pose_tags
from protocol.devices.rtde import primary
from protocol.devices.rtde.fields import Recipe
from protocol.devices.rtde.packets import Kind, Reader, read_outputs_request, read_types
from protocol.devices.rtde.primary import MessageKind, PacketType, Part
from protocol.geometry import rotate, turn_by
from tools.client_transcripts import CLIENT, DEVICE, Stage, Step, Transcript, read, replayed
from tools.external_control import (
    SERVICES,
    Command,
    Forward,
    Mode,
    Motion,
    Result,
    Spline,
    read_commands,
    read_orders,
    read_points,
    read_results,
)

FOLDER = Path(__file__).with_name("drivers")
DRIVER = read(FOLDER / "rsi-kuka-experimental.txt")
SDK = read(FOLDER / "rsi-kuka-sdk.txt")
FZI = read(FOLDER / "rsi-fzi-driver.txt")
CONTROL = read(FOLDER / "rtde-ur-client-library.txt")
PRIMARY = read(FOLDER / "rtde-ur-client-library-primary.txt")
PYTHON = read(FOLDER / "rtde-ur-python-client.txt")
MANAGERS = read(FOLDER / "egm-abb-egm-rws-managers.txt")


@pytest.mark.parametrize("transcript", [DRIVER, SDK, FZI])
def test_emulated_kuka_repeats_every_byte_to_an_axis_driver(transcript: Transcript) -> None:
    assert replayed(transcript) == [step for step in transcript.steps if step.side == DEVICE]


def test_axes_are_read_and_understood_as_the_driver_does() -> None:
    reports = [decode(data) for data in DRIVER.made_by(DEVICE, "rsi")]
    answered = [decode(data) for data in DRIVER.made_by(CLIENT, "rsi")]
    assert [telegram.ipoc for telegram in answered] == [telegram.ipoc for telegram in reports]
    rows = zip(reports[1:], answered[1:], DRIVER.reads, DRIVER.sends, strict=True)
    for robot, client, values, corrections in rows:
        axes = [float(robot.values[tag]) for tag in axis_tags("AIPos")]
        assert axes == pytest.approx(values["positions_deg"], abs=1e-6)
        sent = [float(client.values[tag]) for tag in axis_tags("AK")]
        assert sent == pytest.approx(corrections["corrections_deg"], abs=2e-6)


def test_emulated_arm_follows_the_driver() -> None:
    reports = [decode(data) for data in DRIVER.made_by(DEVICE, "rsi")]
    start, end = (
        [float(telegram.values[tag]) for tag in axis_tags("AIPos")] for telegram in (reports[0], reports[-1])
    )
    behind = DRIVER.sends[-12]["corrections_deg"]
    motion = [there - here for there, here in zip(end, start, strict=True)]
    assert motion[:3] == pytest.approx(behind[:3], abs=0.15)
    assert min(map(abs, motion[:3])) > 2.0
    assert all(telegram.values["Delay.D"] == "0" for telegram in reports)


def telegrams(transcript: Transcript, side: str) -> dict[int, Mapping[str, str]]:
    """Return the values of one side's telegrams by their clock, read by our decoder."""
    result = [decode(data) for data in transcript.made_by(side, "rsi")]
    return {telegram.ipoc: telegram.values for telegram in result}


def values(telegram: Mapping[str, str], tags: Sequence[str]) -> list[float]:
    return [float(telegram[tag]) for tag in tags]


def test_vendor_library_reads_each_number_by_its_position() -> None:
    reports, answered = telegrams(SDK, DEVICE), telegrams(SDK, CLIENT)
    assert len(SDK.reads) == len(SDK.sends) == 60
    for row, sent in zip(SDK.reads, SDK.sends, strict=True):
        telegram, answer = reports[row["ipoc"]], answered[row["ipoc"]]
        assert values(telegram, axis_tags("AIPos")) == pytest.approx(row["positions_deg"], abs=1e-6)
        assert values(telegram, pose_tags("RIst")) == pytest.approx(row["pose"], abs=1e-6)
        assert int(telegram["Delay.D"]) == row["delay"] == 0
        assert values(answer, axis_tags("AK")) == pytest.approx(sent["corrections_deg"], abs=2e-6)


def test_vendor_library_stops_the_program_and_the_wire_is_silent() -> None:
    *before, (stopped_at, last) = telegrams(SDK, CLIENT).items()
    assert {answer["Stop"] for _, answer in before} == {"0"}
    assert last["Stop"] == "1"
    assert [clock - stopped_at for clock in telegrams(SDK, DEVICE) if clock > stopped_at] == [4, 8, 12]
    stage = Stage(SDK.head["device"], json.loads(SDK.head["settings"]))
    for step in SDK.steps:
        if step.side == CLIENT:
            list(stage.advance(step.now))
            list(stage.take(step))
    list(stage.advance(SDK.steps[-1].now))
    assert list(stage.advance(SDK.steps[-1].now + 1.0)) == []


def test_second_driver_reads_torques_states_and_axes_as_we_do() -> None:
    reports, answered = telegrams(FZI, DEVICE), telegrams(FZI, CLIENT)
    assert len(FZI.reads) > 30
    for row in FZI.reads:
        telegram = reports[row["ipoc"]]
        assert values(telegram, axis_tags("AIPos")) == pytest.approx(row["positions"], abs=1e-6)
        assert values(telegram, ["ProgStatus.R", "OvPro.R"]) == [row["status"], row["override"]] == [3, 100]
        assert int(telegram["Delay.D"]) == row["delay"] == 0
    ordered = [values(answer, axis_tags("AK")) for answer in answered.values()]
    largest = max(row["corrections_deg"][0] for row in FZI.sends)
    assert max(axes[0] for axes in ordered) == pytest.approx(largest, abs=1.0)
    assert all(axes[:3] == pytest.approx([axes[0], -axes[0], axes[0]], abs=2e-6) for axes in ordered)


# --- ABB's managers


def reported_joints(robot: RobotMessage) -> Sequence[float]:
    assert robot.feedback is not None
    assert robot.feedback.joints_deg is not None
    return robot.feedback.joints_deg


def joints_ordered(data: bytes) -> SensorMessage:
    answer = decode_answer(data)
    assert isinstance(answer, SensorMessage)
    return answer


def test_emulated_abb_repeats_every_byte_to_a_joint_driver() -> None:
    assert replayed(MANAGERS) == [step for step in MANAGERS.steps if step.side == DEVICE]


def test_abb_joints_are_decoded_as_by_its_managers() -> None:
    """The library answers the first message itself, with the joints reported to it."""
    reports = [decode_robot(data) for data in MANAGERS.made_by(DEVICE, "egm")]
    answered = [joints_ordered(data) for data in MANAGERS.made_by(CLIENT, "egm")]
    assert len(answered) == len(MANAGERS.reads) == len(MANAGERS.sends) == 24
    for robot, values in zip(reports[1:], MANAGERS.reads[1:], strict=False):
        assert (robot.seqno, robot.guidance) == (values["seqno"], Guidance.RUNNING)
        assert list(map(math.radians, reported_joints(robot))) == pytest.approx(
            values["joints_rad"], abs=1e-12
        )
    assert answered[0].joints_deg == pytest.approx(reported_joints(reports[0]), abs=1e-9)
    for answer, values in zip(answered[1:], MANAGERS.sends[1:], strict=True):
        assert list(map(math.radians, answer.joints_deg or ())) == pytest.approx(
            values["joints_rad"], abs=1e-12
        )
        speeds = list(map(math.radians, answer.joint_speed_deg_s or ()))
        assert speeds == pytest.approx(values["speeds_rad_s"], abs=1e-12)


def test_emulated_abb_follows_its_managers() -> None:
    joints = [reported_joints(decode_robot(data)) for data in MANAGERS.made_by(DEVICE, "egm")]
    assert all(after[0] >= before[0] for before, after in pairwise(joints))
    assert joints[-1][0] > joints[0][0] + 0.01
    assert joints[-1][1:] == pytest.approx(joints[0][1:], abs=0.05), "the loops act on the place of the tool"


# --- Universal Robots' C++ client library


TURNS = (
    ("CARTESIAN rx", "CARTESIAN ry", "CARTESIAN rz"),
    ("actual_TCP_pose 3", "actual_TCP_pose 4", "actual_TCP_pose 5"),
)


def turned_axes(values: dict[str, float]) -> dict[str, float]:
    """Return rotation vectors as the x and z axes that they rotate: a half turn has two vectors."""
    axes: dict[str, float] = {}
    for names in TURNS:
        if names[0] in values:
            x, y, z = (values.pop(name) for name in names)
            turn = turn_by((x, y, z))
            ends = *rotate(turn, (1.0, 0.0, 0.0)), *rotate(turn, (0.0, 0.0, 1.0))
            axes |= {f"{names[0]} turns {number}": end for number, end in enumerate(ends)}
    return axes


Reading = tuple[Step, dict[str, float]]
"""A step without its values, and the values by name."""


def readings(transcript: Transcript, steps: Sequence[Step]) -> list[Reading]:
    """Return the device's output, with its state numbers separate."""
    recipes: dict[str, Recipe] = {}
    requests = [step for step in transcript.steps if step.side == CLIENT and step.data[2:3] == b"O"]
    rows = []
    for step in steps:
        wire, rest, values = step.wire, b"", dict[str, float]()
        match wire.partition("-")[0]:
            case "rtde":
                reader = Reader()
                reader.feed(step.data)
                while (packet := reader.next_packet()) is not None:
                    if packet.kind == Kind.OUTPUTS:
                        types = read_types(packet.payload)
                        request = next(step for step in requests if step.wire == wire)
                        requests.remove(request)
                        names = read_outputs_request(request.data[3:])[1]
                        recipes[wire] = Recipe(types.recipe, names, types.types)
                    if packet.kind == Kind.DATA:
                        numbers = recipes[wire].values(recipes[wire].unpack(packet.payload))
                        for name, value in numbers.items():
                            parts = value if isinstance(value, tuple) else (value,)
                            values |= {f"{name} {axis}": part for axis, part in enumerate(parts)}
                    else:
                        rest += packet.payload
            case "primary":
                for kind, body in primary.split(step.data):
                    if kind == PacketType.STATE:
                        for part, data in primary.split(body):
                            row = primary.PARTS[Part(part)].unpack(data)
                            values |= {f"{Part(part).name} {name}": value for name, value in row.items()}
                    else:
                        rest += body
            case _:
                rest = step.data
        rows.append((step._replace(data=rest), values | turned_axes(values)))
    return rows


NOISE = (
    ("actual_TCP_force", 16.0),
    ("FORCE_MODE", 16.0),
    ("accelerometer", 1.0),
    ("current", 0.4),
    ("JOINTS i", 0.4),
    ("_qd", 0.02),
    ("JOINTS qd", 0.02),
    ("TCP_speed", 0.02),
)
"""How far a measured value may be off the recorded one by its noise. When the transcripts were made, the offset of the
own force lay along the base, and the payload that a client sets did not act on it.
"""
NEAR = 2e-3
"""The same for all other values, which a joint moves in one cycle."""


def is_near(name: str, value: float, recorded: float) -> bool:
    """Return whether a value equals the recorded one, within its noise and one cycle."""
    return abs(value - recorded) <= next((apart for part, apart in NOISE if part in name), NEAR)


@pytest.mark.parametrize("transcript", [CONTROL, PRIMARY, PYTHON])
def test_emulated_controller_repeats_its_bytes_to_the_library(transcript: Transcript) -> None:
    """Byte for byte, except for measured values: its joints had no noise then, and were at their targets."""
    recorded = readings(transcript, [step for step in transcript.steps if step.side == DEVICE])
    again = readings(transcript, replayed(transcript))
    assert [step for step, _ in again] == [step for step, _ in recorded]
    for (_, values), (_, before) in zip(again, recorded, strict=True):
        assert values.keys() == before.keys()
        off = {
            name: (value, before[name])
            for name, value in values.items()
            if not is_near(name, value, before[name])
        }
        assert not off


def joined(transcript: Transcript, side: str, wire: str) -> bytes:
    return b"".join(transcript.made_by(side, wire))


def test_each_service_of_the_client_is_connected_to_in_its_order() -> None:
    opened = [
        step.wire.partition("-")[0] for step in CONTROL.steps if (step.side, step.event) == (DEVICE, "opens")
    ]
    assert opened == [name for name in SERVICES.values() if name != "sender"]
    text = joined(CONTROL, CLIENT, "primary")
    assert text == b"stop program\ndef externalControl():\n# 127.0.0.1\nend\n", "its own program is not kept"


def test_orders_of_the_client_library_are_decoded_as_sent() -> None:
    orders = list(read_orders(joined(CONTROL, CLIENT, "reverse")))
    sent = [
        (key, values) for row in CONTROL.sends for key, values in row.items() if key[:5] in ("servo", "speed")
    ]
    modes = {"servoj": Mode.SERVOJ, "speedj": Mode.SPEEDJ, "speedl": Mode.SPEEDL}
    assert [(order.mode, order.timeout_ms) for order in orders[:7]] == [(modes[key], 200) for key, _ in sent]
    for order, (_, values) in zip(orders, sent, strict=False):
        assert [value / 1e6 for value in order.values] == pytest.approx(values, abs=1e-6)
    rest = [(order.mode, order.values[0]) for order in orders[7:]]
    starts = 3 * [(Mode.FORWARD, Forward.START)]
    assert rest == [(Mode.IDLE, 0), *starts, (Mode.FORWARD, Forward.CANCEL), (Mode.STOPPED, 0)]


def test_points_of_the_client_library_are_decoded_with_results() -> None:
    points = list(read_points(joined(CONTROL, CLIENT, "trajectory")))
    assert [(point.kind, point.time) for point in points] == [
        (Motion.MOVEJ, 0.2),
        (Motion.SPLINE, 0.2),
        (Motion.MOVEJ, 3.0),
    ]
    assert points[1].blend == Spline.CUBIC
    assert points[0].rest[:2] == (1.04, 1.4), "speed and acceleration, the library's defaults"
    ends = [next(iter(row.values())) for row in CONTROL.sends[7:]]
    for point, end in zip(points, ends, strict=True):
        assert point.target == pytest.approx(end, abs=1e-6)
    results = read_results(joined(CONTROL, DEVICE, "trajectory"))
    assert results == [Result.SUCCESS, Result.SUCCESS, Result.CANCELLED]
    assert results == [row["result"] for row in CONTROL.reads if "result" in row]


def test_commands_of_the_client_library_are_read() -> None:
    commands = dict(read_commands(joined(CONTROL, CLIENT, "commands")))
    assert list(commands) == [
        Command.ZERO_FTSENSOR,
        Command.SET_PAYLOAD,
        Command.SET_TCP_OFFSET,
        Command.START_FORCE_MODE,
        Command.END_FORCE_MODE,
        Command.START_TOOL_CONTACT,
        Command.END_TOOL_CONTACT,
    ]
    assert commands[Command.SET_PAYLOAD][:4] == (1.25, 0.0, 0.01, 0.05)
    assert commands[Command.SET_TCP_OFFSET][:6] == (0.0, 0.0, 0.2, 0.0, 0.0, 0.0), "the second of two"
    axes, wrench, kind, limits = (
        commands[Command.START_FORCE_MODE][a:b] for a, b in ((6, 12), (12, 18), (18, 19), (19, 25))
    )
    assert (axes, wrench) == ((0.0, 0.0, 1.0, 0.0, 0.0, 0.0), (0.0, 0.0, -5.0, 0.0, 0.0, 0.0))
    assert (kind, limits) == ((2.0,), (0.01, 0.01, 0.01, 0.1, 0.1, 0.1))
    assert read_results(joined(CONTROL, DEVICE, "commands")) == [Result.CANCELLED]
    assert {"contact": Result.CANCELLED} in CONTROL.reads


def rows_of(transcript: Transcript) -> tuple[tuple[str, ...], list[dict[str, Any]]]:
    """Return the names of the requested outputs, and their values in each package, read by our decoders."""
    reader = Reader()
    names: tuple[str, ...] = ()
    rows = []
    for step in transcript.steps:
        if not step.wire.startswith("rtde"):
            continue
        reader.feed(step.data)
        while (packet := reader.next_packet()) is not None:
            if packet.kind == Kind.OUTPUTS and step.side == CLIENT:
                _, names = read_outputs_request(packet.payload)
            elif packet.kind == Kind.OUTPUTS:
                types = read_types(packet.payload)
                recipe = Recipe(types.recipe, names, types.types)
            elif packet.kind == Kind.DATA and step.side == DEVICE:
                rows.append(recipe.values(recipe.unpack(packet.payload)))
    return names, rows


def test_python_client_reads_its_configured_outputs_as_we_do() -> None:
    names, rows = rows_of(PYTHON)
    assert len(names) == 32
    assert len(PYTHON.reads) == 7
    for read_row, row in zip(PYTHON.reads, rows, strict=False):
        ours = {
            "timestamp": row["timestamp"],
            "robot_mode": row["robot_mode"],
            "actual_q_0": row["actual_q"][0],
        }
        ours |= {f"actual_TCP_pose_{k}": row["actual_TCP_pose"][k] for k in (0, 2)}
        assert read_row == pytest.approx(ours, abs=1e-9)


def test_client_library_reads_joints_and_dashboard_as_we_do() -> None:
    names, rows = rows_of(CONTROL)
    assert names == ("timestamp", "actual_q")
    for values in (row["actual_q"] for row in CONTROL.reads if "actual_q" in row):
        assert tuple(values) in [row["actual_q"] for row in rows]
    output = joined(CONTROL, DEVICE, "dashboard").decode().splitlines()
    assert list(CONTROL.reads[0].values()) == output[2:]


def packets_of(transcript: Transcript) -> Iterator[tuple[int, bytes]]:
    return primary.split(joined(transcript, DEVICE, "primary"))


def test_client_library_reads_complete_primary_states() -> None:
    states = [dict(primary.split(body)) for kind, body in packets_of(PRIMARY) if kind == PacketType.STATE]
    assert all(list(state) == list(primary.PARTS) for state in states)
    first = primary.CONFIGURATION.unpack(states[0][Part.CONFIGURATION])
    assert first["robot_type"] == PRIMARY.reads[0]["type"]
    modes = [primary.ROBOT_MODE.unpack(state[Part.ROBOT_MODE])["robot_mode"] for state in states]
    assert (modes[0], modes[-1]) == (PRIMARY.reads[0]["mode"], PRIMARY.reads[-1]["mode"])


def test_client_library_reads_primary_messages() -> None:
    messages = [
        primary.read_message(body) for kind, body in packets_of(PRIMARY) if kind == PacketType.MESSAGE
    ]
    bodies = {message.kind: message.body for message in messages}
    assert messages[0].kind == MessageKind.VERSION
    assert PRIMARY.reads[0]["version"] == "5.12.0.0"
    assert bodies[MessageKind.TEXT] == b"hello 7"
    failure = bodies[MessageKind.RUNTIME_EXCEPTION]
    assert failure == primary.runtime_exception_body(2, 1, "no joints hold this pose")
    assert "no joints hold this pose" in PRIMARY.reads[1]["exception"]
    code, level = PRIMARY.reads[2]["codes"][0][0], PRIMARY.reads[2]["codes"][0][2]
    assert bodies[MessageKind.ERROR_CODE].startswith(primary.error_body(code, 0, primary.ReportLevel(level)))
    modes = [message.body[8] for message in messages if message.kind == MessageKind.SAFETY_MODE]
    assert modes == [PRIMARY.reads[2]["safety"], PRIMARY.reads[3]["safety"]]


def test_unexpected_library_byte_is_detected() -> None:
    spoilt = [
        step._replace(data=step.data[:-1] + b"\2") if step.wire.startswith("reverse") and step.data else step
        for step in CONTROL.steps
    ]
    again = replayed(Transcript(CONTROL.head, spoilt))
    assert again != [step for step in CONTROL.steps if step.side == DEVICE]
    assert json.loads(CONTROL.head["settings"]) == {"power_s": 0.3}
