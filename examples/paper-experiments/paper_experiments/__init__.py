"""The paper's figures and tables, reproduced by simulation and on the emulated cell, with extensions."""

from paper_experiments.comparison import COMPARISON
from paper_experiments.files import write_findings, write_page
from paper_experiments.resolution import RESOLUTION
from paper_experiments.results import Experiment, Findings, run_jobs
from paper_experiments.rules import RULES
from paper_experiments.simulation import SIMULATION
from paper_experiments.tracking import CONTOUR, FLAT

EXPERIMENTS = {
    experiment.name: experiment for experiment in (RULES, SIMULATION, FLAT, CONTOUR, RESOLUTION, COMPARISON)
}
"""All experiments by name, in the order of the paper."""

__all__ = [
    "EXPERIMENTS",
    "Experiment",
    "Findings",
    "run_jobs",
    "write_findings",
    "write_page",
]
