"""Recorded traffic of any devices, decoded by the kinds of the devices. Other bytes are shown unchanged."""

import math
import re
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import accumulate
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeAlias

from hil_bridge.console.printing import Printer, Row, field_text
from hil_bridge.devices.kinds import (
    ROBOTS,
    SENSORS,
    Describe,
    DeviceKind,
    Registry,
    RobotKind,
    SensorKind,
    describer_of,
    robot_of,
    sensor_of,
)
from hil_bridge.errors import ConfigError
from hil_bridge.errors.file_kinds import CANDUMP, HEAD_BYTES
from hil_bridge.errors.text_files import format_path, open_ordinary, read_text
from hil_bridge.record import LINK_EVENT, LinkRecord, WireRecord, read_link, read_with_traffic
from hil_bridge.record.device_facts import json_or_none
from hil_bridge.record.pieces import is_frame, not_readable, recorded_pieces
from protocol.can.error import decode_error
from protocol.can.text import parse_candump, parse_frame

Side: TypeAlias = Literal["robot", "sensor", "both"]
"""Devices whose traffic is requested."""
Item: TypeAlias = Mapping[str, object]

MCAP_MAGIC = b"\x89MCAP0\r\n"
CONTEXT_BYTES = 1 << 14
"""Number of bytes at the start of a wire that are decoded again as context for undecodable bytes. Chosen.

These bytes may contain a negotiation. The value is several times the number of bytes that an RTDE client exchanges
before the first data.
"""
TOGETHER_MAX = 64
"""Number of undecodable pieces after which they are decoded together, because a message may arrive in parts. Chosen: as
in a record.
"""
TOGETHER_BYTES = 1 << 12
"""Maximum number of bytes without a message that are kept for the pieces that follow. Chosen."""

_HEADS = ("op", "message", "name", "root", "kind")
"""Keys that identify the type of an item. The first key that is present applies."""


class Piece(NamedTuple):
    """Piece of traffic: one datagram, part of a byte stream, one frame, or an event of the link."""

    at: float
    """Time on the run's clock, s."""
    direction: str
    """Direction as seen by the PC, `tx` or `rx`; `--` for an event; the channel if the direction is unknown."""
    data: bytes
    frame: str = ""
    """CAN frame in candump notation; empty for bytes."""
    event: str = ""


# --- from a recording


def is_recording(path: Path) -> bool:
    """Return whether the file exists and begins like a recording."""
    try:
        with open_ordinary(path) as file:
            return file.read(len(MCAP_MAGIC)) == MCAP_MAGIC
    except ConfigError:
        return False


def recorded_robot(path: Path) -> str:
    """Return the kind of robot of a recorded run, or "" if it is unknown. Raises ConfigError if the file cannot be
    read.
    """
    robot, _ = _kinds(read_link(path)[1].get("config"))
    return "" if robot is None else robot.name


def monitor_traffic(path: Path, side: Side, raw: bool) -> int:
    """Print the recorded traffic of the devices' wires in order of time. Return the number of lines.

    Raises ConfigError if the file cannot be read or contains no such traffic.
    """
    recording, traffic = read_with_traffic(path)
    robot, sensor = _kinds(recording.metadata.get("config"))
    rows: list[Row] = []
    if side != "sensor":
        rows += describe_traffic(pieces(traffic.robot, str(path)), robot, "robot")
    if side != "robot":
        rows += describe_traffic(pieces(traffic.sensor, str(path)), sensor, "sensor")
    if not rows:
        raise ConfigError(f"{path} has no traffic of {'its devices' if side == 'both' else f'a {side}'}")
    rows.sort(key=lambda row: row.at)
    show = Printer(raw, rows[0].at)
    for row in rows:
        show.row(row._replace(direction=f"{row.direction:<10}"))
    return len(rows)


def _kinds(config: str | None) -> tuple[RobotKind[Any, Any] | None, SensorKind[Any, Any] | None]:
    """Return the device kinds of a recorded configuration. An unknown kind is None."""
    configuration = json_or_none(config)
    configuration = configuration if isinstance(configuration, dict) else {}
    robot, sensor = configuration.get("robot"), configuration.get("sensor")
    return (
        _kind_in(robot, robot_of, ROBOTS),
        _kind_in(sensor, sensor_of, SENSORS),
    )


def _kind_in(device: object, by_url: Callable[[str], tuple[Any, str]], registry: Registry[Any]) -> Any:
    section = device if isinstance(device, dict) else {}
    try:
        if url := section.get("url"):
            return by_url(str(url))[0]
        return registry.kind(str(section.get("emulated", "")))
    except ConfigError:  # the package of the kind is not installed here
        return None


