"""Small campaign in which half of the runs fail, its execution, and modified copies of its results."""

import sqlite3
from pathlib import Path

from hil_bridge.lab.campaign.plan import Plan
from hil_bridge.lab.campaign.store import Store
from hil_bridge.lab.campaign.working import missing, work

STUDY = """
[campaign]
name = "study"
seeds = { from = 1, to = SEEDS }
[campaign.matrix]
task.force_n = [8.0, 10.0]
[[campaign.fault]]
on = "robot"
fault = "emergency-stop"
phase = "track"
[campaign.criteria]
outcome = "completed"
force_true_max_n = { below = 60 }
overshoot_percent = { below = 1000, outcomes = ["interrupted"] }
[config.run]
duration_s = 0.3
[config.sensor]
emulated = "ft300"
[config.task]
retract_mm = 2.0
[config.cell]
start_position_mm = [900.0, -100.0, 591.0]
"""


def study(folder: Path, seeds: int = 2, text: str = STUDY) -> Path:
    path = folder / "study.toml"
    path.write_text(text.replace("SEEDS", str(seeds)))
    return path


def done(plan: Plan, path: Path) -> None:
    with Store.begin(path, plan) as store:
        work(plan, store, missing(plan, store), workers=1)


def changed(results: Path, path: Path, *statements: str) -> Path:
    """Return a copy of the results with a modification."""
    with sqlite3.connect(results) as source, sqlite3.connect(path) as target:
        source.backup(target)
        for sql in statements:
            target.execute(sql)
    source.close()
    target.commit()
    target.close()
    return path
