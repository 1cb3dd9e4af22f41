"""Client of the bridge with the emulated controller."""

import math
from typing import Any, TypeGuard

import pytest
from fanuc_desk import START, Pair
from hil_fanuc import rmi_commands
from hil_fanuc.channels import Channel, Ended, OpenSession, Piece
from hil_fanuc.packets import (
    JOINTS,
    Command,
    Kind,
    Signal,
    decode_to_robot,
    header_of,
)
from hil_fanuc.profile import FanucProfile
from hil_fanuc.rmi import LineReader, ProgramStatus, name_of
from hil_fanuc.settings import FanucSettings

import hil_bridge
from protocol.geometry import Pose, product, turn_about
from protocol.robot import StreamLost, StreamNotice

NEAR = {"start_position_mm": [900.0, -100.0, 593.0]}
HOME = Pose(START.position, START.quaternion)


def started(profile: FanucProfile | None = None, settings: FanucSettings | None = None) -> Pair:
    pair = Pair(profile, settings)
    pair.run(3.0)
    assert pair.reports
    assert pair.reports[-1].fault == ""
    return pair


def lost(pair: Pair) -> str:
    """Return the reason of a start that failed."""
    pair.run(8.0)
    assert pair.reports == []
    return next(f"{event.text}; {event.remedy}" for event in pair.events if isinstance(event, StreamLost))


def commands(pair: Pair) -> list[Command]:
    packets = (decode_to_robot(piece.data) for piece in pair.sent if _is_stream(piece))
    return [packet for packet in packets if isinstance(packet, Command)]


def _is_stream(piece: Any) -> TypeGuard[Piece]:
    return isinstance(piece, Piece) and piece.channel is Channel.STREAM


def steer(pair: Pair, offset_mm: tuple[float, float, float], seconds: float, turn_deg: float = 0.0) -> None:
    """Move the tool to a place near its start at a constant speed."""
    steps = round(seconds / 0.008)
    start = pair.goal or HOME
    for k in range(1, steps + 1):
        share = k / steps
        x, y, z = (
            a + share * (b + o / 1e3 - a)
            for a, b, o in zip(start.position, HOME.position, offset_mm, strict=True)
        )
        turn = turn_about((0.0, 1.0, 0.0), math.radians(share * turn_deg))
        pair.goal = Pose((x, y, z), product(turn, HOME.quaternion))
        pair.run(0.008)


def test_start_has_the_order_of_the_makers_client() -> None:
    pair = started()
    steps: list[str] = []
    reader = LineReader()
    for piece in pair.sent:
        if isinstance(piece, OpenSession):
            step = f"open {piece.port}"
        elif piece.channel is Channel.STREAM:
            step = Kind(header_of(piece.data).kind).name
        else:
            step = " ".join(name_of(line).name for line in reader.feed(piece.data))
        if not steps or steps[-1] != step:
            steps.append(step)
    assert steps == [
        *(
            "FRC_Connect_STMO",
            "open 16002",
            "FRC_GetStatus",
            "FRC_ReadJointAngles",
            "FRC_ReadCartesianPosition",
            "FRC_ReadUToolData",
            "STOP",
            "GET_CAPABILITY",
            "THRESHOLD",
            "SET_CAPABILITY",
        ),
        *(
            "FRC_Abort",
            "FRC_Reset",
            "FRC_Initialize",
            "FRC_GetStatus",
            "GPIO",
            "FRC_Call",
            "START",
            "COMMAND",
        ),
    ]
    assert sum(header_of(p.data).kind == Kind.THRESHOLD for p in pair.sent if _is_stream(p)) == 27


def test_commands_contain_joints_and_answer_each_report() -> None:
    pair = started()
    pair.client.begin(pair.reports[-1].pose)
    steer(pair, (10.0, 0.0, -5.0), 1.0)
    sent = commands(pair)
    assert {command.data_style for command in sent} == {JOINTS}
    assert [command.sequence for command in sent] == list(range(1, len(sent) + 1))
    is_moving = [command.moves for command in sent]
    assert is_moving == sorted(is_moving), "no motion before the controller is ready"
    ready = is_moving.index(True)
    assert sent[ready].position == pytest.approx(sent[ready - 1].position, abs=1e-4), (
        "from the present joints"
    )
    assert pair.robot.server.counts["commands that answer no report"] == 0