def pieces(records: Iterable[LinkRecord | WireRecord], name: str) -> Iterator[Piece]:
    """Return the pieces of recorded traffic, with each datagram and frame as a separate piece. Raises ConfigError
    if one is invalid.
    """
    for piece in recorded_pieces(records, name):
        at, direction = piece.at, piece.direction
        if piece.is_event:
            yield Piece(at, direction, b"", event=piece.parts[0])
            continue
        for part in piece.parts:
            if is_frame(part):
                yield Piece(at, direction, b"", frame=part)
                continue
            try:
                yield Piece(at, direction, bytes.fromhex(part))
            except ValueError as error:
                raise not_readable(part, "neither bytes nor a frame", name) from error


# --- from a log of candump


def is_candump(path: Path) -> bool:
    """Return whether the file exists and its first line is in candump format."""
    try:
        with open_ordinary(path) as file:
            return re.match(CANDUMP, file.read(HEAD_BYTES).lstrip()) is not None
    except ConfigError:
        return False


def monitor_candump(path: Path, sensor: DeviceKind | None, raw: bool) -> None:
    """Print the frames of a candump log. A kind of sensor decodes them, if one is given.

    Raises ConfigError if a line is not in candump format, or if its time is before the time of the previous line.
    """
    show = Printer(raw)
    for row in describe_traffic(_candump_pieces(path), sensor, "sensor"):
        show.row(row)


def _candump_pieces(path: Path) -> Iterator[Piece]:
    newest = -math.inf
    for number, line in enumerate(read_text(path).splitlines(), 1):
        if not line.strip():
            continue
        try:
            at, channel, frame = parse_candump(line)
        except ValueError as error:
            raise ConfigError(f"{format_path(path)}: line {number}: {error}") from error
        if at is not None and at < newest:
            raise ConfigError(
                f"{format_path(path)}: line {number}: its time is before that of the previous line; `candump -t d` "
                "writes differences, `-l` and `-t a` write times"
            )
        newest = newest if at is None else at
        yield Piece(math.nan if at is None else at, channel, b"", frame=str(frame))


# --- in words


def describe_traffic(traffic: Iterable[Piece], kind: DeviceKind | None, device: str) -> Iterator[Row]:
    """Describe the traffic of a device of this kind line by line. `device` is the name of the device if its kind is
    unknown.
    """
    name = device if kind is None else kind.name
    describe = None if kind is None else describer_of(kind)
    parts = None if describe is None else _Reassembly(describe)
    arrows = {"tx": f"PC→{name}", "rx": f"{name}→PC"}

    def row(one: _Decoded) -> Row:
        return Row(
            one.piece.at, arrows[one.piece.direction], item_text(one.item), one.data, has_trouble(one.item)
        )

    for piece in traffic:
        if parts is None or not piece.data:
            if parts is not None:
                yield from map(row, parts.flush())
            yield _describe_one(piece, describe, arrows)
        else:
            yield from map(row, parts.add(piece))
    if parts is not None:
        yield from map(row, parts.flush())


def _describe_one(piece: Piece, describe: Describe | None, arrows: Mapping[str, str]) -> Row:
    """Return the line for an event, a frame, an empty datagram, or undecodable bytes."""
    if piece.event:
        return Row(piece.at, LINK_EVENT, piece.event, b"", False)
    arrow = arrows.get(piece.direction, piece.direction)
    if not piece.frame:
        return Row(piece.at, arrow, piece.data.hex(" ").upper() or "empty", b"", False)
    if "!" in piece.frame:
        return Row(piece.at, "bus", _bus_error(piece.frame), b"", True)
    items = [] if describe is None else describe(piece.frame.encode("ascii", errors="replace"))
    text = "; ".join(map(item_text, items)) or piece.frame
    return Row(piece.at, arrow, text, _frame_data(piece.frame), any(map(has_trouble, items)))


def _bus_error(text: str) -> str:
    try:
        return str(decode_error(parse_frame(text.replace("!", "#"))._replace(error=True)))
    except ValueError:
        return text


def _frame_data(text: str) -> bytes:
    try:
        return parse_frame(text).data
    except ValueError:
        return b""


class _Decoded(NamedTuple):
    """Decoded item, the piece in which it ends, and the bytes to display with it."""

    piece: Piece
    item: Item
    data: bytes


