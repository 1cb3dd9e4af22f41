"""Messages with Foxglove's own schemas in addition to the records of a run, for the 3-D and log panels of Foxglove.

They are derived from the records alone. The frame `base` is the robot's base, `tool` is the reported pose, and
`tool_true` is the true pose in an emulated cell. Lengths are metres. Reference: Foxglove's schemas FrameTransforms,
SceneUpdate and Log.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import msgspec
from msgspec import Struct

from hil_bridge.errors.event_kinds import ALARMS, CAUTIONS
from hil_bridge.record.records import CycleRecord, EventRecord, TruthRecord
from hil_bridge.record.topics import schema_of

PERIOD_S = 1 / 30
"""Shortest time between two messages of a moving entity, s. Chosen: motion looks smooth."""
TRAIL_S = 2.0
"""Time between two messages of the trail, s. Chosen."""
TRAIL_POINTS = 200
"""Maximum number of points in the trail; above it, every second point is removed. Chosen."""
TRAIL_STEP_M = 0.5e-3
"""Shortest distance between two points of a new trail, m. Chosen."""
TOOL_LENGTH_M, TOOL_WIDTH_M = 0.08, 0.008
"""Length and width of the pin that represents the tool, m. Chosen."""
TILE_M = 0.06
"""Edge length of the tile that represents the surface below the tool, m. Chosen."""
METRES_PER_NEWTON = 0.003
"""Scale of a force arrow, m/N. Chosen."""


class _Time(Struct, frozen=True):
    sec: int
    nsec: int


class _Vector3(Struct, frozen=True):
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


class _Quaternion(Struct, frozen=True):
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


class _Pose(Struct, frozen=True):
    position: _Vector3
    orientation: _Quaternion = _Quaternion()


class _Color(Struct, frozen=True):
    r: float
    g: float
    b: float
    a: float = 1.0


class _FrameTransform(Struct, frozen=True):
    timestamp: _Time
    parent_frame_id: str
    child_frame_id: str
    translation: _Vector3
    rotation: _Quaternion


class FrameTransforms(Struct, frozen=True):
    """Poses of frames relative to other frames."""

    transforms: tuple[_FrameTransform, ...]


class Log(Struct, frozen=True):
    """Event message for the log panel."""

    timestamp: _Time
    level: int
    message: str
    name: str
    file: str = ""
    line: int = 0


class _KeyValue(Struct, frozen=True):
    key: str
    value: str


class _Deletion(Struct, frozen=True):
    timestamp: _Time
    type: int
    id: str


class _Arrow(Struct, frozen=True):
    pose: _Pose
    shaft_length: float
    shaft_diameter: float
    head_length: float
    head_diameter: float
    color: _Color


class _Cylinder(Struct, frozen=True):
    pose: _Pose
    size: _Vector3
    bottom_scale: float
    top_scale: float
    color: _Color


class _Line(Struct, frozen=True):
    type: int
    pose: _Pose
    thickness: float
    scale_invariant: bool
    points: tuple[_Vector3, ...]
    color: _Color
    colors: tuple[_Color, ...] = ()
    indices: tuple[int, ...] = ()


class _Triangles(Struct, frozen=True):
    pose: _Pose
    points: tuple[_Vector3, ...]
    color: _Color
    colors: tuple[_Color, ...] = ()
    indices: tuple[int, ...] = ()


class _Unused(Struct, frozen=True):
    """Entity kind that the schema requires but no message uses."""


class _Entity(Struct, frozen=True):
    timestamp: _Time
    frame_id: str
    id: str
    lifetime: _Time = _Time(0, 0)
    frame_locked: bool = True
    metadata: tuple[_KeyValue, ...] = ()
    arrows: tuple[_Arrow, ...] = ()
    cubes: tuple[_Unused, ...] = ()
    spheres: tuple[_Unused, ...] = ()
    cylinders: tuple[_Cylinder, ...] = ()
    lines: tuple[_Line, ...] = ()
    triangles: tuple[_Triangles, ...] = ()
    texts: tuple[_Unused, ...] = ()
    models: tuple[_Unused, ...] = ()


class SceneUpdate(Struct, frozen=True):
    """Entities for the 3-D panel. Each replaces the previous entity with the same `id` and topic."""

    entities: tuple[_Entity, ...]
    deletions: tuple[_Deletion, ...] = ()


@dataclass(frozen=True)
class SceneTopic:
    """Message stream with a Foxglove schema."""

    name: str
    message: type[Struct]

    @property
    def schema_name(self) -> str:
        """Name of the schema in Foxglove."""
        return f"foxglove.{self.message.__name__}"

    @cached_property
    def schema(self) -> dict[str, Any]:
        """JSON schema of a message."""
        return {**schema_of(self.message), "title": self.schema_name}


TRANSFORMS = SceneTopic("/scene/frames", FrameTransforms)
TOOL = SceneTopic("/scene/tool", SceneUpdate)
FORCE = SceneTopic("/scene/force", SceneUpdate)
SURFACE = SceneTopic("/scene/surface", SceneUpdate)
TRAIL = SceneTopic("/scene/trail", SceneUpdate)
LOG = SceneTopic("/log", Log)
SCENE_TOPICS = (TRANSFORMS, TOOL, FORCE, SURFACE, TRAIL, LOG)

_REPORTED, _TRUE = _Color(0.95, 0.55, 0.10), _Color(0.15, 0.65, 0.35, 0.6)
_GROUND, _PATH = _Color(0.45, 0.55, 0.70, 0.5), _Color(0.20, 0.40, 0.90)
_INFO, _WARNING, _ERROR = 2, 3, 4
"""Severity levels of a log message. Reference: Foxglove's schema Log."""
_DIGITS = 6
"""Decimal places of a displayed number: 1 µm. The records have all digits. Chosen."""
_LINE_STRIP = 0
"""Type of a line strip. Reference: Foxglove's schema LinePrimitive."""