@pytest.mark.parametrize("model", ["crx-10ia/l", "m-10ia"])
def test_set_points_keep_the_limits_of_old_software(model: Any) -> None:
    """Fast motions that begin, turn back and end abruptly."""
    profile, settings = FanucProfile(model=model, refusals="alarm"), FanucSettings(model=model)
    pair = started(profile, settings)
    pair.client.begin(pair.reports[-1].pose)
    steer(pair, (60.0, 0.0, 0.0), 0.4)
    steer(pair, (0.0, 40.0, -30.0), 0.4, 20.0)
    steer(pair, (0.0, 0.0, 0.0), 0.3, 5.0)
    pair.run(1.5)
    assert pair.reports[-1].fault == ""
    assert math.dist(pair.reports[-1].pose.position, HOME.position) < 1e-5


def test_movement_ends_at_its_set_point() -> None:
    pair = started()
    pair.client.begin(pair.reports[-1].pose)
    steer(pair, (0.0, 0.0, -20.0), 1.0)
    depths = []
    for _ in range(100):
        pair.run(0.008)
        depths.append(pair.robot.motion.path.pose.position[2] - HOME.position[2])
    assert min(depths) == pytest.approx(-0.02, abs=2e-6), "never deeper than ordered"
    assert depths[-1] == pytest.approx(-0.02, abs=1e-6)


def test_lateral_motion_keeps_the_depth() -> None:
    pair = started()
    pair.client.begin(pair.reports[-1].pose)
    steer(pair, (0.0, 20.0, 0.0), 1.0)
    pair.run(0.5)
    z = [report.pose.position[2] for report in pair.reports[-180:]]
    assert max(z) - min(z) < 5e-6


@pytest.mark.parametrize("refusals", ["smooth", "alarm"])
def test_client_leaves_once_the_arm_is_at_rest(refusals: Any) -> None:
    pair = started(FanucProfile(refusals=refusals))
    pair.client.begin(pair.reports[-1].pose)
    steer(pair, (5.0, 0.0, 0.0), 0.3)
    count = len(pair.sent)
    for piece in pair.client.leave():
        pair.deliver(piece)
    assert not pair.client.is_at_rest
    while not pair.client.is_at_rest:
        pair.run(0.008)
    assert pair.robot.motion.fastest_deg_s <= 0.01
    commands = [decode_to_robot(one.data) for one in pair.sent[count:] if _is_stream(one)]
    assert [command.is_last for command in commands if isinstance(command, Command)] == [True]
    assert pair.robot.program.alarms.active == []
    pieces = pair.client.farewell()
    kinds = [header_of(p.data).kind if _is_stream(p) else p.data for p in pieces if isinstance(p, Piece)]
    assert kinds == [b'{"Command":"FRC_Abort"}\r\n', Kind.STOP, b'{"Communication":"FRC_Disconnect"}\r\n']


def test_client_of_a_lost_session_leaves_at_once() -> None:
    pair = started()
    pair.client.receive([Ended(Channel.SESSION, "reset")], pair.now)
    assert pair.client.leave() == []
    assert pair.client.is_at_rest


@pytest.mark.parametrize("version", [1, 2, 3, 4])
def test_client_drives_each_version(version: Any) -> None:
    settings = FanucSettings(version=version if version < 3 else 0)
    pair = started(FanucProfile(version=version), settings)
    pair.client.begin(pair.reports[-1].pose)
    steer(pair, (5.0, 0.0, -5.0), 0.8)
    pair.run(0.8)
    assert pair.reports[-1].fault == ""
    x, y, z = pair.reports[-1].pose.position
    assert (x, y, z) == pytest.approx((0.905, -0.1, 0.595), abs=1e-5)
    assert {header_of(p.data).version for p in pair.sent if _is_stream(p)} <= {3, version}


@pytest.mark.parametrize("j3", ["upper arm", "horizon"])
def test_reference_of_j3_is_that_of_the_controller(j3: Any) -> None:
    pair = started(FanucProfile(stream_j3=j3), FanucSettings(stream_j3=j3))
    pair.client.begin(pair.reports[-1].pose)
    steer(pair, (0.0, 0.0, -5.0), 0.5)
    pair.run(0.5)
    assert pair.robot.motion.path.pose.position == pytest.approx((0.9, -0.1, 0.595), abs=1e-6)


