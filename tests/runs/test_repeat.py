"""A run in virtual time is a function of its configuration and its seed, down to the bytes of its recording."""

import subprocess
import sys
from pathlib import Path

import pytest

from hil_bridge.record import read
from hil_bridge.runs.outputs import Outputs
from hil_bridge.runs.session import execute
from hil_bridge.settings.configuration import read_config


def record(path: Path, seed: int) -> bytes:
    config = read_config({"run": {"duration_s": 3.0, "seed": seed}})
    assert execute(config, virtual=True, outputs=Outputs(record=path), view=False) == 0
    return path.read_bytes()


@pytest.mark.full
def test_same_seed_gives_same_bytes_in_every_process(tmp_path: Path) -> None:
    here = record(tmp_path / "here.mcap", seed=7)
    assert record(tmp_path / "again.mcap", seed=7) == here
    there = tmp_path / "there.mcap"
    code = "from hil_bridge.cli import main; main()"
    options = ["run", "--virtual", "--duration", "3", "--seed", "7", "--no-view", "--record", str(there)]
    subprocess.run([sys.executable, "-c", code, *options], check=True, capture_output=True)
    assert there.read_bytes() == here


def test_different_seed_gives_different_run(tmp_path: Path) -> None:
    record(tmp_path / "a.mcap", seed=1)
    record(tmp_path / "b.mcap", seed=2)
    a, b = read(tmp_path / "a.mcap"), read(tmp_path / "b.mcap")
    assert [cycle.answered_at for cycle in a.cycles] != [cycle.answered_at for cycle in b.cycles]
    assert [frame.counts for frame in a.sensors] != [frame.counts for frame in b.sensors]
