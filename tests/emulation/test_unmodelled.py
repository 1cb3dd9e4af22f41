"""Tests that features a client uses and a device does not model are reported once, counted, and bounded."""

import numpy as np

from emulators.devices.ati_can import AtiCanBoard, AtiCanProfile
from emulators.devices.egm import EgmController, EgmProfile
from emulators.devices.ft300 import Ft300, Ft300Profile
from emulators.devices.jr3 import Gateway, GatewayProfile, Jr3Sensor, SensorProfile
from emulators.devices.netft import NetBox, NetFtProfile, answer
from emulators.devices.rsi import RsiController, RsiProfile
from emulators.devices.rtde import RtdeProfile, RtdeRobot
from emulators.devices.s3 import S3Controller, S3Profiles
from emulators.seams import StartPose
from emulators.sensing import KnownWrench
from emulators.unmodelled import KEPT, LONGEST, OTHERS, TaggingDevice, Unmodelled
from protocol.can.frame import CanFrame
from protocol.devices.jr3 import Op
from protocol.devices.rtde.packets import inputs_request, outputs_request, version_request
from protocol.devices.rtde.wires import Port
from protocol.unmodelled import NotModelled, describe_unmodelled

START = StartPose((0.9, -0.1, 0.6), (0.0, 1.0, 0.0, 0.0), 0.2)
T0 = 100.0


def followed(device: object) -> list[str]:
    """Return the features that a device reports from now on."""
    assert isinstance(device, TaggingDevice)
    reported: list[str] = []
    device.unmodelled.follow(lambda thing: reported.append(thing.thing))
    return reported


# --- the counter


def test_feature_is_reported_once_and_counted() -> None:
    used, reported = Unmodelled("rsi"), list[NotModelled]()
    used.touch("tag DiO", "read")
    used.follow(reported.append)
    for _ in range(3):
        used.touch("tag DiO", "read")
        used.touch("tag Tech.C1", "read")
    assert reported == [NotModelled("rsi", "tag DiO", "read"), NotModelled("rsi", "tag Tech.C1", "read")]
    assert used.counts == {"tag DiO": 4, "tag Tech.C1": 3}
    assert used.things == tuple(reported)


def test_untrusted_names_are_limited_and_printable() -> None:
    used, reported = Unmodelled("rtde"), list[NotModelled]()
    used.follow(reported.append)
    for number in range(10_000):
        used.touch(f"\x1b[2J{number}\n" + "x" * 500, "refused")
    assert len(reported) == len(used.counts) == KEPT + 1
    assert all(len(thing.thing) <= LONGEST and thing.thing.isprintable() for thing in reported)
    assert reported[-1].thing == OTHERS
    assert used.counts[OTHERS] == 10_000 - KEPT


def test_report_is_one_sentence() -> None:
    def things(count: int) -> list[NotModelled]:
        return [NotModelled("egm", f"field {number}", "dropped") for number in range(count)]

    assert describe_unmodelled([]) == ""
    assert (
        describe_unmodelled(things(1))
        == "your client relied on 1 thing that is not modelled: field 0 (dropped)"
    )
    assert describe_unmodelled(things(3)).startswith(
        "your client relied on 3 things that are not modelled: field 0 (dropped);"
    )
    assert describe_unmodelled(things(20)).endswith("field 7 (dropped); and 12 more")


# --- robots


def test_rsi_tags_without_channel_are_reported() -> None:
    """The answer of KUKA's own example server, and a text for the display."""
    robot = RsiController(RsiProfile(), START, T0)
    reported = followed(robot)
    robot.handle_deadline(T0)
    ipoc = robot.profile.ipoc_start
    document = (
        f'<Sen Type="{robot.profile.sentype}"><EStr>Message from RSI TestServer</EStr>'
        '<RKorr X="0.0" Y="0.0" Z="0.0" A="0.0" B="0.0" C="0.0" />'
        '<Tech T21="1.09" T22="2.08" /><DiO>125</DiO>'
        f"<IPOC>{ipoc}</IPOC></Sen>"
    )
    robot.receive([document.encode()], T0 + 1e-3)
    assert not robot.discarded
    assert reported == ["tag EStr", "tag Tech.T21", "tag Tech.T22", "tag DiO"]


def test_unsupported_egm_fields_are_reported() -> None:
    """A datagram by its bytes: header, external joints of the planned position, and data for RAPID."""
    robot = EgmController(EgmProfile(), START, T0, 7)
    reported = followed(robot)
    header = bytes.fromhex("0a 06 08 01 10 02 18 03")
    external = bytes.fromhex("12 0b 1a 09 09 00 00 00 00 00 00 24 40")
    rapid = bytes.fromhex("22 09 11 00 00 00 00 00 00 f0 3f")
    robot.receive([header + external + rapid], T0)
    assert robot.counters["messages"] == 1, robot.receiver.unusable
    assert reported == ["externalJoints", "RAPIDtoRobot.dnum"]


