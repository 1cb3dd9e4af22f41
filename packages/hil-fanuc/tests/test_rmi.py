"""Remote Motion Interface of the emulated controller. Observed behaviour: airo-ugent/airo-fanuc,
docs/controller-notes.md.
"""

from typing import Any

import pytest
from fanuc_desk import START, T0, Desk, started
from hil_fanuc.packets import Kind
from hil_fanuc.profile import FanucProfile
from hil_fanuc.rmi import encode
from hil_fanuc.rmi_server import Connection, Door

from protocol.geometry import angles_of


def test_door_names_the_port_of_the_session() -> None:
    desk = Desk()
    for name in ("FRC_Connect", "FRC_Connect_STMO"):
        door = Door(desk.robot.interface)
        door.receive(f'{{"Communication": "{name}"}}\r\n'.encode(), T0)
        assert door.data_to_send(T0) == (
            b'{"Communication":"' + name.encode() + b'","ErrorID":0,"PortNumber":16002,'
            b'"MajorVersion":9,"MinorVersion":0}\r\n'
        )


@pytest.mark.parametrize(("disconnects", "free_s"), [(True, 2.7), (False, 0.2)])
def test_second_client_is_answered_once_the_first_has_left(disconnects: bool, free_s: float) -> None:
    desk = Desk()
    other = Connection(desk.robot.interface, desk.now)
    line = b'{"Command": "FRC_GetStatus"}\r\n'

    def answered() -> bool:
        other.receive(line, desk.now)
        desk.tick(10)
        other.handle_deadline(desk.now)
        return bool(other.data_to_send(desk.now))

    assert not answered()
    if disconnects:
        assert desk.ask({"Communication": "FRC_Disconnect"})["ErrorID"] == 0
        assert desk.session.closing
    left = desk.now
    desk.session.close(desk.now)
    desk.wait(max(free_s - 0.1, 0.0))
    assert not answered() or desk.now >= left + free_s
    desk.wait(0.2)
    assert answered()


def test_rmi_joints_and_position_are_those_of_the_pendant() -> None:
    desk = Desk()
    a, b, c, d, e, f = desk.robot.motion.joints
    answer = desk.ask({"Command": "FRC_ReadJointAngles"})["JointAngle"]
    assert list(answer.values())[:6] == [round(q, 3) for q in (a, b, c - b, d, e, f)]
    x, y, z = START.position
    r, p, w = angles_of(START.quaternion)
    position = desk.ask({"Command": "FRC_ReadCartesianPosition"})["Position"]
    expected = (1e3 * x, 1e3 * y, 1e3 * z - 245.0, w, p, r)
    assert list(position.values())[:6] == pytest.approx(expected, abs=1e-3)


def test_alarm_is_pushed_and_can_be_read() -> None:
    desk = started()
    desk.signal(Kind.START)
    desk.tick()
    assert {"Communication": "FRC_SystemFault", "SequenceID": 2} in desk.messages
    answer = desk.ask({"Command": "FRC_ReadError", "Count": 5})
    assert (answer["Count"], answer["ErrorData"]) == (1, "MOTN-607 Start packet without a stop packet")


@pytest.mark.parametrize(
    ("line", "error"),
    [
        (b"nonsense\r\n", 2556941),
        (b'{"Command": "FRC_Nothing"}\r\n', 2556941),
        (b"[1, 2]\r\n", 2556941),
        (b'{"Instruction": "FRC_Call", "SequenceID": 1, "ProgramName": "X"}\r\n', 2556981),
        (b'{"Instruction": "FRC_Call", "SequenceID": 3, "ProgramName": "STREAM_MOTN"}\r\n', 2556957),
        (b'{"Instruction": "FRC_Call", "SequenceID": 1, "ProgramName": "STREAM_MOTN"}\r\n', 2556937),
        (b'{"Instruction": "FRC_JointMotion", "SequenceID": 1}\r\n', 2556937),
        (b'{"Instruction": "FRC_SplineMotion", "SequenceID": 1}\r\n', 2556948),
    ],
)
def test_line_that_cannot_be_carried_out_is_refused(line: bytes, error: int) -> None:
    desk = Desk()
    desk.session.receive(line, desk.now)
    desk.wait(0.1)
    assert [message["ErrorID"] for message in desk.messages] == [error]


def test_call_with_a_number_that_was_used_is_dropped() -> None:
    desk = started()
    count = len(desk.messages)
    call = b'{"Instruction":"FRC_Call","SequenceID":1,"ProgramName":"STREAM_MOTN"}\r\n'
    desk.session.receive(call, desk.now)
    desk.wait(0.3)
    assert desk.messages[count:] == []


def test_idle_connection_is_ended_after_an_hour() -> None:
    desk = Desk(FanucProfile(rmi_idle_min=0.01))
    desk.wait(0.7)
    assert desk.messages == [{"Communication": "FRC_Terminate"}]
    assert desk.session.closing


def motion(number: int, name: str = "FRC_JointMotionJRep", **values: Any) -> dict[str, Any]:
    joints = {"J1": 10.0, "J5": -90.0}
    return {"Instruction": name, "SequenceID": number, "JointAngle": joints, "SpeedType": "Percent"} | values


@pytest.mark.parametrize(
    "wrong",
    [
        {"Speed": 0},
        {"Speed": "fast"},
        {"Speed": 10, "SpeedType": "mmSec"},
        {"Speed": 10, "JointAngle": {"J1": "far"}},
        {"Speed": 10, "JointAngle": {"J1": 1e300}},
        {"Speed": 10, "JointAngle": {"J1": 181.0}},
    ],
)
def test_motion_with_an_invalid_value_is_refused(wrong: dict[str, Any]) -> None:
    desk = Desk()
    desk.ask({"Command": "FRC_Initialize"})
    assert desk.ask(motion(1, **wrong))["ErrorID"] == 2556949
    assert desk.robot.motion.is_still


def test_motion_over_rmi_takes_its_share_of_the_speed() -> None:
    desk = Desk()
    desk.ask({"Command": "FRC_Initialize"})
    desk.ask({"Command": "FRC_SetOverRide", "Value": 50})
    desk.session.receive(encode(motion(1, Speed=20)), desk.now)
    fastest = 0.0
    while desk.messages[-1].get("SequenceID") != 1:
        desk.tick()
        fastest = max(fastest, max(map(abs, desk.robot.motion.speeds)))
    assert fastest == pytest.approx(0.2 * 0.5 * 180.0), "the speed of joint 3"
    assert desk.robot.motion.joints[0] == pytest.approx(10.0, abs=0.01)


def test_stop_ends_a_motion_over_rmi_without_an_answer() -> None:
    desk = Desk()
    desk.ask({"Command": "FRC_Initialize"})
    desk.session.receive(encode(motion(1, Speed=20)), desk.now)
    desk.wait(0.5)
    desk.inject("robot", "emergency-stop")
    desk.wait(3.0)
    assert desk.robot.motion.is_still
    assert not desk.robot.rmi_motions.is_busy
    assert [one for one in desk.messages if "Instruction" in one] == []