def test_built_in_sensor_reports_the_force_in_the_base_frame() -> None:
    profile = FanucProfile(version=4, force_offset_n=0.0, force_noise_n=0.0)
    pair = Pair(profile, FanucSettings(sensor="built-in"))
    pair.robot.feel(lambda time: (1.0, 2.0, 12.0))
    pair.run(3.0)
    assert pair.reports[-1].force == pytest.approx((0.0, 0.0, 0.0), abs=0.01), "zeroed at the start"
    pair.robot.feel(lambda time: (3.0, 2.0, 20.0))
    pair.run(0.2)
    assert pair.reports[-1].force == pytest.approx((2.0, 0.0, 8.0), abs=0.01)


def test_point_of_the_reports_is_guided() -> None:
    """Without the tool, the face plate is 200 mm above the tip."""
    pair = started(settings=FanucSettings(reports="face plate"))
    assert pair.reports[-1].pose.position == pytest.approx((0.9, -0.1, 0.8), abs=1e-6)


def test_world_frame_can_be_that_of_the_run() -> None:
    pair = started(settings=FanucSettings(world_height_mm=0.0))
    assert pair.reports[-1].pose.position == pytest.approx((0.9, -0.1, 0.355), abs=1e-6)


# --- refusals


def test_held_interface_is_reported_and_no_stop_packet_sent() -> None:
    pair = Pair()
    pair.robot.interface.owner = pair.desk.session
    assert "another client holds it; end the other client" in lost(pair)
    assert not any(_is_stream(piece) for piece in pair.sent), "it would end the session of the other client"


def test_hanging_server_is_reported() -> None:
    pair = Pair()
    pair.robot.abort_tasks(pair.now)
    assert "does not answer the capability request over Stream Motion" in lost(pair)


def test_other_sampling_period_is_refused() -> None:
    assert lost(Pair(FanucProfile(cycle_ms=4))).startswith(
        "it samples every 4 ms, and robot.fanuc.cycle_ms is 8"
    )


def test_pendant_that_is_on_is_reported() -> None:
    pair = Pair()
    pair.robot.program.pendant_on = True
    assert lost(pair).startswith("its teach pendant is on, or it is not in AUTO")


def test_emergency_stop_at_the_start_is_reported() -> None:
    pair = Pair()
    pair.robot.program.press_stop(pair.now)
    assert lost(pair).startswith("it refuses FRC_Reset: the controller cannot be reset (2556940)")


def test_wrong_model_is_refused_before_anything_is_changed() -> None:
    pair = Pair(settings=FanucSettings(model="m-10ia"))
    assert lost(pair).startswith("its face plate is 280.5 mm from where a m-10ia with its joints has it")
    assert not any(_is_stream(piece) for piece in pair.sent)
    assert pair.robot.program.status == ProgramStatus.CANCELLED


def test_model_is_checked_with_active_frames() -> None:
    pair = Pair()
    pair.robot.interface.numbers["UFrameNumber"] = 3
    pair.robot.interface.frames["UFram3"] = {"X": 100.0, "Y": 0.0, "Z": 0.0, "W": 0.0, "P": 0.0, "R": 0.0}
    assert lost(pair).startswith("its face plate is 100.0 mm from where a crx-10ia/l with its")


def test_wrong_model_is_detected_by_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    """A controller that does not report its tool frame."""
    monkeypatch.delitem(rmi_commands._ACTS, "FRC_ReadUToolData")
    pair = Pair(settings=FanucSettings(model="m-10ia"))
    pair.run(3.0)
    begin = pair.reports[-1].pose
    pair.client.begin(begin)
    for k in range(100):
        x, y, z = begin.position
        pair.goal = Pose((x, y, z - 0.0002 * k), begin.quaternion)
        pair.run(0.008)
    pair.run(0.3)
    assert "do not fit its reported position with the dimensions of a m-10ia" in pair.reports[-1].fault


def test_other_speeds_than_those_of_the_model_are_a_notice() -> None:
    assert [event for event in started().events if isinstance(event, StreamNotice)] == []
    pair = Pair(FanucProfile(speeds_deg_s=(210.0, 190.0, 210.0, 400.0, 400.0, 600.0)))
    pair.run(3.0)
    assert [event.text for event in pair.events if isinstance(event, StreamNotice)] == [
        "its joints are limited to 210 190 210 400 400 600 °/s, those of a crx-10ia/l to 120 120 180 180 180 180:"
        " check robot.fanuc.model"
    ]


