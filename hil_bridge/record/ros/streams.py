"""Messages of a bag as checked arrays: wrenches and poses of the selected topics."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hil_bridge.errors import ConfigError
from hil_bridge.errors.failures import one_line
from hil_bridge.errors.text_files import format_path, harmless
from hil_bridge.record.foreign import HEADER, LARGEST, POSE, TARGET, WRENCH, BagChoices, ForeignTopic
from hil_bridge.record.ros import messages
from hil_bridge.record.ros.bag_file import Bag, TopicFilter

Floats: TypeAlias = NDArray[np.float64]
Nanoseconds: TypeAlias = NDArray[np.int64]
TYPES = {WRENCH: messages.WRENCH, POSE: messages.POSE, TARGET: messages.POSE}
"""Message type of each role's topic."""
CHILD = ":"
"""Separator before the name of the child frame in the name of a transform topic."""
_PARTS = {
    WRENCH: ("force x", "force y", "force z", "torque x", "torque y", "torque z"),
    POSE: ("x", "y", "z", "orientation w", "orientation x", "orientation y", "orientation z"),
}
_LEAST_TURN = 1e-6
"""Smallest norm of a quaternion that defines an orientation. Chosen."""


@dataclass(frozen=True, slots=True)
class Stream:
    """Values of a topic over time."""

    topic: ForeignTopic
    stamps_ns: Nanoseconds
    """Time stamps (n,) in ascending order, ns."""
    values: Floats
    """Values of the topic: (n, 6) fx fy fz mx my mz, N and N·m; or (n, 7) x y z, m, and w x y z, normalised."""


def needed_topics(choices: BagChoices) -> TopicFilter:
    """Return a filter that selects the needed topics."""
    named = {name.partition(CHILD)[0] for role in TYPES for name in choices.named(role)}
    free = {TYPES[role] for role in (WRENCH, POSE) if not choices.named(role)}
    if any(CHILD in name for role in TYPES for name in choices.named(role)):
        free.add(messages.TRANSFORMS)
    return lambda name, kind: name in named or kind in free


def topic_of(bag: Bag, role: str, choices: BagChoices) -> str:
    """Return the name of the topic of a role, including the child frame of a transform. Raises ConfigError."""
    source, named, there = format_path(bag.path), choices.named(role), bag.of_type(TYPES[role])
    type_name = TYPES[role].replace("/msg", "")
    for name in named:
        plain, _, child = name.partition(CHILD)
        kind = messages.TRANSFORMS if child else TYPES[role]
        if role != WRENCH and bag.types.get(plain) == messages.TRANSFORMS and not child:
            raise ConfigError(
                f"{source}: {plain} has many frames; name one with --topic {role}={plain}:CHILD"
            )
        if plain in bag.types and bag.types[plain] != kind:
            raise ConfigError(f"{source}: {plain} is {_format_name(bag.types[plain])}; expected {type_name}")
        if plain in bag.types:
            return name
    listed = _format_name(", ".join(there)) or "none"
    if named:
        raise ConfigError(f"{source} has no topic {' or '.join(named)}; topics of type {type_name}: {listed}")
    if len(there) > 1:
        raise ConfigError(
            f"{source} has several {type_name}: {listed}; name one with --topic {role}={there[0]}"
        )
    if not there:
        transforms = role == POSE and bag.of_type(messages.TRANSFORMS)
        advice = f"; --topic pose={transforms[0]}:CHILD takes one from its transforms" if transforms else ""
        raise ConfigError(f"{source} has no topic of type {type_name}{advice}")
    return there[0]


def stream_of(bag: Bag, role: str, choices: BagChoices, store: Any) -> Stream:
    """Return the values of the topic of a role. Raises ConfigError if the values are unusable."""
    name = topic_of(bag, role, choices)
    plain, _, child = name.partition(CHILD)
    source, kind = format_path(bag.path), bag.types[plain]
    where = f"{source}: {_format_name(plain)}"
    rows, stamps, frames = [], [], set[str]()
    row_of = _wrench_row if role == WRENCH else _pose_row
    for number, (at_ns, data) in enumerate(bag.messages.get(plain, ())):
        try:
            message = store.deserialize_cdr(data, kind)
            for header, part in _header_and_content(message, child):
                rows.append(row_of(part))
                stamps.append(_stamp_ns(header) if choices.stamps == HEADER else at_ns)
                frames.add(str(header.frame_id))
        except Exception as error:  # the library passes all exceptions on
            raise ConfigError(f"{where}: message {number + 1} is damaged, or of another type") from error
    if not rows:
        missing = f"no frame {child!r}" if child and bag.messages.get(plain) else "no message"
        raise ConfigError(f"{where} has {missing}{' before the damage' if bag.truncated else ''}")
    if len(frames) > 1:
        listed = ", ".join(sorted(frames)[:4])
        raise ConfigError(f"{where} names several frames: {_format_name(listed)}; record one source alone")
    origin = ForeignTopic(name, kind, frames.pop(), len(rows))
    if child:
        _refuse_moving_parent(bag, origin.frame, f"{where}: frame {_format_name(child)!r}", store)
    try:
        stamps_ns = np.array(stamps, dtype=np.int64)
    except OverflowError as error:
        raise ConfigError(f"{where} has a time stamp out of range") from error
    _check_times(stamps_ns, where, choices)
    return Stream(origin, stamps_ns, _check_values(np.array(rows, dtype=np.float64), role, where))


