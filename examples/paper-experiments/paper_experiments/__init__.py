"""The paper's figures and tables, repeated by simulation and on the emulated cell, and what goes beyond."""

from hil_bridge.lab.experiments.comparison import COMPARISON
from hil_bridge.lab.experiments.files import write_findings, write_page
from hil_bridge.lab.experiments.resolution import RESOLUTION
from hil_bridge.lab.experiments.results import Experiment, Findings, run_jobs
from hil_bridge.lab.experiments.rules import RULES
from hil_bridge.lab.experiments.simulation import SIMULATION
from hil_bridge.lab.experiments.tracking import CONTOUR, FLAT

EXPERIMENTS = {
    experiment.name: experiment for experiment in (RULES, SIMULATION, FLAT, CONTOUR, RESOLUTION, COMPARISON)
}
"""Every experiment by its name, in the order of the paper."""

__all__ = [
    "EXPERIMENTS",
    "Experiment",
    "Findings",
    "run_jobs",
    "write_findings",
    "write_page",
]