# --- faults of a stream


@pytest.mark.parametrize(
    ("fault", "text"),
    [
        ("emergency-stop", "the emergency stop is pressed"),
        ("pendant-on", "its teach pendant is on"),
        ("servo-alarm", "it reports an alarm: SRVO-023 Stop error excess"),
        ("contact-stop", "its contact stop has tripped"),
        ("program-aborted", "it is not ready for commands"),
        ("starves", "it is not ready for commands"),
        ("stranger-start", "it reports an alarm: HOST-380 System error 0x30,0x0"),
    ],
)
def test_fault_is_reported(fault: str, text: str) -> None:
    pair = started()
    pair.desk.now = pair.now
    pair.desk.inject("robot", fault, 60.0)
    pair.run(1.0)
    assert pair.reports[-1].fault == text


def test_arm_that_was_stopped_waits_for_the_next_movement() -> None:
    pair = started()
    pair.client.begin(pair.reports[-1].pose)
    steer(pair, (0.0, 0.0, -10.0), 0.5)
    pair.desk.now = pair.now
    pair.robot.program.starved = True
    pair.run(0.3)
    pair.robot.program.starved = False
    place = pair.robot.motion.path.pose.position
    pair.run(0.5)
    assert pair.reports[-1].fault == ""
    assert pair.robot.motion.path.pose.position == pytest.approx(place, abs=1e-6)
    pair.client.begin(pair.reports[-1].pose)
    pair.run(0.5)
    assert pair.robot.motion.path.pose.position[2] == pytest.approx(0.59, abs=1e-6)


def test_lost_interface_ends_the_movement() -> None:
    pair = started()
    pair.client.receive((Ended(Channel.SESSION, "the peer closed"),), pair.now)
    event = pair.client.next_event()
    assert isinstance(event, StreamLost)
    assert "the connection to its Remote Motion Interface has ended: the peer closed" in event.text


def test_door_may_close_once_it_has_named_the_port() -> None:
    pair = Pair()
    pair.run(0.001)
    pair.client.receive((Ended(Channel.DOOR, "the peer closed"),), pair.now)
    pair.run(3.0)
    assert pair.reports[-1].fault == ""


def test_garbage_is_ignored() -> None:
    pair = started()
    count = len(pair.reports)
    pair.client.receive(
        (Piece(Channel.STREAM, b"x"), Piece(Channel.SESSION, b"nonsense\r\n{}\r\n")), pair.now
    )
    pair.run(0.08)
    assert len(pair.reports) == count + 10


def test_signal_has_no_contents() -> None:
    assert Signal(Kind.STOP, 3) == decode_to_robot(bytes.fromhex("0000000200000003"))


# --- loop


@pytest.mark.parametrize("model", ["crx-10ia/l", "m-10ia"])
@pytest.mark.parametrize("stiffness", [5e3, 50e3])
def test_loop_keeps_its_force(model: str, stiffness: float) -> None:
    site = {
        "robot": {"emulated": "fanuc", "fanuc": {"model": model}},
        "cell": {**NEAR, "surface": {"stiffness_n_m": stiffness}, "fanuc": {"model": model}},
        "controller": {"name": "predictive", "parameters": {"resolution_mm": 0.05}},
        "run": {"duration_s": 5.0},
    }
    result = hil_bridge.simulate(site, seed=7)
    assert result.outcome == "completed", result.text
    assert result.figures.force_mean_steady_n == pytest.approx(10.0, abs=0.5)


@pytest.mark.parametrize("version", [1, 4])
@pytest.mark.parametrize("refusals", ["smooth", "alarm"])
def test_loop_closes_over_each_controller(version: int, refusals: str) -> None:
    own = {"version": version if version < 3 else 0, "sensor": "built-in" if version == 4 else "none"}
    site = {
        "robot": {"emulated": "fanuc", "fanuc": own},
        "cell": {**NEAR, "fanuc": {"version": version, "refusals": refusals}},
        "run": {"duration_s": 2.0},
    }
    result = hil_bridge.simulate(site, seed=7)
    assert result.outcome == "completed", result.text
