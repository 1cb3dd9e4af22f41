"""Files of an export and their contents."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from hil_bridge.devices.kinds import SENSORS
from hil_bridge.errors import ConfigError
from hil_bridge.record import RawTraffic, Recording, read_with_traffic
from hil_bridge.record.device_facts import devices_of
from hil_bridge.record.export.can_logs import asc, blf, candump
from hil_bridge.record.export.layouts import LAYOUTS, content
from hil_bridge.record.export.measurement import measurement
from hil_bridge.record.export.ros_bag import bag_files
from hil_bridge.record.export.tables import TIME, Table, as_csv, as_parquet, cycle_table, sensor_table
from hil_bridge.record.export.traffic import WireFrame, can_frames, is_can, wire_text
from hil_bridge.record.files import check_place, write_atomically
from protocol.can.dbc import database

CHANNEL = "can0"
"""Default name of the CAN interface. Chosen: the usual name if there is only one interface."""


@dataclass(frozen=True, slots=True)
class Choices:
    """Options of an export."""

    channel: str = CHANNEL
    """Name of the CAN interface in candump's text."""
    epoch_s: float | None = None
    """Time stamp of the run's zero in a ROS 2 bag, s; None to use the recorded UNIX time."""


@dataclass(frozen=True)
class Source:
    """Recording and the data derived from it."""

    name: str
    recording: Recording
    traffic: RawTraffic
    choices: Choices = Choices()

    @cached_property
    def has_can(self) -> bool:
        """Whether the wire of the sensor carried CAN frames."""
        return is_can(self.traffic)

    @cached_property
    def frames(self) -> Sequence[WireFrame]:
        """Return the CAN frames of the sensor. Raises ConfigError with the reason if there are no CAN frames."""
        if self.has_can:
            return can_frames(self.traffic.sensor)
        kind = devices_of(self.recording).sensor.kind
        sensor = f"its sensor ({kind})" if kind else "its sensor"
        if self.traffic.sensor:
            raise ConfigError(f"it has no CAN frames, because {sensor} is not on CAN; give --to bytes or csv")
        raise ConfigError(f"it has no traffic of {sensor}; record the run again, or give --to csv")

    @cached_property
    def tables(self) -> Mapping[str, Table]:
        """Return the tables by name. Raises ConfigError if all tables are empty."""
        facts = devices_of(self.recording).sensor.facts
        tables = {
            "cycle": cycle_table(self.recording.cycles),
            "sensor": sensor_table(self.recording.sensors, None if facts is None else facts.scales),
        }
        if not (filled := {name: table for name, table in tables.items() if table[TIME]}):
            raise ConfigError("it has neither control cycles nor sensor frames; give --to bytes")
        return filled


@dataclass(frozen=True, slots=True)
class Export:
    """File of an export."""

    suffix: str
    """Suffix of the file name."""
    data: bytes
    what: str
    """Description of the contents and of their clock."""


@dataclass(frozen=True, slots=True)
class Format:
    """Export format."""

    summary: str
    """One-line description for a list."""
    make: Callable[[Source], Sequence[Export]]
    """Function that builds the files. Raises ConfigError if the recording has no data for this format."""
    fits: Callable[[Source], bool] = field(default=lambda source: True)
    """Whether the format is written by default, that is, if the operator does not name any format."""


def _candump(source: Source) -> Sequence[Export]:
    data = candump(source.frames, source.recording.unix_zero_ns, source.choices.channel)
    return [Export(".log", data, f"{len(source.frames)} CAN frames, UNIX time")]


def _blf(source: Source) -> Sequence[Export]:
    data = blf(source.frames, source.recording.unix_zero_ns)
    return [Export(".blf", data, f"{len(source.frames)} CAN frames, UNIX time")]


def _asc(source: Source) -> Sequence[Export]:
    data = asc(source.frames, source.recording.unix_zero_ns)
    return [Export(".asc", data, f"{len(source.frames)} CAN frames, seconds since the first")]


def _dbc(source: Source) -> Sequence[Export]:
    identifiers = [one.frame.identifier for one in source.frames if not one.frame.error]
    kind = SENSORS.kind(devices_of(source.recording).sensor.kind)
    if kind.bus is None or kind.bus.messages is None:
        raise ConfigError(f"its sensor ({kind.name}) has no tables of its frames; give --to candump")
    messages = kind.bus.messages(identifiers)
    return [Export(".dbc", database(kind.name, messages), f"{len(messages)} CAN messages with their signals")]