class _Reassembly:
    """Decoder of the pieces of a wire. Pieces that cannot be decoded separately are decoded together, after the start
    of the wire.
    """

    def __init__(self, describe: Describe) -> None:
        self._describe = describe
        self._begin = bytearray()
        self._waiting: list[Piece] = []
        self._untried = 0

    def add(self, piece: Piece) -> list[_Decoded]:
        """Return the items that are complete with this piece."""
        items = self._describe(piece.data)
        if not any(map(has_trouble, items)):
            complete = self.flush()
            self._extend_begin(piece.data)
            return complete + [_Decoded(piece, item, piece.data) for item in items]
        self._waiting.append(piece)
        self._untried += 1
        return self._decode(is_end=False) if self._untried >= TOGETHER_MAX else []

    def flush(self) -> list[_Decoded]:
        """Return the items of all pieces that are left, whether they are complete or not."""
        return self._decode(is_end=True) if self._waiting else []

    def _decode(self, is_end: bool) -> list[_Decoded]:
        """Return the items of the waiting pieces. If more pieces may follow, those after the last message are kept.

        The pieces are decoded together only if this decodes more of them.
        """
        waiting, self._waiting, self._untried = self._waiting, [], 0
        alone = [
            _Decoded(piece, item, piece.data) for piece in waiting for item in self._describe(piece.data)
        ]
        joined = _decode_together(waiting, bytes(self._begin), self._describe)
        is_better = bool(joined) and _count_trouble(joined) < _count_trouble(alone)
        messages = [k for k, one in enumerate(joined, 1) if one.item.get("kind") != "noise"]
        complete = joined[: messages[-1] if messages else 0]
        if not is_end:
            kept = _after(waiting, sum(len(one.data) for one in complete) if is_better else 0)
            if sum(len(piece.data) for piece in kept) < TOGETHER_BYTES:
                self._waiting = kept
                if not is_better:
                    return []
                joined = complete
        for one in complete:
            self._extend_begin(one.data)
        return joined if is_better else alone

    def _extend_begin(self, data: bytes) -> None:
        if len(self._begin) < CONTEXT_BYTES:
            self._begin += data


def _decode_together(waiting: Sequence[Piece], begin: bytes, describe: Describe) -> list[_Decoded]:
    """Return the items of the joined pieces after the start of the wire, or an empty list if the first item does not
    begin with the first piece. An item belongs to the piece in which it ends.
    """
    raw = begin + b"".join(piece.data for piece in waiting)
    ends = [*accumulate((len(piece.data) for piece in waiting), initial=len(begin))][1:]
    decoded: list[_Decoded] = []
    start = len(begin)
    for item in describe(raw):
        offset = _number(item, "offset")
        end = min(offset + _number(item, "size"), len(raw))
        if end <= len(begin):
            continue
        if not decoded and offset != start:
            return []
        decoded.append(_Decoded(waiting[bisect_left(ends, end)], item, raw[start:end]))
        start = max(start, end)
    return decoded


def _after(waiting: Sequence[Piece], size: int) -> list[Piece]:
    """Return the pieces without their first `size` bytes."""
    kept = []
    for piece in waiting:
        if size < len(piece.data):
            kept.append(piece._replace(data=piece.data[size:]))
        size = max(0, size - len(piece.data))
    return kept


def _count_trouble(decoded: Sequence[_Decoded]) -> int:
    return sum(has_trouble(one.item) for one in decoded)


def _number(item: Item, key: str) -> int:
    value = item.get(key)
    return value if isinstance(value, int) else 0


def has_trouble(item: Item) -> bool:
    """Return whether an item has a problem or is undecodable."""
    return bool(item.get("problem") or item.get("problems") or item.get("kind") == "noise")


def item_text(item: Item) -> str:
    """Describe an item in one line: type, fields and problems."""
    head = str(next((item[key] for key in _HEADS if item.get(key)), "item"))
    texts = [str(item[key]).strip() for key in ("meaning", "text", "bytes") if item.get(key)]
    fields, problems = item.get("fields"), item.get("problems")
    texts += [
        _field(field) for field in (fields if isinstance(fields, list) else ()) if isinstance(field, dict)
    ]
    wrong = [*map(str, problems)] if isinstance(problems, list) else []
    wrong += [str(item["problem"])] if item.get("problem") else []
    text = ": ".join(filter(None, (head, ", ".join(filter(None, texts)))))
    return "; ".join(" ".join(part.split()) for part in (text, *wrong))


def _field(field: Item) -> str:
    complete: dict[str, object] = {"name": "", "value": "", "unit": "", **field}
    if isinstance(values := complete["value"], list):
        complete["value"] = " ".join(f"{one:.7g}" if isinstance(one, float) else str(one) for one in values)
    return field_text(complete, zeros=True)
