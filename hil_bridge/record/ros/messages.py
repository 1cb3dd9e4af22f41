"""Records of a run as ROS 2 messages, for bags and for clients of a running run; ROS is not required.

| topic | type | frame | content |
| --- | --- | --- | --- |
| /force_torque_sensor_broadcaster/wrench | WrenchStamped | ft_frame | every frame of the sensor, from its zero |
| /contact/wrench | WrenchStamped | tool0 | wrench on the tool after bias and gravity |
| /truth/wrench | WrenchStamped | base | force of the emulated surface; its torque is unknown and written as 0 |
| /pose_broadcaster/pose | PoseStamped | base | reported pose of the tool |
| /target_pose | PoseStamped | base | commanded pose of the tool |
| /joint_states | JointState | base | true joints of an emulated robot, rad |
| /diagnostics | DiagnosticArray | | events of the run |
| /tf | TFMessage | base | tool0, tool0_target and tool0_true in base |

Wrenches are N and N·m, positions m. Frames have the names of ROS-Industrial's robots. Reference: REP 103 for units, REP
199 for `base` and `tool0`.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from hil_bridge.errors import ConfigError
from hil_bridge.errors.event_kinds import ALARMS, CAUTIONS
from hil_bridge.errors.extras import install_command
from hil_bridge.record.records import CycleRecord, EventRecord, SensorRecord, TruthRecord
from hil_bridge.record.scenes import escape_surrogates
from protocol.wrench import wrench_of

BASE, TOOL, TARGET, TRUE, SENSOR = "base", "tool0", "tool0_target", "tool0_true", "ft_frame"
_SECONDS_MAX = 1 << 31
"""Upper bound of a time stamp, s. Source: builtin_interfaces/msg/Time has a signed 32-bit field."""
WRENCH, POSE, JOINTS, DIAGNOSTICS, TRANSFORMS = (
    "geometry_msgs/msg/WrenchStamped",
    "geometry_msgs/msg/PoseStamped",
    "sensor_msgs/msg/JointState",
    "diagnostic_msgs/msg/DiagnosticArray",
    "tf2_msgs/msg/TFMessage",
)
TOPICS: Mapping[str, str] = {
    "/force_torque_sensor_broadcaster/wrench": WRENCH,
    "/contact/wrench": WRENCH,
    "/truth/wrench": WRENCH,
    "/pose_broadcaster/pose": POSE,
    "/target_pose": POSE,
    "/joint_states": JOINTS,
    "/diagnostics": DIAGNOSTICS,
    "/tf": TRANSFORMS,
}
"""Message type of each topic."""
_SENSED, _CONTACT, _TRUTH, _REPORTED, _COMMANDED, _JOINTS, _EVENTS, _TF = TOPICS
TOPICS_OF: Mapping[type, tuple[str, ...]] = {
    SensorRecord: (_SENSED,),
    CycleRecord: (_CONTACT, _REPORTED, _COMMANDED, _TF),
    TruthRecord: (_TRUTH, _JOINTS, _TF),
    EventRecord: (_EVENTS,),
}
"""Topics that have messages for a record, by the type of the record."""


class Stamped(NamedTuple):
    """Message with its topic and time."""

    stamp_ns: int
    topic: str
    message: Any


class Messages:
    """Converter from the records of a run to ROS 2 messages. Records must be passed in order."""

    def __init__(self, zero_ns: int, scales: Sequence[float] | None = None) -> None:
        """`zero_ns` is the time stamp of the run's zero, ns.

        `scales` convert the sensor's counts to N and N·m; without scales, sensor frames have no messages. Raises
        ConfigError if rosbags is not installed.
        """
        self.store = message_store()
        self.scales = scales
        self._types: Mapping[str, Callable[..., Any]] = self.store.types
        self._zero_ns = zero_ns
        self._start: Sequence[float] = ()
        """Orientation of the tool in the first cycle, which is also the commanded orientation until the program
        sets another.
        """

    def remember(self, record: object) -> None:
        """Store the state of a record without creating its messages."""
        if not self._start and isinstance(record, CycleRecord):
            self._start = record.sample.quaternion

    def of(self, record: object) -> Iterator[Stamped]:
        """Return the messages of a record; empty if the record has no time.

        Raises ConfigError for a time that a time stamp cannot represent.
        """
        match record:
            case SensorRecord() if self.scales is not None:
                yield from self._wrench(_SENSED, record.at, SENSOR, wrench_of(record.counts, self.scales))
            case CycleRecord():
                yield from self._of_cycle(record)
            case TruthRecord():
                yield from self._of_truth(record)
            case EventRecord():
                yield from self._of_event(record)

    def encode(self, stamped: Stamped) -> bytes:
        """Encode a message as CDR."""
        return bytes(self.store.serialize_cdr(stamped.message, TOPICS[stamped.topic]))

    def definition(self, kind: str) -> str:
        """Return the definition of a type and of all types that it contains, in the format of ROS 2."""
        text: str = self.store.generate_msgdef(kind, ros_version=2)[0]
        return text

    def _of_cycle(self, cycle: CycleRecord) -> Iterator[Stamped]:
        self.remember(cycle)
        yield from self._wrench(_CONTACT, cycle.sample.sensor_at, TOOL, cycle.sample.wrench)
        yield from self._pose(
            _REPORTED, cycle.sample.now, TOOL, (cycle.sample.position, cycle.sample.quaternion)
        )
        turn = cycle.quaternion_commanded or self._start
        yield from self._pose(_COMMANDED, cycle.sent_at, TARGET, (cycle.target, turn))

    def _of_truth(self, truth: TruthRecord) -> Iterator[Stamped]:
        if not math.isfinite(truth.at):
            return
        yield from self._wrench(_TRUTH, truth.at, BASE, (*truth.force, 0.0, 0.0, 0.0))
        yield from self._pose("", truth.at, TRUE, (truth.position, truth.quaternion))
        if all(map(math.isfinite, truth.joints_deg)):
            yield self._joints(truth)

    def _joints(self, truth: TruthRecord) -> Stamped:
        import numpy as np

        names = [f"joint_{number}" for number in range(1, len(truth.joints_deg) + 1)]
        empty = np.array([], dtype=np.float64)
        return self._stamped(
            _JOINTS,
            truth.at,
            lambda stamp: self._make(
                JOINTS, self._header(stamp, BASE), names, np.radians(truth.joints_deg), empty, empty
            ),
        )

    def _of_event(self, event: EventRecord) -> Iterator[Stamped]:
        if not math.isfinite(event.at):
            return
        level = 2 if event.kind in ALARMS else 1 if event.kind in CAUTIONS else 0
        values = {"kind": event.kind, "text": event.text, "by": event.by}
        values["cause"] = "" if event.cause is None else event.cause.value
        values["fault"] = "" if event.fault is None else event.fault.title
        pairs = [
            self._make("diagnostic_msgs/msg/KeyValue", key, escape_surrogates(text))
            for key, text in values.items()
            if text
        ]
        status = self._make(
            "diagnostic_msgs/msg/DiagnosticStatus",
            level,
            f"hil_bridge: {escape_surrogates(event.kind)}",
            escape_surrogates(event.line),
            "hil_bridge",
            pairs,
        )
        yield self._stamped(
            _EVENTS, event.at, lambda stamp: self._make(DIAGNOSTICS, self._header(stamp, ""), [status])
        )

    def _wrench(self, topic: str, at: float, frame: str, values: Sequence[float]) -> Iterator[Stamped]:
        if math.isfinite(at):
            parts = (self._vector(values[:3]), self._vector(values[3:]))
            wrench = self._make("geometry_msgs/msg/Wrench", *parts)
            yield self._stamped(
                topic, at, lambda stamp: self._make(WRENCH, self._header(stamp, frame), wrench)
            )

    def _pose(
        self, topic: str, at: float, frame: str, pose: tuple[Sequence[float], Sequence[float]]
    ) -> Iterator[Stamped]:
        """Return a pose in the base frame as a message of its topic, if it has a topic, and as a transform."""
        position, quaternion = pose
        if not all(map(math.isfinite, (at, *position, *quaternion))):
            return
        w, x, y, z = quaternion
        turn = self._make("geometry_msgs/msg/Quaternion", x, y, z, w)
        if topic:
            place = self._make("geometry_msgs/msg/Point", *position)
            placed = self._make("geometry_msgs/msg/Pose", place, turn)
            yield self._stamped(topic, at, lambda stamp: self._make(POSE, self._header(stamp, BASE), placed))
        transform = self._make("geometry_msgs/msg/Transform", self._vector(position), turn)
        kind = "geometry_msgs/msg/TransformStamped"
        yield self._stamped(
            _TF,
            at,
            lambda stamp: self._make(
                TRANSFORMS, [self._make(kind, self._header(stamp, BASE), frame, transform)]
            ),
        )

    def _stamped(self, topic: str, at: float, make: Callable[[int], Any]) -> Stamped:
        stamp_ns = self._zero_ns + round(at * 1e9)
        if not 0 <= stamp_ns < _SECONDS_MAX * 10**9:
            raise ConfigError(
                f"a ROS 2 time stamp cannot represent {stamp_ns / 1e9:.3f} s; give --epoch from 0 to 2000000000"
            )
        return Stamped(stamp_ns, topic, make(stamp_ns))

    def _header(self, stamp_ns: int, frame: str) -> Any:
        time = self._make("builtin_interfaces/msg/Time", *divmod(stamp_ns, 10**9))
        return self._make("std_msgs/msg/Header", time, frame)

    def _vector(self, values: Sequence[float]) -> Any:
        return self._make("geometry_msgs/msg/Vector3", *values)

    def _make(self, kind: str, *fields: Any) -> Any:
        return self._types[kind](*fields)


def message_store() -> Any:
    """Return the ROS 2 Humble types of the library rosbags. Raises ConfigError if it is not installed."""
    require_rosbags()
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


def require_rosbags() -> None:
    """Raise ConfigError if the library rosbags is not installed."""
    try:
        import rosbags.rosbag2
        import rosbags.typesys  # noqa: F401
    except ImportError as error:
        raise ConfigError(f"a ROS 2 bag needs the package rosbags; {install_command('ros')}") from error