def _refuse_moving_parent(bag: Bag, parent: str, where: str, store: Any) -> None:
    """Raise ConfigError if the parent of a transform moves in another frame, because it is then not a base frame."""
    poses, above = defaultdict[str, set[Any]](set), dict[str, str]()
    for name in bag.of_type(messages.TRANSFORMS):
        for _, data in bag.messages.get(name, ()):
            try:
                transforms = store.deserialize_cdr(data, messages.TRANSFORMS).transforms
            except Exception as error:  # the library passes all exceptions on
                raise ConfigError(
                    f"{format_path(bag.path)}: {_format_name(name)} has a damaged message"
                ) from error
            for one in transforms:
                poses[one.child_frame_id].add((one.header.frame_id, *_pose_row(one.transform)))
                above[one.child_frame_id] = one.header.frame_id
    frame, passed = parent, set[str]()
    while frame in above and frame not in passed:
        passed.add(frame)
        if len(poses[frame]) > 1:
            raise ConfigError(
                f"{where} is given in {_format_name(parent)!r}, which moves with {_format_name(frame)!r} in "
                f"{_format_name(above[frame])!r}: name a frame whose parent is fixed, or record its pose in the base"
            )
        frame = above[frame]


def _format_name(name: str) -> str:
    """Format a name from a bag on one line, without terminal control characters."""
    return harmless(one_line(name))


def _header_and_content(message: Any, child: str) -> Sequence[tuple[Any, Any]]:
    """Return header and content of each part of a message; for transforms, only the parts of one child frame."""
    if child:
        return [(one.header, one.transform) for one in message.transforms if one.child_frame_id == child]
    return [(message.header, getattr(message, "wrench", None) or message.pose)]


def _wrench_row(wrench: Any) -> Sequence[float]:
    force, torque = wrench.force, wrench.torque
    return force.x, force.y, force.z, torque.x, torque.y, torque.z


def _pose_row(pose: Any) -> Sequence[float]:
    """Return the row of a pose or of a transform."""
    place = getattr(pose, "position", None) or pose.translation
    turn = getattr(pose, "orientation", None) or pose.rotation
    return place.x, place.y, place.z, turn.w, turn.x, turn.y, turn.z


def _stamp_ns(header: Any) -> int:
    return int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)


def _check_times(stamps_ns: Nanoseconds, where: str, choices: BagChoices) -> None:
    if choices.stamps == HEADER and not stamps_ns.any():
        raise ConfigError(f"{where} has no time stamps in its headers; --stamps log uses the recording times")
    if (back := np.flatnonzero(np.diff(stamps_ns) < 0)).size:
        first = int(back[0])
        by_s = (int(stamps_ns[first]) - int(stamps_ns[first + 1])) * 1e-9
        raise ConfigError(
            f"{where}: the time goes back by {by_s:.6g} s at message {first + 2}; "
            "--stamps log uses the recording times"
        )


def _check_values(values: Floats, role: str, where: str) -> Floats:
    """Check that all values are finite and in range; normalise quaternions. Torques that are all NaN are allowed."""
    parts = _PARTS[WRENCH if role == WRENCH else POSE]
    end = 3 if role == WRENCH and bool(np.isnan(values[:, 3:]).all()) else None
    known = values[:, :end]
    _refuse_first(
        ~np.isfinite(known), lambda row, part: f"{parts[part]} of message {row + 1} is not a number", where
    )
    _refuse_first(
        np.abs(known) > LARGEST,
        lambda row, part: f"{parts[part]} of message {row + 1} is {known[row, part]:.3g}: is it in SI units?",
        where,
    )
    if role == WRENCH:
        return values
    lengths = np.linalg.norm(values[:, 3:], axis=1, keepdims=True)
    _refuse_first(
        lengths < _LEAST_TURN, lambda row, _: f"the orientation of message {row + 1} is all zero", where
    )
    values[:, 3:] /= lengths
    return values


def _refuse_first(bad: NDArray[np.bool_], describe: Callable[[int, int], str], where: str) -> None:
    """Raise ConfigError that names the first bad value."""
    if bad.any():
        row, part = (int(place) for place in np.argwhere(bad)[0])
        raise ConfigError(f"{where}: {describe(row, part)}")
