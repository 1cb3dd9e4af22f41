"""Recording as a ROS 2 bag, read back by two independent readers."""

import math
import re
import shutil
import sys
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from msgspec import structs
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from hil_bridge.cli import cli
from hil_bridge.errors import ConfigError
from hil_bridge.errors.extras import install_command
from hil_bridge.record import EventKind, Recording, read, read_with_traffic
from hil_bridge.record.device_facts import devices_of
from hil_bridge.record.export import Choices, export
from hil_bridge.record.ros.messages import TOPICS
from protocol.wrench import wrench_of
from tests.near_surface import EMERGENCY_STOP, WHOLE
from tests.recordings import Recordings

READERS = ("rosbags", "mcap-ros2-support")
SENSED = "/force_torque_sensor_broadcaster/wrench"


@pytest.fixture(scope="module")
def recording_path(recordings: Recordings, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bag") / "run.mcap"
    shutil.copy(recordings.path(WHOLE), path)
    export(path, ("rosbag2",), path.parent)
    return path


def messages(bag: Path, reader: str) -> dict[str, list[tuple[int, Any]]]:
    """Return the messages of each topic with their log times, ns."""
    result: dict[str, list[tuple[int, Any]]] = defaultdict(list)
    if reader == "rosbags":
        store = get_typestore(Stores.ROS2_HUMBLE)
        with Reader(bag) as opened:
            for connection, at, data in opened.messages():
                result[connection.topic].append((at, store.deserialize_cdr(data, connection.msgtype)))
    else:
        with (bag / "bag.mcap").open("rb") as file:
            decoded = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
            for _, channel, message, by_topic in decoded:
                result[channel.topic].append((message.log_time, by_topic))
    return result


def stamp(recording: Recording, at: float) -> int:
    return recording.unix_zero_ns + round(at * 1e9)


def six(message: Any) -> tuple[float, ...]:
    force, torque = message.wrench.force, message.wrench.torque
    return force.x, force.y, force.z, torque.x, torque.y, torque.z


def pose(position: Any, turn: Any) -> tuple[float, ...]:
    return position.x, position.y, position.z, turn.w, turn.x, turn.y, turn.z


@pytest.mark.parametrize("reader", READERS)
def test_ros_bag_wrenches_match_recording(recording_path: Path, reader: str) -> None:
    recording = read(recording_path)
    by_topic = messages(recording_path.parent / "run.rosbag2", reader)
    assert set(by_topic) == set(TOPICS)
    facts = devices_of(recording).sensor.facts
    assert facts is not None
    assert [(at, six(one)) for at, one in by_topic[SENSED]] == [
        (stamp(recording, one.at), wrench_of(one.counts, facts.scales)) for one in recording.sensors
    ]
    assert sorted((at, six(one)) for at, one in by_topic["/contact/wrench"]) == sorted(
        (stamp(recording, one.sample.sensor_at), one.sample.wrench) for one in recording.cycles
    )
    assert [(at, six(one)[:3]) for at, one in by_topic["/truth/wrench"]] == [
        (stamp(recording, one.at), one.force) for one in recording.truths
    ]
    assert all(part == 0.0 for _, one in by_topic["/truth/wrench"] for part in six(one)[3:])
    assert any(abs(six(one)[2]) > 5.0 for _, one in by_topic["/contact/wrench"])
    frames = {
        topic: {one.header.frame_id for _, one in by_topic[topic]} for topic in TOPICS if "wrench" in topic
    }
    assert frames == {SENSED: {"ft_frame"}, "/contact/wrench": {"tool0"}, "/truth/wrench": {"base"}}


@pytest.mark.parametrize("reader", READERS)
def test_ros_bag_poses_joints_and_frames_match_recording(recording_path: Path, reader: str) -> None:
    recording = read(recording_path)
    by_topic = messages(recording_path.parent / "run.rosbag2", reader)
    start = recording.cycles[0].sample.quaternion
    reported = [
        (stamp(recording, one.sample.now), (*one.sample.position, *one.sample.quaternion))
        for one in recording.cycles
    ]
    commanded = [
        (stamp(recording, one.sent_at), (*one.target, *(one.quaternion_commanded or start)))
        for one in recording.cycles
    ]
    true = [(stamp(recording, one.at), (*one.position, *one.quaternion)) for one in recording.truths]
    for topic, expected in (("/pose_broadcaster/pose", reported), ("/target_pose", commanded)):
        result = [(at, pose(one.pose.position, one.pose.orientation)) for at, one in by_topic[topic]]
        assert result == expected
        assert {one.header.frame_id for _, one in by_topic[topic]} == {"base"}
    joints = by_topic["/joint_states"]
    assert [(at, tuple(one.position)) for at, one in joints] == [
        (stamp(recording, one.at), tuple(map(pytest.approx, map(math.radians, one.joints_deg))))
        for one in recording.truths
    ]
    assert list(joints[0][1].name) == [f"joint_{number}" for number in range(1, 7)]
    distance: dict[str, list[tuple[int, tuple[float, ...]]]] = defaultdict(list)
    for at, one in by_topic["/tf"]:
        for each in one.transforms:
            assert each.header.frame_id == "base"
            distance[each.child_frame_id].append(
                (at, pose(each.transform.translation, each.transform.rotation))
            )
    assert distance == {"tool0": reported, "tool0_target": commanded, "tool0_true": true}


@pytest.mark.parametrize("reader", READERS)
def test_ros_bag_events_are_diagnostics(recording_path: Path, reader: str) -> None:
    recording = read(recording_path)
    by_topic = messages(recording_path.parent / "run.rosbag2", reader)["/diagnostics"]
    result = [(at, one.status[0].name, one.status[0].message) for at, one in by_topic]
    assert result == [
        (stamp(recording, one.at), f"hil_bridge: {one.kind}", one.line) for one in recording.events
    ]
    assert len(result) > 3


def test_ros_bag_stop_is_diagnostic_error(recordings: Recordings, tmp_path: Path) -> None:
    path = tmp_path / "stop.mcap"
    shutil.copy(recordings.path(WHOLE, faults=[EMERGENCY_STOP]), path)
    export(path, ("rosbag2",), tmp_path)
    by_topic = messages(tmp_path / "stop.rosbag2", "mcap-ros2-support")["/diagnostics"]
    stops = [one.status[0] for _, one in by_topic if one.status[0].name == "hil_bridge: stop"]
    (event,) = [event for event in read(path).events if event.kind == EventKind.STOP]
    assert event.cause is not None
    assert [int.from_bytes(one.level) if isinstance(one.level, bytes) else one.level for one in stops] == [2]
    assert event.cause.value in {pair.value for pair in stops[0].values}


def test_ros_bag_metadata_has_topics_types_and_qos(recording_path: Path) -> None:
    with Reader(recording_path.parent / "run.rosbag2") as opened:
        assert {one.topic: one.msgtype for one in opened.connections} == dict(TOPICS)
        for one in opened.connections:
            (qos,) = one.ext.offered_qos_profiles  # type: ignore[union-attr]
            assert (qos.reliability.name, qos.durability.name, qos.history.name) == (
                "RELIABLE",
                "VOLATILE",
                "KEEP_LAST",
            )
            assert qos.depth == 10
        assert opened.message_count == sum(one.msgcount for one in opened.connections) > 500


def test_ros_bag_time_stamps_may_start_at_epoch(recording_path: Path, tmp_path: Path) -> None:
    result = CliRunner().invoke(
        cli, ["export", str(recording_path), "--to", "rosbag2", "--epoch", "100", "--output", str(tmp_path)]
    )
    assert result.exit_code == 0, result.output
    by_topic = messages(tmp_path / "run.rosbag2", "rosbags")[SENSED]
    first = read(recording_path).sensors[0].at
    assert by_topic[0][0] == 100 * 10**9 + round(first * 1e9)
    header = by_topic[0][1].header.stamp
    assert header.sec * 10**9 + header.nanosec == by_topic[0][0]


def test_ros_bag_out_of_range_time_is_refused(recording_path: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"^[^\n]+a ROS 2 time stamp cannot represent [^\n]+ give --epoch"):
        export(recording_path, ("rosbag2",), tmp_path / "out", choices=Choices(epoch_s=float(1 << 31)))
    assert not (tmp_path / "out").exists()


def test_ros_bag_out_of_range_number_is_refused(
    recording_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording, traffic = read_with_traffic(recording_path)
    frame = structs.replace(recording.sensors[0], counts=(10**400, 0, 0, 0, 0, 0))
    damaged = replace(recording, sensors=(frame,))
    monkeypatch.setattr("hil_bridge.record.export.files.read_with_traffic", lambda _: (damaged, traffic))
    for name in ("rosbag2", "mf4", "csv"):
        with pytest.raises(
            ConfigError, match=r"^[^\n]+ it holds a number that is out of range; is it damaged\?$"
        ):
            export(recording_path, (name,), tmp_path)
    assert not [*tmp_path.iterdir()]


def test_ros_bag_existing_bag_is_kept(recording_path: Path) -> None:
    metadata_path = recording_path.parent / "run.rosbag2" / "metadata.yaml"
    before = metadata_path.read_bytes()
    with pytest.raises(ConfigError, match="already exists; name another file, or give --overwrite"):
        export(recording_path, ("rosbag2",), recording_path.parent)
    assert metadata_path.read_bytes() == before


def test_ros_bag_without_rosbags_is_refused_in_one_line(
    recording_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    with pytest.raises(
        ConfigError, match=re.escape(f"a ROS 2 bag needs the package rosbags; {install_command('ros')}")
    ):
        export(recording_path, ("rosbag2",), tmp_path)
