"""Stored programs of an emulated Universal Robot: read from a folder, refused in one line."""

import os
from pathlib import Path

import pytest

from emulators.devices.rtde import TEXT_MAX
from hil_bridge.devices.robots.rtde.program_folder import FILES_MAX, read_programs
from hil_bridge.errors import ConfigError
from hil_bridge.runs.compose import make_cell
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import load_config


def test_program_folder_reads_scripts_and_ignores_other_files(tmp_path: Path) -> None:
    (tmp_path / "waits.script").write_text("sleep(1)\n")
    (tmp_path / "notes.txt").write_text("none\n")
    assert read_programs(tmp_path, TEXT_MAX) == {"waits": b"sleep(1)\n"}
    config = tmp_path / "c.toml"
    config.write_text('robot.emulated = "rtde"\ncell.rtde.program_folder = "."\n')
    cell = make_cell(Setup(load_config(config, {})), 100.0)
    assert cell.robot.controller.player.stored == {"waits": b"sleep(1)\n"}, (
        "the folder is relative to its file"
    )


def test_unreadable_program_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"^cannot read [^\n]*nowhere: No such file or directory$"):
        read_programs(tmp_path / "nowhere", TEXT_MAX)
    (tmp_path / "long.script").write_bytes(b"#" * 11)
    with pytest.raises(ConfigError, match=r"long\.script: too long for a program, at most 10 bytes$"):
        read_programs(tmp_path, 10)
    (tmp_path / "long.script").unlink()
    os.mkfifo(tmp_path / "pipe.script")
    with pytest.raises(ConfigError, match=r"pipe\.script"):
        read_programs(tmp_path, 10)


def test_program_folder_limits_number_of_programs(tmp_path: Path) -> None:
    for number in range(FILES_MAX + 1):
        (tmp_path / f"{number}.script").write_text("")
    with pytest.raises(ConfigError, match=r": more than 256 programs; remove some$"):
        read_programs(tmp_path, TEXT_MAX)