encode = msgspec.json.Encoder().encode
"""Encode a message as JSON. All numbers in it must be finite."""


class Scenes:
    """Converter from the records of a run to Foxglove messages. Records must be passed in the order of the file."""

    def __init__(self, wall_ns: Callable[[float], int]) -> None:
        """`wall_ns` converts a time on the run's clock to ns since the Unix epoch."""
        self._wall_ns = wall_ns
        self._due: dict[str, float] = {}
        self._trail: list[_Vector3] = []
        self._step_m = TRAIL_STEP_M

    def of(self, record: object) -> Iterator[tuple[SceneTopic, Struct]]:
        """Return the messages of a record; empty for most types of records."""
        match record:
            case CycleRecord():
                yield from self._of_cycle(record)
            case TruthRecord():
                yield from self._of_truth(record)
            case EventRecord():
                level = _ERROR if record.kind in ALARMS else _WARNING if record.kind in CAUTIONS else _INFO
                yield LOG, Log(self._time(record.at), level, escape_surrogates(record.text), record.kind)

    def _of_cycle(self, cycle: CycleRecord) -> Iterator[tuple[SceneTopic, Struct]]:
        at = cycle.controlled_at
        if not _finite(*cycle.sample.position, *cycle.sample.quaternion, at):
            return
        if self._is_due("tool", at, math.inf):
            yield TOOL, self._body(at, "tool", _REPORTED)
        if self._is_due("cycle", at, PERIOD_S):
            yield TRANSFORMS, self._transform(at, "tool", cycle.sample.position, cycle.sample.quaternion)
            if _finite(*cycle.sample.wrench[:3]):
                yield FORCE, self._arrow(at, "tool", (0.0, 0.0, 0.0), cycle.sample.wrench[:3], _REPORTED)
        if cycle.in_contact:
            self._extend(cycle.sample.position)
            if len(self._trail) > 1 and self._is_due("trail", at, TRAIL_S):
                strip = _Line(_LINE_STRIP, _Pose(_Vector3()), 2.0, True, tuple(self._trail), _PATH)
                yield TRAIL, self._update(at, "base", "trail", lines=(strip,))

    def _of_truth(self, truth: TruthRecord) -> Iterator[tuple[SceneTopic, Struct]]:
        at = truth.at
        if not _finite(*truth.position, *truth.quaternion, at):
            return
        if self._is_due("tool_true", at, math.inf):
            yield TOOL, self._body(at, "tool_true", _TRUE)
        if not self._is_due("truth", at, PERIOD_S):
            return
        yield TRANSFORMS, self._transform(at, "tool_true", truth.position, truth.quaternion)
        if _finite(*truth.force):
            yield FORCE, self._arrow(at, "base", truth.position, truth.force, _TRUE)
        if _finite(*truth.normal) and any(truth.force):
            tile = _Triangles(_Pose(_Vector3()), _tile(truth.position, truth.normal), _GROUND)
            yield SURFACE, self._update(at, "base", "surface", triangles=(tile,))

    def _is_due(self, name: str, at: float, period_s: float) -> bool:
        if at < self._due.get(name, -math.inf):
            return False
        self._due[name] = at + period_s
        return True

    def _extend(self, position: Sequence[float]) -> None:
        """Extend the trail by this point, if it is far enough from the last point."""
        point = _place(position)
        if self._trail:
            last = self._trail[-1]
            if math.dist((last.x, last.y, last.z), position) < self._step_m:
                return
        self._trail.append(point)
        if len(self._trail) > TRAIL_POINTS:
            self._trail, self._step_m = self._trail[::2], 2 * self._step_m

    def _time(self, at: float) -> _Time:
        return _Time(*divmod(self._wall_ns(at), 1_000_000_000)) if math.isfinite(at) else _Time(0, 0)

    def _transform(
        self, at: float, child: str, position: Sequence[float], quaternion: Sequence[float]
    ) -> FrameTransforms:
        w, x, y, z = quaternion
        rotation = _Quaternion(*(round(part, _DIGITS) for part in (x, y, z, w)))
        return FrameTransforms((_FrameTransform(self._time(at), "base", child, _place(position), rotation),))

    def _update(self, at: float, frame: str, name: str, **things: Any) -> SceneUpdate:
        return SceneUpdate((_Entity(self._time(at), frame, name, **things),))

    def _body(self, at: float, frame: str, color: _Color) -> SceneUpdate:
        """Return a pin whose tip is at the frame's origin. The z axis of the tool frame points out of the tool."""
        size = _Vector3(TOOL_WIDTH_M, TOOL_WIDTH_M, TOOL_LENGTH_M)
        pin = _Cylinder(_Pose(_Vector3(z=-TOOL_LENGTH_M / 2)), size, 1.0, 0.3, color)
        return self._update(at, frame, frame, cylinders=(pin,))

    def _arrow(
        self, at: float, frame: str, origin: Sequence[float], force: Sequence[float], color: _Color
    ) -> SceneUpdate:
        """Return an arrow that starts at a point and points along a force, both in this frame."""
        newton = math.hypot(*force)
        length = newton * METRES_PER_NEWTON
        pose = _Pose(_place(origin), _along(force, newton))
        head = min(0.01, length / 2)
        arrow = _Arrow(pose, round(length - head, _DIGITS), 0.002, round(head, _DIGITS), 0.005, color)
        return self._update(at, frame, f"force on {frame}", arrows=(arrow,))


