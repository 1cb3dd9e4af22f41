"""Run of the complete chain as a job, and the results that the experiments use."""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil_bridge.api import simulate
from hil_bridge.control import FiguresOfMerit, ForceTrace, figures_of_merit
from hil_bridge.control.analysis.merit import STEADY_SAMPLES
from hil_bridge.record import Outcome
from hil_bridge.settings.configuration import Config, read_config
from paper_experiments.paper_simulation import Parameters

Floats = NDArray[np.float64]

CYCLE_S = {9600: 0.18, 19200: 0.102}
"""Cycle time by the rate of the link, s. It converts a distance per sample to a speed. Source: measured in virtual
time; the spread of ± 4 % does not change the number of position steps per sample.
"""
CORRECTION_MM = 2.1
"""Chosen: correction that the supervisor allows per sample, just above what most controllers allow themselves."""
LIMIT_N = 1000.0
"""Force limits of the supervisor in experiments, high enough to show what a controller does instead of stopping it."""


class CellTrace(NamedTuple):
    """TRACK phase of a run, one value per cycle, and the end of the run."""

    time: Floats
    """Time since TRACK began, s."""
    force: Floats
    """Measured force, N."""
    depth: Floats
    """Reported depth from the start point, m."""
    commanded: Floats
    """Commanded depth, m."""
    travel: Floats
    """Commanded travel along the surface, m."""
    stiffness: Floats
    """Estimated stiffness, N/m; NaN if the controller has no estimate."""
    merit: FiguresOfMerit | None
    """Figures of merit; None if there was no contact."""
    period: float
    """Mean time between cycles, s."""
    completed: bool


@dataclass(frozen=True, slots=True)
class CellJob:
    """Run on the emulated cell, described by the quantities that the experiments vary."""

    controller: str
    parameters: Parameters
    seed: int
    stiffness: float = 5000.0
    """Stiffness of the surface, N/m."""
    reference: float = 10.0
    """Target force, N."""
    duration: float = 16.0
    """Duration of TRACK, s."""
    step_mm: float = 1.0
    """Travel along the surface per sample."""
    contour: bool = False
    """Whether the surface is sinusoidal, 10 mm amplitude and 200 mm period, instead of flat."""
    approach_step_mm: float = 0.125
    """Depth added per sample while approaching; small, to touch a hard surface gently."""
    follow_normal: bool = False
    """Whether the force acts along the estimated normal of the surface instead of the fixed direction of the paper."""
    baudrate: int = 9600
    noise_counts: float = 1.0
    """Noise of every axis before the sensor's filters, rms counts."""
    resolution_mm: float = 0.125
    steady_samples: int = STEADY_SAMPLES
    """Number of samples at the end of the run that count as its steady state."""

    def config(self) -> Config:
        """Return the configuration of the run; everything not set here has its default."""
        # The approach is short, so that time goes into tracking.
        link, cycle = {"baudrate": self.baudrate}, CYCLE_S[self.baudrate]
        surface: dict[str, Any] = {"stiffness_n_m": self.stiffness}
        if self.contour:
            surface |= {"kind": "sinusoidal", "amplitude_mm": 10.0, "period_mm": 200.0, "origin_y_mm": -100.0}
        return read_config(
            {
                "run": {"duration_s": self.duration, "seed": self.seed},
                "robot": {"s3": {"link": link}},
                "controller": {
                    "name": self.controller,
                    "parameters": dict(self.parameters),
                    "sample_ms": cycle * 1e3,
                },
                # a zero is whole counts, and where a reference lies between two words one count decides
                "sensor": {"tare": False},
                "tool": {"mass_kg": 0.5, "centre_of_gravity_mm": (0.0, 0.0, 80.0)},
                "frame": {"follow_normal": self.follow_normal},
                "task": {
                    "force_n": self.reference,
                    "speed_mm_s": self.step_mm / cycle,
                    "approach_speed_mm_s": self.approach_step_mm / cycle,
                    "loss_ms": 4.5 * cycle * 1e3,
                    "retract_mm": 5.0,  # off the contour, however it rises
                    "zero_lift_mm": 0.0,  # the start is free, and the approach as long as it says
                    "loss_limit": 1000,
                    "travel_limit_mm": 1000.0,
                },
                "limits": {
                    "force_limit_n": LIMIT_N,
                    "resultant_limit_n": LIMIT_N,
                    "correction_mm_s": CORRECTION_MM / cycle,
                    "oscillation_guard": False,  # what a controller does by itself is the question
                },
                "cell": {
                    "s3": {"link": link, "servo": {"resolution_mm": self.resolution_mm}},
                    "jr3": {"sensor": {"noise_counts": self.noise_counts}},
                    "surface": surface,
                    "arm": {"compliance": "rigid"},  # the paper's stiffness is that of robot and environment
                    "start_position_mm": (900.0, -100.0, 590.5),
                },
            }
        )

    def __call__(self) -> CellTrace:
        """Run the job."""
        run = simulate(self.config())
        cycles = [cycle for cycle in run.cycles if cycle.phase == "track"]

        def column(name: str) -> Floats:
            return np.array([getattr(cycle, name) for cycle in cycles], dtype=np.float64)

        time = np.array([cycle.sample.now for cycle in cycles], dtype=np.float64)
        time -= time[0] if len(time) else 0.0
        merit = None
        if cycles:
            touching = [cycle.in_contact for cycle in cycles]
            trace = ForceTrace(time, column("force"), self.reference, column("depth_commanded"), touching)
            merit = figures_of_merit(trace, self.resolution_mm)
            merit = self._of_the_end(merit, time, column("force"), column("depth_commanded"))
        return CellTrace(
            time,
            column("force"),
            column("depth"),
            column("depth_commanded"),
            column("travel_commanded"),
            column("stiffness"),
            merit,
            float(np.mean(np.diff(time))) if len(time) > 1 else float("nan"),
            run.outcome is Outcome.COMPLETED,
        )

    def _of_the_end(
        self, merit: FiguresOfMerit, time: Floats, force: Floats, depth: Floats
    ) -> FiguresOfMerit:
        """Return the figures with the steady state taken over this job's number of samples."""
        count = self.steady_samples
        if len(time) < count:
            return replace(merit, steady_mean_error_n=None, steady_peak_to_peak_n=None, steps_per_s=None)
        words = np.rint(depth[-count:] / (self.resolution_mm * 1e-3))
        return replace(
            merit,
            steady_mean_error_n=float(np.mean(force[-count:] - self.reference)),
            steady_peak_to_peak_n=float(np.ptp(force[-count:])),
            steps_per_s=float(np.sum(np.abs(np.diff(words))) / (time[-1] - time[-count])),
        )
