"""Campaign results shared by several tests."""

from pathlib import Path

import pytest

from hil_bridge.lab.campaign.plan_file import read_plan
from hil_bridge.lab.campaign.store import Store
from hil_bridge.lab.campaign.working import missing, work
from tests.campaign.study import done, study

SHORT = """
[campaign]
name = "short"
seeds = { from = 1, to = 2 }
[campaign.matrix]
task.force_n = [8.0, 10.0]
[[campaign.fault]]
on = "robot"
fault = "emergency-stop"
phase = "track"
[campaign.criteria]
outcome = "completed"
force_true_max_n = { below = 60 }
[config.run]
duration_s = 0.3
[config.sensor]
emulated = "ft300"
[config.task]
retract_mm = 2.0
[config.cell]
start_position_mm = [900.0, -100.0, 591.0]
"""
"""Two cells with and without an emergency stop, which misses the criterion: 8 runs, of which 4 fail."""


@pytest.fixture(scope="session")
def short_results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of SHORT."""
    folder = tmp_path_factory.mktemp("short")
    (folder / "short.toml").write_text(SHORT)
    plan = read_plan(folder / "short.toml")
    with Store.begin(folder / "short.sqlite", plan) as store:
        work(plan, store, missing(plan, store), workers=1)
    return folder / "short.sqlite"


@pytest.fixture(scope="session")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of a study; a test changes a copy."""
    folder = tmp_path_factory.mktemp("campaign")
    done(read_plan(study(folder)), folder / "study.sqlite")
    return folder / "study.sqlite"
