"""The recordings that tests share: one run for one configuration, and the recording that the command would leave."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from hil_bridge import api
from tests.near_surface import EMERGENCY_STOP, SHORT, merged
from tests.recordings import Recordings


@pytest.fixture
def counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Recordings, list[api.Config]]:
    """An empty folder of recordings, and the configurations of the runs that are made for it."""
    made: list[api.Config] = []
    simulation = api.simulation

    def simulate(config: api.Config) -> object:
        made.append(config)
        return simulation(config)

    monkeypatch.setattr(api, "simulation", simulate)
    return Recordings(tmp_path / "recordings"), made


def test_a_run_is_made_once_and_is_the_one_that_was_asked_for(
    counted: tuple[Recordings, list[api.Config]], tmp_path: Path
) -> None:
    recordings, made = counted
    path = recordings.path(SHORT, seed=7)
    assert path == recordings.path(api.load(SHORT, seed=7).model_dump(mode="json"))
    assert path == Recordings(tmp_path / "recordings").path(SHORT, seed=7)  # of another process
    assert len(made) == 1
    assert recordings(SHORT, seed=7) is recordings(SHORT, seed=7)
    assert path.read_bytes() == api.simulate(SHORT, seed=7).save(tmp_path / "own.mcap").read_bytes()
    assert [one.suffix for one in sorted(path.parent.iterdir())] == [".lock", ".mcap"]


def test_whatever_a_run_depends_on_makes_another_recording(tmp_path: Path) -> None:
    recordings = Recordings(tmp_path / "recordings")
    asked = {
        recordings.path(SHORT),
        recordings.path(SHORT, seed=2),
        recordings.path(SHORT, faults=[{**EMERGENCY_STOP, "after_s": 0.2}]),
        recordings.path(SHORT, faults=[{**EMERGENCY_STOP, "after_s": 0.3}]),
        recordings.path(merged(SHORT, {"sensor": {"emulated": "ft300"}})),
        recordings.path(merged(SHORT, {"cell": {"surface": {"stiffness_n_m": 6e3}}})),
    }
    assert len(asked) == 6
    outcomes = [api.read(path).end["outcome"] for path in sorted(asked)]
    assert sorted(outcomes) == ["completed"] * 4 + ["stopped"] * 2


def test_two_that_ask_at_the_same_time_wait_for_one_run(
    counted: tuple[Recordings, list[api.Config]], tmp_path: Path
) -> None:
    _, made = counted
    both = Recordings(tmp_path / "recordings"), Recordings(tmp_path / "recordings")
    with ThreadPoolExecutor(2) as threads:
        first, second = threads.map(lambda recordings: recordings.path(SHORT), both)
    assert first == second
    assert len(made) == 1


def test_a_refused_run_has_a_recording_and_a_wrong_configuration_none(tmp_path: Path) -> None:
    recordings = Recordings(tmp_path / "recordings")
    wrong = {"on": "sensor", "fault": "wrong-scales", "phase": "connect"}
    with pytest.raises(api.BridgeError, match="weight"):
        recordings.path(SHORT, faults=[wrong])
    recording = recordings(SHORT, faults=[wrong], refused=True)
    assert (recording.cycles, recording.end["outcome"]) == ((), "stopped")
    with pytest.raises(api.ConfigError, match="run\\.speed"):
        recordings.path({"run": {"speed": 1}})
    assert len([*(tmp_path / "recordings").glob("*.mcap")]) == 1
