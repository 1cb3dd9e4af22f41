"""Recordings shared by tests: one run per configuration, with the recording that the command would write."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from hil_bridge import api
from tests.near_surface import EMERGENCY_STOP, SHORT, merged
from tests.recordings import Recordings


@pytest.fixture
def counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Recordings, list[api.Config]]:
    """Return an empty folder of recordings, and the configurations of the runs made for it."""
    configs_run: list[api.Config] = []
    simulation = api.simulation

    def simulate(config: api.Config) -> object:
        configs_run.append(config)
        return simulation(config)

    monkeypatch.setattr(api, "simulation", simulate)
    return Recordings(tmp_path / "recordings"), configs_run


def test_shared_run_is_made_once(counted: tuple[Recordings, list[api.Config]], tmp_path: Path) -> None:
    recordings, configs_run = counted
    path = recordings.path(SHORT, seed=7)
    assert path == recordings.path(api.load(SHORT, seed=7).model_dump(mode="json"))
    assert path == Recordings(tmp_path / "recordings").path(SHORT, seed=7)  # of another process
    assert len(configs_run) == 1
    assert recordings(SHORT, seed=7) is recordings(SHORT, seed=7)
    assert path.read_bytes() == api.simulate(SHORT, seed=7).save(tmp_path / "own.mcap").read_bytes()
    assert [one.suffix for one in sorted(path.parent.iterdir())] == [".lock", ".mcap"]


def test_shared_run_key_covers_all_inputs(tmp_path: Path) -> None:
    recordings = Recordings(tmp_path / "recordings")
    requested = {
        recordings.path(SHORT),
        recordings.path(SHORT, seed=2),
        recordings.path(SHORT, faults=[{**EMERGENCY_STOP, "after_s": 0.2}]),
        recordings.path(SHORT, faults=[{**EMERGENCY_STOP, "after_s": 0.3}]),
        recordings.path(merged(SHORT, {"sensor": {"emulated": "ft300"}})),
        recordings.path(merged(SHORT, {"cell": {"surface": {"stiffness_n_m": 6e3}}})),
    }
    assert len(requested) == 6
    outcomes = [api.read(path).end["outcome"] for path in sorted(requested)]
    assert sorted(outcomes) == ["completed"] * 4 + ["stopped"] * 2


def test_shared_run_concurrent_requests_share_one_run(
    counted: tuple[Recordings, list[api.Config]], tmp_path: Path
) -> None:
    _, configs_run = counted
    both = Recordings(tmp_path / "recordings"), Recordings(tmp_path / "recordings")
    with ThreadPoolExecutor(2) as threads:
        first, second = threads.map(lambda recordings: recordings.path(SHORT), both)
    assert first == second
    assert len(configs_run) == 1


def test_shared_refused_run_has_recording(tmp_path: Path) -> None:
    recordings = Recordings(tmp_path / "recordings")
    wrong = {"on": "sensor", "fault": "wrong-scales", "phase": "connect"}
    with pytest.raises(api.BridgeError, match="weight"):
        recordings.path(SHORT, faults=[wrong])
    recording = recordings(SHORT, faults=[wrong], refused=True)
    assert (recording.cycles, recording.end["outcome"]) == ((), "stopped")
    with pytest.raises(api.ConfigError, match="run\\.speed"):
        recordings.path({"run": {"speed": 1}})
    assert len([*(tmp_path / "recordings").glob("*.mcap")]) == 1
