"""A recording as a bag of ROS 2, read back by the readers of two other makers."""

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
def made(recordings: Recordings, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bag") / "run.mcap"
    shutil.copy(recordings.path(WHOLE), path)
    export(path, ("rosbag2",), path.parent)
    return path


def messages(bag: Path, reader: str) -> dict[str, list[tuple[int, Any]]]:
    """Messages of each topic with their log times, ns."""
    found: dict[str, list[tuple[int, Any]]] = defaultdict(list)
    if reader == "rosbags":
        store = get_typestore(Stores.ROS2_HUMBLE)
        with Reader(bag) as opened:
            for connection, at, data in opened.messages():
                found[connection.topic].append((at, store.deserialize_cdr(data, connection.msgtype)))
    else:
        with (bag / "bag.mcap").open("rb") as file:
            decoded = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
            for _, channel, message, told in decoded:
                found[channel.topic].append((message.log_time, told))
    return found


def stamp(recording: Recording, at: float) -> int:
    return recording.unix_zero_ns + round(at * 1e9)


def six(message: Any) -> tuple[float, ...]:
    force, torque = message.wrench.force, message.wrench.torque
    return force.x, force.y, force.z, torque.x, torque.y, torque.z


def pose(place: Any, turn: Any) -> tuple[float, ...]:
    return place.x, place.y, place.z, turn.w, turn.x, turn.y, turn.z


@pytest.mark.parametrize("reader", READERS)
def test_wrenches_are_those_of_the_recording(made: Path, reader: str) -> None:
    recording = read(made)
    told = messages(made.parent / "run.rosbag2", reader)
    assert set(told) == set(TOPICS)
    facts = devices_of(recording).sensor.facts
    assert facts is not None
    assert [(at, six(one)) for at, one in told[SENSED]] == [
        (stamp(recording, one.at), wrench_of(one.counts, facts.scales)) for one in recording.sensors
    ]
    assert sorted((at, six(one)) for at, one in told["/contact/wrench"]) == sorted(
        (stamp(recording, one.sample.sensor_at), one.sample.wrench) for one in recording.cycles
    )
    assert [(at, six(one)[:3]) for at, one in told["/truth/wrench"]] == [
        (stamp(recording, one.at), one.force) for one in recording.truths
    ]
    assert all(part == 0.0 for _, one in told["/truth/wrench"] for part in six(one)[3:])
    assert any(abs(six(one)[2]) > 5.0 for _, one in told["/contact/wrench"])
    frames = {topic: {one.header.frame_id for _, one in told[topic]} for topic in TOPICS if "wrench" in topic}
    assert frames == {SENSED: {"ft_frame"}, "/contact/wrench": {"tool0"}, "/truth/wrench": {"base"}}


@pytest.mark.parametrize("reader", READERS)
def test_poses_joints_and_frames_are_those_of_the_recording(made: Path, reader: str) -> None:
    recording = read(made)
    told = messages(made.parent / "run.rosbag2", reader)
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
        found = [(at, pose(one.pose.position, one.pose.orientation)) for at, one in told[topic]]
        assert found == expected
        assert {one.header.frame_id for _, one in told[topic]} == {"base"}
    joints = told["/joint_states"]
    assert [(at, tuple(one.position)) for at, one in joints] == [
        (stamp(recording, one.at), tuple(map(pytest.approx, map(math.radians, one.joints_deg))))
        for one in recording.truths
    ]
    assert list(joints[0][1].name) == [f"joint_{number}" for number in range(1, 7)]
    moved: dict[str, list[tuple[int, tuple[float, ...]]]] = defaultdict(list)
    for at, one in told["/tf"]:
        for each in one.transforms:
            assert each.header.frame_id == "base"
            moved[each.child_frame_id].append((at, pose(each.transform.translation, each.transform.rotation)))
    assert moved == {"tool0": reported, "tool0_target": commanded, "tool0_true": true}


@pytest.mark.parametrize("reader", READERS)
def test_events_are_diagnostics(made: Path, reader: str) -> None:
    recording = read(made)
    told = messages(made.parent / "run.rosbag2", reader)["/diagnostics"]
    found = [(at, one.status[0].name, one.status[0].message) for at, one in told]
    assert found == [
        (stamp(recording, one.at), f"hil_bridge: {one.kind}", one.line) for one in recording.events
    ]
    assert len(found) > 3


def test_a_stop_is_an_error_among_the_diagnostics(recordings: Recordings, tmp_path: Path) -> None:
    path = tmp_path / "stop.mcap"
    shutil.copy(recordings.path(WHOLE, faults=[EMERGENCY_STOP]), path)
    export(path, ("rosbag2",), tmp_path)
    told = messages(tmp_path / "stop.rosbag2", "mcap-ros2-support")["/diagnostics"]
    stops = [one.status[0] for _, one in told if one.status[0].name == "hil_bridge: stop"]
    (event,) = [event for event in read(path).events if event.kind == EventKind.STOP]
    assert event.cause is not None
    assert [int.from_bytes(one.level) if isinstance(one.level, bytes) else one.level for one in stops] == [2]
    assert event.cause.value in {pair.value for pair in stops[0].values}


def test_metadata_tell_topics_types_and_offered_qos(made: Path) -> None:
    with Reader(made.parent / "run.rosbag2") as opened:
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


def test_stamps_may_count_from_an_epoch(made: Path, tmp_path: Path) -> None:
    done = CliRunner().invoke(
        cli, ["export", str(made), "--to", "rosbag2", "--epoch", "100", "--output", str(tmp_path)]
    )
    assert done.exit_code == 0, done.output
    told = messages(tmp_path / "run.rosbag2", "rosbags")[SENSED]
    first = read(made).sensors[0].at
    assert told[0][0] == 100 * 10**9 + round(first * 1e9)
    header = told[0][1].header.stamp
    assert header.sec * 10**9 + header.nanosec == told[0][0]


def test_a_time_that_a_stamp_cannot_hold_is_refused_in_one_line(made: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"^[^\n]+a stamp of ROS 2 cannot hold [^\n]+ give --epoch"):
        export(made, ("rosbag2",), tmp_path / "out", choices=Choices(epoch_s=float(1 << 31)))
    assert not (tmp_path / "out").exists()


def test_a_number_out_of_range_is_refused_in_one_line(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording, traffic = read_with_traffic(made)
    frame = structs.replace(recording.sensors[0], counts=(10**400, 0, 0, 0, 0, 0))
    damaged = replace(recording, sensors=(frame,))
    monkeypatch.setattr("hil_bridge.record.export.files.read_with_traffic", lambda _: (damaged, traffic))
    for name in ("rosbag2", "mf4", "csv"):
        with pytest.raises(
            ConfigError, match=r"^[^\n]+ it holds a number that is out of range; is it damaged\?$"
        ):
            export(made, (name,), tmp_path)
    assert not [*tmp_path.iterdir()]


def test_a_bag_that_is_there_is_kept(made: Path) -> None:
    place = made.parent / "run.rosbag2" / "metadata.yaml"
    before = place.read_bytes()
    with pytest.raises(ConfigError, match="is there already; name another file, or give --overwrite"):
        export(made, ("rosbag2",), made.parent)
    assert place.read_bytes() == before


def test_without_rosbags_a_bag_is_refused_in_one_line(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    with pytest.raises(
        ConfigError, match=re.escape(f"a bag of ROS 2 needs the package rosbags; {install_command('ros')}")
    ):
        export(made, ("rosbag2",), tmp_path)
