"""Publisher of a run in Foxglove's protocol, whose SDK serves an internal address.

Clients reach it through the server of this package. Topics and schemas are those of a recording and, if the extra
`ros` is installed, those of its ROS 2 bag. Parameters, services and everything else that a client could write are
disabled.
"""

import logging
import secrets
from collections.abc import Mapping
from contextlib import suppress

import foxglove
from foxglove import Channel, Context, Schema
from foxglove.websocket import WebSocketServer
from msgspec import Struct

from hil_bridge.errors import ConfigError
from hil_bridge.record.device_facts import devices_in
from hil_bridge.record.ros.messages import TOPICS as ROS_TOPICS
from hil_bridge.record.ros.messages import TOPICS_OF, Messages
from hil_bridge.record.scenes import (
    SCENE_TOPICS,
    SURFACE,
    TOOL,
    TRAIL,
    Scenes,
    SceneTopic,
    SceneUpdate,
    encode,
)
from hil_bridge.record.time_axis import TimeAxis
from hil_bridge.record.topics import TOPICS, Record, Topic

PROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
"""Subprotocol names in the handshake of a WebSocket, newest first.

The SDK supports only the first name. Older clients, such as Lichtblick until 2025, request the second name. The
messages are identical. Source: Lichtblick, when it adopted the first name.
"""
BACKLOG = 2048
"""Maximum number of messages queued for one client; the oldest are dropped. Chosen: 2 s of a fast run."""
AGAIN_S = 2.0
"""Time between two messages of a static object, for clients that connect later, s. Chosen."""
_STILL = (TOOL, SURFACE, TRAIL)


class Panels:
    """Publisher of records to Foxglove clients."""

    def __init__(self, unix_zero_ns: int) -> None:
        """Start the inner server at a random address out of the 16 million loopback addresses.

        A page of another origin can therefore not find it and bypass the outer server.
        """
        foxglove.set_log_level(logging.ERROR)
        self._zero_ns = unix_zero_ns
        self._context = Context()
        self._channels = {topic.name: self._channel(topic) for topic in (*TOPICS, *SCENE_TOPICS)}
        self._topics: Mapping[type, Topic] = {topic.record: topic for topic in TOPICS}
        self._scenes = Scenes(self._wall_ns)
        self._ros = _ros_messages(unix_zero_ns)
        self._ros_channels = {} if self._ros is None else self._open_ros_channels(self._ros)
        self._ros_channels_of = {
            kind: [self._ros_channels[name] for name in names if name in self._ros_channels]
            for kind, names in TOPICS_OF.items()
        }
        self._kept: dict[str, tuple[str, bytes]] = {}
        self._again_at = 0.0
        self._axis = TimeAxis(self._wall_ns)
        host = f"127.{secrets.randbelow(254) + 1}.{secrets.randbelow(255)}.{secrets.randbelow(254) + 1}"
        self._server: WebSocketServer = foxglove.start_server(
            name="hil-bridge",
            host=host,
            port=0,
            capabilities=[],
            context=self._context,
            message_backlog_size=BACKLOG,
        )
        self.url = f"ws://{host}:{self._server.port}/"
        """URL of the inner server."""

    def _channel(self, topic: Topic | SceneTopic) -> Channel:
        schema = Schema(name=topic.schema_name, encoding="jsonschema", data=encode(topic.schema))
        return Channel(topic.name, schema=schema, message_encoding="json", context=self._context)

    def _open_ros_channels(self, ros: Messages) -> dict[str, Channel]:
        return {
            name: Channel(
                name,
                schema=Schema(name=kind, encoding="ros2msg", data=ros.definition(kind).encode()),
                message_encoding="cdr",
                context=self._context,
            )
            for name, kind in ROS_TOPICS.items()
        }

    def devices(self, facts: Mapping[str, str]) -> None:
        """Store the device facts; from then on, sensor frames are published as ROS 2 messages."""
        sensor = devices_in(facts).sensor.facts
        if self._ros is not None and sensor is not None:
            self._ros.scales = sensor.scales

    def _wall_ns(self, at: float) -> int:
        return self._zero_ns + round(at * 1e9)

    def take(self, record: Record) -> None:
        """Publish a record to its subscribers."""
        topic = self._topics[type(record)]
        record, _, placed = self._axis.place(topic, record)
        channel = self._channels[topic.name]
        if channel.has_sinks():
            channel.log(topic.encode(record), log_time=placed)
        self._publish_ros(record)
        for scene, message in self._scenes.of(record):
            self._show(scene, message, placed)
        if self._axis.newest >= self._again_at:
            self._again_at = self._axis.newest + AGAIN_S
            for name, data in self._kept.values():
                self._channels[name].log(data, log_time=placed)

    def _publish_ros(self, record: Record) -> None:
        """Publish the ROS 2 messages to their subscribers; create no messages if there are no subscribers."""
        if self._ros is None:
            return
        if not any(channel.has_sinks() for channel in self._ros_channels_of.get(type(record), ())):
            self._ros.remember(record)
            return
        with suppress(ConfigError):  # the clock is set to a time that a time stamp cannot represent
            for stamped in self._ros.of(record):
                channel = self._ros_channels[stamped.topic]
                if channel.has_sinks():
                    channel.log(self._ros.encode(stamped), log_time=stamped.stamp_ns)

    def _show(self, scene: SceneTopic, message: Struct, placed: int) -> None:
        keeps = scene in _STILL
        if not (keeps or self._channels[scene.name].has_sinks()):
            return
        data = encode(message)
        if keeps:
            assert isinstance(message, SceneUpdate)
            entity = message.entities[0].id
            self._kept[f"{scene.name}/{entity}"] = (scene.name, data)
        self._channels[scene.name].log(data, log_time=placed)

    def close(self) -> None:
        """Stop the inner server."""
        self._server.stop()


def _ros_messages(unix_zero_ns: int) -> Messages | None:
    """Return the factory of ROS 2 messages, or None if the extra is not installed."""
    try:
        return Messages(unix_zero_ns)
    except ConfigError:
        return None
