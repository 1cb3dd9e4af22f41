"""Recording as an ASAM measurement, and a CAN log with its DBC file, opened by asammdf."""

import io
import math
import re
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import can
import cantools
import numpy as np
import pytest
from asammdf import MDF
from msgspec import structs

from hil_bridge.errors import ConfigError
from hil_bridge.errors.extras import install_command
from hil_bridge.record import read
from hil_bridge.record.analysis.columns import unit_of
from hil_bridge.record.device_facts import devices_of
from hil_bridge.record.export import export
from hil_bridge.record.export.measurement import measurement
from hil_bridge.record.export.tables import cycle_table
from protocol.wrench import AXES, wrench_of
from tests.near_surface import WHOLE
from tests.recordings import Recordings


@pytest.fixture(scope="module")
def recording_path(recordings: Recordings, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("measurement") / "run.mcap"
    shutil.copy(recordings.path(WHOLE), path)
    export(path, ("mf4",), path.parent)
    return path


def test_mdf_channels_match_recording(recording_path: Path) -> None:
    recording = read(recording_path)
    facts = devices_of(recording).sensor.facts
    assert facts is not None
    with MDF(recording_path.with_suffix(".mf4")) as file:
        fz = file.get("sensor.wrench_fz")
        assert [*fz.timestamps] == [frame.at for frame in recording.sensors]
        assert [*fz.samples] == [wrench_of(frame.counts, facts.scales)[2] for frame in recording.sensors]
        force = file.get("cycle.force")
        assert [*force.timestamps] == [cycle.controlled_at for cycle in recording.cycles]
        assert [*force.samples] == [cycle.force for cycle in recording.cycles]
        assert (force.unit, force.comment) == (
            "N",
            "N along the approach direction, positive while pressing.",
        )
        assert (file.get("cycle.wrench_mx").unit, fz.unit, file.get("truth.joints_deg_1").unit) == (
            "N·m",
            "N",
            "deg",
        )
        true = file.get("truth.position_z")
        assert [*true.samples] == [truth.position[2] for truth in recording.truths]
        assert np.ptp(true.samples) > 1e-3


def test_mdf_channels_have_names_and_units_of_table(recording_path: Path) -> None:
    recording = read(recording_path)
    columns = cycle_table(recording.cycles)
    with MDF(recording_path.with_suffix(".mf4")) as file:
        file_groups: Any = file.groups
        (group,) = [group for group in file_groups if group.channel_group.acq_name == "cycle"]
        names = [one.name.removeprefix("cycle.") for one in group.channels]
        assert {one for one in names if not one.startswith(("time", "quaternion_commanded"))} <= set(columns)
        units = [file.get(f"cycle.wrench_{axis}").unit for axis in AXES]
        assert units == ["N", "N", "N", "N·m", "N·m", "N·m"]
        (fz,) = {cycle.sample.wrench[2] for cycle in recording.cycles[-1:]}
        assert file.get("cycle.wrench_fz").samples[-1] == fz
        assert file.get("cycle.explanation_feedback_m").unit == "m"
        assert file.get("truth.joints_deg_6").unit == "deg"


def test_mdf_group_has_one_rate_and_file_has_start(recording_path: Path) -> None:
    recording = read(recording_path)
    with MDF(recording_path.with_suffix(".mf4")) as file:
        file_groups: Any = file.groups
        groups = {group.channel_group.acq_name: group.channel_group.cycles_nr for group in file_groups}
        assert groups == {
            "sensor": len(recording.sensors),
            "cycle": len(recording.cycles),
            "truth": len(recording.truths),
            "event": len(recording.events),
        }
        assert file.start_time.timestamp() == pytest.approx(recording.unix_zero_ns / 1e9, abs=1e-6)


def test_mdf_events_are_in_event_blocks_and_a_group(recording_path: Path) -> None:
    events = sorted(read(recording_path).events, key=lambda event: event.at)
    with MDF(recording_path.with_suffix(".mf4")) as file:
        inner: Any = file._mdf  # the table has no public name
        result = inner.events
        reported = [(one.sync_base * one.sync_factor, one.name, one.comment) for one in result]
        assert [(name, comment) for _, name, comment in reported] == [(one.kind, one.text) for one in events]
        assert [at for at, _, _ in reported] == pytest.approx([one.at for one in events], abs=2e-9)
        kinds = file.get("event.kind")
        assert [bytes(kind).decode() for kind in kinds.samples] == [event.kind for event in events]
        assert [*kinds.timestamps] == [event.at for event in events]


@pytest.mark.parametrize("zero_ns", [-1, 1 << 63])
def test_mdf_out_of_range_time_is_refused(recording_path: Path, zero_ns: int) -> None:
    with pytest.raises(ConfigError, match=r"^its time is out of range for MDF"):
        measurement(replace(read(recording_path), unix_zero_ns=zero_ns))


def test_mdf_events_without_time_are_omitted(recording_path: Path) -> None:
    recording = read(recording_path)
    lost = [structs.replace(recording.events[0], at=at) for at in (math.nan, math.inf, 9.9e9)]
    data, _ = measurement(replace(recording, events=(*lost, *recording.events)))
    path = recording_path.with_name("lost.mf4")
    path.write_bytes(data)
    with MDF(path) as file:
        assert len(file.get("event.kind")) == len(recording.events)


def test_mdf_without_asammdf_is_refused_in_one_line(
    recording_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "asammdf", None)
    with pytest.raises(
        ConfigError, match=re.escape(f"a measurement needs the package asammdf; {install_command('mdf')}")
    ):
        export(recording_path, ("mf4",), tmp_path)


def test_can_log_decodes_alike_in_asammdf_and_cantools(recordings: Recordings, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    shutil.copy(recordings.path(WHOLE), path)
    export(path, ("blf", "dbc"), tmp_path)
    database: Any = cantools.database.load_file(tmp_path / "run.dbc")
    with can.BLFReader(tmp_path / "run.blf") as log:
        messages = [message for message in log if not message.is_error_frame]
    with can.MF4Writer(tmp_path / "bus.mf4", database=tmp_path / "run.dbc") as writer:
        for message in messages:
            writer.on_message_received(message)
    decoded = [
        database.decode_message(0x601, bytes(one.data))["fz"]
        for one in messages
        if one.arbitration_id == 0x601 and one.is_rx
    ]
    with MDF(tmp_path / "bus.mf4") as bus:
        (fz,) = bus.extract_bus_logging({"CAN": [(tmp_path / "run.dbc", 0)]}).select(["fz"])
    assert len({*decoded}) > 10
    assert [*fz.samples] == decoded


def test_unknown_can_frame_is_numeric_channel(recording_path: Path) -> None:
    recording = read(recording_path)
    unknown = structs.replace(recording.sensors[0], counts=(math.nan,) * 6)
    data, _ = measurement(replace(recording, sensors=(unknown, *recording.sensors[1:])))
    with MDF(io.BytesIO(data)) as file:
        samples = file.get("sensor.counts_fz").samples
    assert np.isnan(samples[0])
    assert np.isfinite(samples[1:]).all()


@pytest.mark.parametrize(
    ("column", "unit"),
    [("sample_force", "N"), ("position_x", "m"), ("wrench_mx", "N·m"), ("started_at", "s"), ("phase", "")],
)
def test_column_unit_matches_field(column: str, unit: str) -> None:
    assert unit_of(column) == unit
