"""Parts of a recording for Foxglove's own panels, and the layouts that use its fields."""

import itertools
import json
import math
import xml.etree.ElementTree as xml
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.interfaces import Nodetype
from scipy.spatial.transform import Rotation

from hil_bridge.record import TruthRecord
from hil_bridge.record.export.layouts import content
from hil_bridge.record.ros.messages import TOPICS as ROS_TOPICS
from hil_bridge.record.ros.messages import message_store
from hil_bridge.record.scenes import PERIOD_S, TRAIL_POINTS, Scenes, SceneUpdate
from hil_bridge.record.topics import TOPICS
from tests.near_surface import STREAMED, merged
from tests.record.written_recordings import cycle
from tests.recordings import Recordings


@pytest.fixture(scope="module")
def messages(recordings: Recordings) -> dict[str, list[tuple[int, Any]]]:
    """Return log times and messages of a run by topic."""
    path = recordings.path(merged(STREAMED, {"run": {"duration_s": 2.0}, "robot": {"emulated": "egm"}}))
    result: dict[str, list[tuple[int, Any]]] = {}
    with path.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            result.setdefault(channel.topic, []).append((message.log_time, json.loads(message.data)))
    return result


def in_ns(time: dict[str, int]) -> int:
    return time["sec"] * 10**9 + time["nsec"]


def test_scene_frames_match_record_poses(messages: dict[str, list[tuple[int, Any]]]) -> None:
    for frame, topic in (("tool", "/cycle"), ("tool_true", "/truth")):
        poses = {at: one.get("sample", one) for at, one in messages[topic]}
        distance = [
            (at, one)
            for at, message in messages["/scene/frames"]
            for one in message["transforms"]
            if one["child_frame_id"] == frame
        ]
        assert len(distance) > 50
        assert all(
            later - at >= (PERIOD_S - 1e-3) * 1e9 for (at, _), (later, _) in itertools.pairwise(distance)
        )
        for at, one in distance:
            assert in_ns(one["timestamp"]) == at
            assert [*one["translation"].values()] == pytest.approx(poses[at]["position"], abs=1e-6)
            w, x, y, z = poses[at]["quaternion"]
            assert one["rotation"] == pytest.approx({"x": x, "y": y, "z": z, "w": w}, abs=1e-6)


def test_scene_arrows_point_along_forces(messages: dict[str, list[tuple[int, Any]]]) -> None:
    truths = dict(messages["/truth"])
    checked = 0
    for at, message in messages["/scene/force"]:
        (entity,) = message["entities"]
        if entity["frame_id"] == "base" and math.hypot(*truths[at]["force"]) > 1.0:
            arrow = entity["arrows"][0]
            turn = Rotation.from_quat([arrow["pose"]["orientation"][axis] for axis in "xyzw"])
            force = np.asarray(truths[at]["force"])
            assert turn.apply([1.0, 0.0, 0.0]) == pytest.approx(force / np.linalg.norm(force), abs=1e-4)
            checked += 1
    assert checked > 20


def test_scene_surface_is_below_tool_normal_to_it(
    messages: dict[str, list[tuple[int, Any]]],
) -> None:
    truths = dict(messages["/truth"])
    assert messages["/scene/surface"]
    for at, message in messages["/scene/surface"]:
        points = np.array([[*point.values()] for point in message["entities"][0]["triangles"][0]["points"]])
        assert (points - truths[at]["position"]) @ truths[at]["normal"] == pytest.approx(
            np.zeros(6), abs=2e-6
        )
        assert points[[0, 1, 2, 5]].mean(axis=0) == pytest.approx(truths[at]["position"], abs=2e-6)


def test_scene_log_levels_match_event_severity(messages: dict[str, list[tuple[int, Any]]]) -> None:
    events = [(at, record["kind"], record["text"]) for at, record in messages["/event"]]
    assert [(at, one["name"], one["message"]) for at, one in messages["/log"]] == events


def test_scene_trail_size_is_bounded() -> None:
    scenes, longest = Scenes(lambda at: round(at * 1e9)), 0
    for k in range(20_000):
        one = cycle(k, k * 0.1, position=(k * 1e-3, 0.0, 0.0), quaternion=(1.0, 0.0, 0.0, 0.0))
        for topic, message in scenes.of(one):
            if topic.name == "/scene/trail":
                assert isinstance(message, SceneUpdate)
                points = message.entities[0].lines[0].points
                longest = max(longest, len(points))
    assert TRAIL_POINTS / 2 <= longest <= TRAIL_POINTS
    assert points[-1].x > 19.0


@pytest.mark.parametrize("force", [(-3.0, 0.0, 0.0), (0.0, 0.0, 0.0), (math.nan, 0.0, 0.0)])
def test_scene_degenerate_forces_give_valid_messages(
    force: tuple[float, float, float],
) -> None:
    truth = TruthRecord(1, 1.0, 1.0, 1.0, (0.0,) * 3, force, (0.0,) * 6, (), (1.0, 0.0, 0.0, 0.0))
    result = dict(Scenes(lambda at: round(at * 1e9)).of(truth))
    reported = {topic.name for topic in result}
    assert reported == {"/scene/tool", "/scene/frames"} | (
        {"/scene/force"} if force[0] == force[0] else set()
    )


def test_layouts_use_existing_recording_fields() -> None:
    fields = {
        f"{topic.name}.{field}"
        for topic in TOPICS
        for field in topic.schema["properties"]  # type: ignore[attr-defined]
    }
    check_layouts("foxglove.json", "plotjuggler.xml", fields)


def test_ros_layouts_use_existing_message_fields() -> None:
    store = message_store()

    def leaves(kind: str, before: str) -> set[str]:
        result = set()
        for name, (form, reported) in store.fielddefs[kind][1]:
            plain = form == Nodetype.NAME
            result |= leaves(reported, f"{before}.{name}") if plain else {f"{before}.{name}"}
        return result

    fields = {field for topic, kind in ROS_TOPICS.items() for field in leaves(kind, topic)}
    check_layouts("ros2-foxglove.json", "ros2-plotjuggler.xml", fields)
    topics = json.loads(content("ros2-foxglove.json"))["configById"]
    named = {*topics["3D!hil"]["topics"], topics["DiagnosticSummary!events"]["topicToRender"]}
    assert named <= {*ROS_TOPICS}


def check_layouts(foxglove: str, plotjuggler: str, fields: set[str]) -> None:
    """Check that both layouts use only these fields, and each panel once."""
    layout = json.loads(content(foxglove))
    paths = [path["value"] for panel in layout["configById"].values() for path in panel.get("paths", ())]
    curves = [curve.get("name") for curve in xml.fromstring(content(plotjuggler)).iter("curve")]
    assert paths
    assert {*paths} <= fields
    assert curves
    assert {str(curve) for curve in curves} <= {field.replace(".", "/") for field in fields}

    panels: list[str] = []

    def walk(node: Any) -> None:
        if isinstance(node, str):
            panels.append(node)
        else:
            walk(node["first"])
            walk(node["second"])

    walk(layout["layout"])
    assert sorted(panels) == sorted(layout["configById"])