def escape_surrogates(text: str) -> str:
    """Escape lone surrogates in a text, which result from undecodable bytes in a path."""
    return text.encode(errors="backslashreplace").decode()


def _place(position: Sequence[float]) -> _Vector3:
    return _Vector3(*(round(part, _DIGITS) for part in position))


def _finite(*numbers: float) -> bool:
    return all(map(math.isfinite, numbers))


def _along(vector: Sequence[float], length: float) -> _Quaternion:
    """Return the shortest rotation that turns the x axis into the direction of a vector with this length."""
    if length < 1e-9:
        return _Quaternion()
    x, y, z = (part / length for part in vector)
    if x < -1 + 1e-9:
        return _Quaternion(0.0, 0.0, 1.0, 0.0)
    scale = math.sqrt((1 + x) * 2)
    return _Quaternion(0.0, *(round(part, _DIGITS) for part in (-z / scale, y / scale, scale / 2)))


def _tile(centre: Sequence[float], normal: Sequence[float]) -> tuple[_Vector3, ...]:
    """Return two triangles that form a square, centred on a point and perpendicular to a unit normal."""
    a, b, c = normal
    u = (-c, 0.0, a) if abs(b) > abs(a) else (0.0, c, -b)
    size = math.hypot(*u)
    u = tuple(part / size for part in u) if size > 1e-9 else (1.0, 0.0, 0.0)  # type: ignore[assignment]
    v = (b * u[2] - c * u[1], c * u[0] - a * u[2], a * u[1] - b * u[0])
    half = TILE_M / 2
    corners = [
        _place([p + half * (i * q + j * r) for p, q, r in zip(centre, u, v, strict=True)])
        for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    return tuple(corners[k] for k in (0, 1, 2, 0, 2, 3))
