"""ROS 2 bags as other programs write them, for tests that read them."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_HUMBLE)
WRENCH, POSE = "geometry_msgs/msg/WrenchStamped", "geometry_msgs/msg/PoseStamped"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
ZERO_NS = 1_700_000_000_250_000_000
STORAGES = (StoragePlugin.MCAP, StoragePlugin.SQLITE3)
DOWN = (0.0, 1.0, 0.0, 0.0)
"""Orientation w x y z of a tool whose z axis points down."""
Row = tuple[float, Sequence[float]]
"""Time, s, and the parts of a message."""


def make(kind: str, *parts: Any) -> Any:
    return STORE.types[kind](*parts)


def header(at: float, frame: str) -> Any:
    stamp_ns = ZERO_NS + round(at * 1e9) if math.isfinite(at) else 0
    return make("std_msgs/msg/Header", make("builtin_interfaces/msg/Time", *divmod(stamp_ns, 10**9)), frame)


def wrench(at: float, parts: Sequence[float], frame: str = "ft") -> Any:
    force, torque = (make("geometry_msgs/msg/Vector3", *parts[k : k + 3]) for k in (0, 3))
    return make(WRENCH, header(at, frame), make("geometry_msgs/msg/Wrench", force, torque))


def turn(parts: Sequence[float]) -> Any:
    w, x, y, z = parts
    return make("geometry_msgs/msg/Quaternion", x, y, z, w)


def pose(at: float, parts: Sequence[float], frame: str = "base_link") -> Any:
    place = make("geometry_msgs/msg/Point", *parts[:3])
    return make(POSE, header(at, frame), make("geometry_msgs/msg/Pose", place, turn(parts[3:])))


def transform(at: float, parts: Sequence[float], child: str = "tcp") -> Any:
    message = make(
        "geometry_msgs/msg/Transform", make("geometry_msgs/msg/Vector3", *parts[:3]), turn(parts[3:])
    )
    return make(
        TRANSFORMS,
        [
            make("geometry_msgs/msg/TransformStamped", header(at, "base_link"), name, message)
            for name in ("elbow", child)
        ],
    )


def press(count: int = 200, rate: float = 100.0) -> tuple[list[Row], list[Row]]:
    """Return wrenches and poses of a tool that moves down at 10 mm/s, and is pushed back by 1 N/mm from 10 mm on."""
    times = [number / rate for number in range(count)]
    forces = [max(0.0, 10.0 * at - 10.0) for at in times]
    wrenches: list[Row] = [
        (at, (0.3, 0.0, -force, 0.0, 0.01 * force, 0.0)) for at, force in zip(times, forces, strict=True)
    ]
    poses: list[Row] = [(at, (0.5, 0.1, 0.4 - 0.01 * at, *DOWN)) for at in times]
    return wrenches, poses


def write(
    path: Path,
    topics: Mapping[str, tuple[str, Sequence[Any]]],
    storage: StoragePlugin = StoragePlugin.MCAP,
    logged: Callable[[int], int] = lambda number: ZERO_NS + number * 10_000_000,
) -> Path:
    """Write a bag of topics by name: type and messages. `logged` is the log time of each, ns."""
    with Writer(path, version=9, storage_plugin=storage) as bag:
        for name, (kind, rows) in topics.items():
            connection = bag.add_connection(name, kind, typestore=STORE)
            for number, message in enumerate(rows):
                bag.write(connection, logged(number), STORE.serialize_cdr(message, kind))
    return path


def pressed(
    path: Path, storage: StoragePlugin = StoragePlugin.MCAP, more: Mapping[str, Any] | None = None
) -> Path:
    """Write a bag of `press`."""
    wrenches, poses = press()
    topics = {
        "/ft/wrench": (WRENCH, [wrench(*row) for row in wrenches]),
        "/tcp": (POSE, [pose(*row) for row in poses]),
    }
    return write(path, {**topics, **(more or {})}, storage)
