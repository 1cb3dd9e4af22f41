"""Run as live ROS 2 messages: a client of Foxglove's protocol decodes exactly what the run recorded."""

import asyncio
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import aiohttp
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from hil_bridge.record import EventKind, Recording, read
from hil_bridge.record.device_facts import devices_of
from hil_bridge.record.ros.messages import TOPICS
from protocol.wrench import wrench_of
from tests.web.foxglove_client import foxglove
from tools.web_run import WebRun

pytestmark = pytest.mark.live

NEAR_AND_STOPPED = """
[cell]
start_position_mm = [900.0, -100.0, 591.0]
jr3.gateway.boot_s = 0.2
[task]
retract_mm = 1.0
[[faults]]
on = "robot"
fault = "emergency-stop"
phase = "track"
after_s = 1.5
"""
SENSED = "/force_torque_sensor_broadcaster/wrench"


def decoded(capture: Mapping[str, Any]) -> dict[str, list[tuple[int, Any]]]:
    """Return the messages of the ROS 2 topics, decoded only by the definitions that the server advertised."""
    store = get_typestore(Stores.EMPTY)
    for name in TOPICS:
        channel = capture["channels"][name]
        assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg")
        types = get_types_from_msg(channel["schema"], channel["schemaName"])
        store.register({name: one for name, one in types.items() if name not in store.fielddefs})
    return {
        name: [
            (at, store.deserialize_cdr(data, capture["channels"][name]["schemaName"])) for at, data in rows
        ]
        for name, rows in capture["messages"].items()
        if name in TOPICS
    }


def stamp(recording: Recording, at: float) -> int:
    return recording.unix_zero_ns + round(at * 1e9)


def six(message: Any) -> tuple[float, ...]:
    force, torque = message.wrench.force, message.wrench.torque
    return force.x, force.y, force.z, torque.x, torque.y, torque.z


async def test_ros_client_decodes_run_values(web_run: Callable[..., WebRun], tmp_path: Path) -> None:
    run = web_run("--record", "run.mcap", "--duration", "20", config=NEAR_AND_STOPPED)
    async with aiohttp.ClientSession() as session:
        result = await foxglove(session, run, 60.0, "foxglove.websocket.v1")
    assert run.ended() == 3
    recording = read(tmp_path / "0" / "run.mcap")
    reported = decoded(result)
    assert {name: result["channels"][name]["schemaName"] for name in TOPICS} == dict(TOPICS)
    assert set(reported) == set(TOPICS)

    cycles = {stamp(recording, one.sample.sensor_at): one for one in recording.cycles}
    contact = reported["/contact/wrench"]
    assert len(contact) > 5  # of a second or two; a busy machine has longer cycles
    assert all(six(one) == cycles[at].sample.wrench for at, one in contact)
    assert max(-one.wrench.force.z for _, one in contact) > 5.0
    assert {one.header.frame_id for _, one in contact} == {"tool0"}
    assert contact[-1][0] == max(cycles)

    facts = devices_of(recording).sensor.facts
    assert facts is not None
    frames = [(stamp(recording, one.at), wrench_of(one.counts, facts.scales)) for one in recording.sensors]
    sensed = [(at, six(one)) for at, one in reported[SENSED]]
    assert len(sensed) > 500
    assert sensed == frames[-len(sensed) :]
    assert min(wrench[2] for _, wrench in sensed) < -5.0

    places = {stamp(recording, one.sample.now): one.sample.position for one in recording.cycles}
    for at, one in reported["/pose_broadcaster/pose"]:
        assert (one.pose.position.x, one.pose.position.y, one.pose.position.z) == places[at]
        assert one.header.stamp.sec * 10**9 + one.header.stamp.nanosec == at
    truths = {stamp(recording, one.at): one.force for one in recording.truths}
    assert all(six(one)[:3] == truths[at] for at, one in reported["/truth/wrench"])
    children = {one.child_frame_id for _, message in reported["/tf"] for one in message.transforms}
    assert children == {"tool0", "tool0_target", "tool0_true"}
    levels = {
        status.name: status.level for _, message in reported["/diagnostics"] for status in message.status
    }
    assert levels["hil_bridge: stop"] == 2


async def test_ros_client_that_does_not_read_does_not_block_run(
    web_run: Callable[..., WebRun], tmp_path: Path
) -> None:
    run = web_run(
        "--record", "run.mcap", "--duration", "3", config=NEAR_AND_STOPPED.partition("[[faults]]")[0]
    )
    async with aiohttp.ClientSession() as session:
        socket = await session.ws_connect(f"{run.origin}/", protocols=("foxglove.sdk.v1",), max_msg_size=0)
        reported: dict[str, Any] = {}
        while reported.get("op") != "advertise":
            reported = await socket.receive_json()
        expected = [{"id": one["id"], "channelId": one["id"]} for one in reported["channels"]]
        await socket.send_json({"op": "subscribe", "subscriptions": expected})
        transport = socket._response.connection.transport  # type: ignore[union-attr]
        transport.pause_reading()  # type: ignore[union-attr]
        assert await asyncio.to_thread(run.ended) == 0
        transport.abort()  # type: ignore[union-attr]
    recording = read(tmp_path / "0" / "run.mcap")
    assert recording.end["outcome"] == "completed"
    assert not [
        event
        for event in recording.events
        if event.kind in (EventKind.WEB, EventKind.RECORDER, EventKind.OVERRUN)
    ]