SCRIPT = b"""def gripper():
  # open_gripper(1) is no call
  set_tool_digital_out(0, True)
  close(width=30)
  def close(width):
    set_gravity([0, 0, 9])
    sleep(0.1)
    set_gravity([0, 0, 9])
  end
  set_gravity([0, 0, 9.82])
end
"""


def test_unsupported_rtde_features_are_reported() -> None:
    robot = RtdeRobot(RtdeProfile(), START, T0, 7)
    reported = followed(robot)
    rtde, script, dashboard = (robot.connect(port, T0) for port in (Port.RTDE, Port.SCRIPT, Port.DASHBOARD))
    assert rtde is not None
    assert script is not None
    assert dashboard is not None
    dashboard.receive(b"get variable x\nis it raining\nPolyscopeVersion\n", T0)
    assert reported == ["dashboard command get variable"]
    rtde.receive(inputs_request(("standard_digital_output", "input_int_register_0")), T0)
    rtde.receive(version_request(), T0)
    rtde.receive(outputs_request(("actual_q", "target_current", "actual_main_voltage"), 125.0), T0)
    assert reported[1:] == [
        "variable target_current",
        "variable actual_main_voltage",
    ]
    script.receive(b"sec light():\n  set_digital_out(1, True)\n  set_baselight_off()\nend\n", T0)
    assert reported[3:] == ["URScript set_baselight_off()"]
    script.receive(SCRIPT, T0)
    robot.controller.advance(T0 + 1.0)
    script.receive(b"def grips():\n  rg_grip(1)\nend\n", T0 + 1.0)
    assert reported[4:] == ["URScript set_gravity()", "URScript rg_grip()"]


def test_s3_functions_without_payload_are_reported() -> None:
    robot = S3Controller(S3Profiles(), START, T0, 7)
    reported = followed(robot)
    now = T0
    for data in ("05", "10 02 00 0A 01 00 06 01 00 00 00 05 10 03 0A", "04"):
        robot.receive(bytes.fromhex(data), now)
        robot.data_to_send(now)
        now += 0.1
    for _ in range(50):
        due = robot.next_deadline()
        if due is None or due > now:
            break
        robot.handle_deadline(due)
        robot.data_to_send(due)
    assert reported == ["function 6, read register"]


# --- sensors


def steady() -> KnownWrench:
    return KnownWrench(lambda times: np.zeros((len(times), 6)))


def test_unsupported_net_ft_requests_are_reported() -> None:
    box = NetBox(NetFtProfile(boot_s=0.0), steady(), T0, 7)
    reported = followed(box)
    box.receive([bytes.fromhex("1234 0004 00000000")], T0)
    page = answer(b"GET /setting.cgi?setuserfilter=2&mce0=1 HTTP/1.1\r\nHost: box\r\n\r\n", box, T0)
    assert page is not None
    assert reported == ["command 0x0004", "variable mce0 of /setting.cgi"]


def test_unsupported_ft300_registers_are_reported() -> None:
    sensor = Ft300(Ft300Profile(boot_s=0.0), steady(), T0, 7)
    reported = followed(sensor)
    for question in ("09 03 02 BC 00 01", "09 01 00 00 00 01"):
        sensor.receive(with_crc(bytes.fromhex(question)), T0 + 1.0)
    assert reported == ["register 700", "Modbus function 1"]


def with_crc(frame: bytes) -> bytes:
    """Modbus RTU's check, bit by bit."""
    crc = 0xFFFF
    for byte in frame:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return frame + crc.to_bytes(2, "little")


def test_ati_board_keeps_the_rate_of_its_bus() -> None:
    board = AtiCanBoard(AtiCanProfile(boot_s=0.0), steady(), T0, 7)
    reported = followed(board)
    board.receive([CanFrame(board.profile.base << 4 | 0xE, b"\x03")], T0)
    assert reported == ["operation set rate"]


def test_jr3_gateway_has_no_gripper() -> None:
    gateway = Gateway(GatewayProfile(boot_s=0.0), Jr3Sensor(SensorProfile(), steady(), 7), T0)
    reported = followed(gateway)
    gateway.receive([CanFrame(Op.GRIPPER + 2, bytes(4)), CanFrame(Op.GRIPPER + 1, bytes(4))], T0 + 1.0)
    assert reported == ["operation gripper"]
    assert gateway.unmodelled.counts == {"operation gripper": 1}