def _bytes(source: Source) -> Sequence[Export]:
    traffic, exports = source.traffic, []
    texts = {"robot": wire_text(traffic.robot, f"the robot's wire in {source.name}")}
    if not source.has_can:
        texts["sensor"] = wire_text(traffic.sensor, f"the sensor's wire in {source.name}")
    for device, wire in texts.items():
        if wire.pieces:
            what = f"{wire.pieces} pieces of the {device}'s wire, the run's clock"
            exports.append(Export(f".{device}.txt", wire.text.encode(errors="backslashreplace"), what))
    if not exports:
        raise ConfigError("it holds no bytes of a wire; record the run again, or give --to csv")
    return exports


def _tables(source: Source, suffix: str, encode: Callable[[Table], bytes]) -> Sequence[Export]:
    labels = {"cycle": "control cycles", "sensor": "frames of the sensor"}
    return [
        Export(
            f".{name}.{suffix}",
            encode(table),
            f"{len(table[TIME])} {labels[name]}, the run's clock{_raw(table)}",
        )
        for name, table in source.tables.items()
    ]


def _raw(table: Table) -> str:
    without_scales = "counts_fx" in table and "wrench_fx" not in table
    return "; in device counts, as the scales are unknown" if without_scales else ""


def _ros_bag(source: Source) -> Sequence[Export]:
    epoch_s = source.choices.epoch_s
    zero_ns = source.recording.unix_zero_ns if epoch_s is None else round(epoch_s * 1e9)
    files, count = bag_files(source.recording, zero_ns)
    clock = "UNIX time" if epoch_s is None else f"the run's clock from {epoch_s:g} s"
    descriptions = {"metadata.yaml": "topics and their QoS"}
    return [
        Export(f".rosbag2/{name}", data, descriptions.get(name, f"{count} messages of ROS 2, {clock}"))
        for name, data in files.items()
    ]


def _mf4(source: Source) -> Sequence[Export]:
    data, count = measurement(source.recording)
    return [Export(".mf4", data, f"{count} channels, the run's clock")]


def _layouts(source: Source) -> Sequence[Export]:
    return [Export(f".{name}", content(name), "panels for any recording and any run") for name in LAYOUTS]


FORMATS: Mapping[str, Format] = {
    "candump": Format("CAN frames as candump writes them", _candump, lambda source: source.has_can),
    "blf": Format("CAN frames for Vector's tools", _blf, lambda source: source.has_can),
    "asc": Format("CAN frames for Vector's tools, as text", _asc, lambda source: source.has_can),
    "dbc": Format("signals of the CAN frames, for tools that decode them", _dbc, lambda source: False),
    "bytes": Format("bytes of the other wires, as text", _bytes, lambda source: bool(source.traffic.robot)),
    "csv": Format("cycles and sensor as tables", lambda source: _tables(source, "csv", as_csv)),
    "parquet": Format(
        "the same for pandas and similar; needs pyarrow",
        lambda source: _tables(source, "parquet", as_parquet),
        lambda source: False,
    ),
    "rosbag2": Format("ROS 2 bag (a folder); needs rosbags", _ros_bag, lambda source: False),
    "mf4": Format("ASAM MDF measurement; needs asammdf", _mf4, lambda source: False),
    "layouts": Format("panels for Foxglove and PlotJuggler", _layouts, lambda source: False),
}


def export(
    path: Path, formats: Sequence[str], folder: Path, overwrite: bool = False, choices: Choices | None = None
) -> list[str]:
    """Write a recording to a folder in these formats and return one line per file.

    The default is all formats for which the recording has data. All contents are built and all paths are checked
    before the first file is written. Raises ConfigError for a recording that is unreadable or has no data for a
    format, and for a path that is not writable.
    """
    recording, traffic = read_with_traffic(path)
    source = Source(path.name, recording, traffic, choices or Choices())
    chosen = formats or [name for name, one in FORMATS.items() if one.fits(source)]
    try:
        made = [one for name in dict.fromkeys(chosen) for one in FORMATS[name].make(source)]
    except ConfigError as error:
        raise ConfigError(f"cannot export {path}: {error}") from error
    except OverflowError as error:  # JSON allows integers of any length
        raise ConfigError(
            f"cannot export {path}: it holds a number that is out of range; is it damaged?"
        ) from error
    places = [folder / f"{path.stem}{one.suffix}" for one in made]
    for parent in dict.fromkeys([folder, *(place.parent for place in places)]):
        _make_folder(parent)
    for place in places:
        check_place(place, overwrite)
    for place, one in zip(places, made, strict=True):
        write_atomically(place, one.data, overwrite)
    lines = [f"{place}: {one.what}" for place, one in zip(places, made, strict=True)]
    if recording.truncated:
        lines.append(f"{path} ends early or is damaged: what came before is exported")
    return [*lines, f"the run's clock was 0 at UNIX time {recording.unix_zero_ns / 1e9:.6f}"]


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"cannot make the folder {folder}: {error.strerror}; name another place") from error
