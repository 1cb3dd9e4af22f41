"""ROS 2 bag as a recording: one sample per wrench, with the tool pose at the time of the wrench.

A sample is a `CycleRecord` with the measurements: times, wrench, force, pose and depth, and the commanded depth if
a topic provides it. Values that a bag does not contain, such as decisions and verdicts, are NaN or empty.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil_bridge.control.sample import Sample
from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import format_path
from hil_bridge.record.foreign import BASE_FRAME, POSE, TARGET, TOOL_FRAME, WRENCH, BagChoices, Foreign
from hil_bridge.record.reader import Recording, read, with_file
from hil_bridge.record.records import CycleRecord
from hil_bridge.record.ros.bag_file import is_bag, read_messages
from hil_bridge.record.ros.messages import message_store
from hil_bridge.record.ros.streams import Floats, Nanoseconds, Stream, needed_topics, stream_of
from protocol.geometry import rotation_rows

GAP_S = 0.5
"""Longest time between two poses for which the tool pose is interpolated, s. Chosen."""
_NAN = math.nan


def read_any(path: Path, choices: BagChoices | None = None) -> Recording:
    """Read the recording of a run, or a ROS 2 bag as a recording. Raises ConfigError."""
    return read_bag(path, choices) if is_bag(path) else read(path)


def read_bag(path: Path, choices: BagChoices | None = None) -> Recording:
    """Read a ROS 2 bag as a recording, whose clock is 0 at the time stamp of the first sample.

    Raises ConfigError if rosbags is not installed, and for an unusable bag.
    """
    choices = choices or BagChoices()
    bag = read_messages(path, needed_topics(choices))
    store = message_store()
    streams = {role: stream_of(bag, role, choices, store) for role in (WRENCH, POSE)}
    if choices.named(TARGET):
        streams[TARGET] = stream_of(bag, TARGET, choices, store)
    known, places = _interpolate_poses(streams[WRENCH].stamps_ns, streams[POSE])
    if not known.any():
        raise ConfigError(f"{format_path(path)}: no wrench has a pose within {GAP_S:g} s of it")
    samples = _Samples(streams[WRENCH].stamps_ns[known], streams[WRENCH].values[known], places[known])
    origin = Foreign(
        path.name,
        {role: stream.topic for role, stream in streams.items()},
        choices,
        left_out=int((~known).sum()),
        moments=bool(np.isfinite(samples.wrenches[:, 3:]).any()),
    )
    recording = Recording(
        _records(samples, streams.get(TARGET), choices),
        truncated=bag.truncated,
        unix_zero_ns=int(samples.stamps_ns[0]),
        foreign=origin,
    )
    return with_file(recording, path)


class _Samples(NamedTuple):
    """Wrenches and the tool pose at the time of each."""

    stamps_ns: Nanoseconds
    wrenches: Floats
    """Wrenches (n, 6), as reported."""
    places: Floats
    """Tool poses (n, 7)."""


def _interpolate_poses(at_ns: Nanoseconds, poses: Stream) -> tuple[NDArray[np.bool_], Floats]:
    """Return a mask of the times that have a pose, and these poses.

    Poses are interpolated linearly, including the orientations, which are then normalised.
    """
    zero = int(at_ns[0])
    at, pose_times = (at_ns - zero) * 1e-9, (poses.stamps_ns - zero) * 1e-9
    after = np.clip(np.searchsorted(pose_times, at, side="right"), 0, len(pose_times) - 1)
    before = np.maximum(np.searchsorted(pose_times, at, side="right") - 1, 0)
    gap = pose_times[after] - pose_times[before]
    share = np.where(gap > 0.0, (at - pose_times[before]) / np.where(gap > 0.0, gap, 1.0), 0.0)[:, None]
    inside = (at >= pose_times[0]) & (at <= pose_times[-1])
    edge = np.minimum(np.abs(at - pose_times[0]), np.abs(at - pose_times[-1]))
    known = np.where(inside, (gap <= GAP_S) | (share[:, 0] == 0.0), edge <= GAP_S)
    first, second = poses.values[before], poses.values[after].copy()
    second[(first[:, 3:] * second[:, 3:]).sum(axis=1) < 0.0, 3:] *= -1.0  # the shorter rotation
    places = first + share * (second - first)
    places[:, 3:] /= np.linalg.norm(places[:, 3:], axis=1, keepdims=True)
    return known, places


_UNKNOWN = (
    *("sent_at", "answered_at"),
    *("force_reference", "travel_commanded", "across_commanded", "correction", "gain"),
)
"""Fields of a cycle that a bag does not contain."""


def _records(samples: _Samples, target: Stream | None, choices: BagChoices) -> tuple[CycleRecord, ...]:
    times: Floats = (samples.stamps_ns - int(samples.stamps_ns[0])).astype(np.float64) * 1e-9
    turns = _matrices(samples.places[:, 3:])
    axis = np.array(choices.direction)
    approach = axis if choices.axis_frame == BASE_FRAME else turns[0] @ axis
    wrenches = _in_tool(samples.wrenches, times, turns, choices)
    along = (
        np.tile(axis, (len(times), 1))
        if choices.axis_frame == TOOL_FRAME
        else _rotate_to_tool(turns, axis[None])
    )
    forces = -(wrenches[:, :3] * along).sum(axis=1)
    positions = samples.places[:, :3]
    depths = (positions - positions[0]) @ approach
    commanded = _commanded_positions(samples, target)
    ordered = (commanded - positions[0]) @ approach
    start: tuple[float, ...] = tuple(positions[0].tolist())
    columns = {
        "started_at": times,
        "controlled_at": times,
        "force": forces,
        "depth": depths,
        "target": commanded,
        "depth_commanded": ordered,
        "in_contact": forces > choices.contact_n,
    }
    unknown: dict[str, Any] = dict.fromkeys(_UNKNOWN, _NAN)
    rows = zip(*(_values(column) for column in columns.values()), strict=True)
    measured = zip(
        *map(_values, (positions, forces, np.linalg.norm(wrenches[:, :3], axis=1))),
        *map(_values, (wrenches, samples.places[:, 3:])),
        strict=True,
    )
    return tuple(
        CycleRecord(
            cycle=number,
            phase="",
            sample=Sample(
                now=_NAN,
                position=position,
                force=force,
                resultant=resultant,
                sensor_at=_NAN,
                sensor_sequence=number,
                wrench=wrench,
                quaternion=quaternion,
            ),
            verdict="",
            start=start,
            **unknown,
            **dict(zip(columns, row, strict=True)),
        )
        for number, (row, (position, force, resultant, wrench, quaternion)) in enumerate(
            zip(rows, measured, strict=True)
        )
    )


def _values(column: NDArray[Any]) -> Iterator[Any]:
    """Return the values of a column as a record stores them: numbers, or tuples of numbers."""
    return (tuple(each) if isinstance(each, list) else each for each in column.tolist())


def _in_tool(wrenches: Floats, times: Floats, turns: Floats, choices: BagChoices) -> Floats:
    """Return the wrenches on the tool in the axes of the tool, minus their mean at the start if requested."""
    if choices.zero_s > 0.0:
        wrenches = wrenches - wrenches[times <= choices.zero_s].mean(axis=0)
    wrenches = choices.sign * wrenches
    if choices.wrench_in == TOOL_FRAME:
        return wrenches
    return np.hstack([_rotate_to_tool(turns, wrenches[:, :3]), _rotate_to_tool(turns, wrenches[:, 3:])])


def _rotate_to_tool(turns: Floats, vectors: Floats) -> Floats:
    """Rotate vectors (n, 3) or (1, 3) from the axes of the base to the axes of the tool."""
    turned: Floats = np.einsum("nji,nj->ni", turns, np.broadcast_to(vectors, (len(turns), 3)))
    return turned


def _matrices(quaternions: Floats) -> Floats:
    """Return rotation matrices (n, 3, 3) of unit quaternions w x y z (n, 4), from the tool frame to the base frame."""
    return np.array([rotation_rows(quaternion) for quaternion in quaternions.tolist()])


def _commanded_positions(samples: _Samples, target: Stream | None) -> Floats:
    """Return the newest commanded position at each time, (n, 3), m; NaN before the first one, or if there is none."""
    places = np.full((len(samples.stamps_ns), 3), math.nan)
    if target is not None:
        newest = np.searchsorted(target.stamps_ns, samples.stamps_ns, side="right") - 1
        places[newest >= 0] = target.values[newest[newest >= 0], :3]
    return places
