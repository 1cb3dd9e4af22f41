"""Evidence of a run, and violations of the guard promises, as plain values."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bridge.record import Recording
from hil_bridge.settings.configuration import Config

Floats = npt.NDArray[np.float64]


class Promise(StrEnum):
    """Promise of the guard."""

    ORDERS = "no-order-deeper"
    END = "end-reported"
    LAST_LINE = "last-line-true"
    BOUND = "bound-kept"
    SPEED = "speed-kept"
    GATE = "gate-silent"
    REPLAY = "replay-equal"
    WHOLE = "ended-and-whole"
    EXIT = "exit-code-fits"
    BUG = "no-bug"
    MODEL = "model-accepts"
    ORDER = "order-equal"


_TEXTS: Mapping[Promise, str] = {
    Promise.ORDERS: "an order went {deeper_mm:.2f} mm deeper {after_s:.2f} s after the stop",
    Promise.END: "the tool is reported as off the surface, but presses with {true_n:.1f} N",
    Promise.LAST_LINE: "the last line reports {told:.1f} {unit}; true value: {true:.1f} {unit}",
    Promise.BOUND: "the true force reached {true_n:.1f} N; bound: {bound_n:.1f} N",
    Promise.SPEED: "the tool moved at {true_mm_s:.0f} mm/s; allowed: at most {allowed_mm_s:.0f} mm/s",
    Promise.GATE: "the last gate stopped an order, which indicates a bug in the decision before it",
    Promise.REPLAY: "the replay differs in {cycles:.0f} cycles",
    Promise.WHOLE: "the recording is incomplete, or the run took too long: {lasted_s:.0f} s",
    Promise.EXIT: "exit code {code:.0f} contradicts the outcome",
    Promise.BUG: "a bug ended the run",
    Promise.MODEL: "the model of the guard does not accept {detail}",
    Promise.ORDER: "another order of callbacks that are due together changes {detail}",
}
"""Text for a violation of each promise, with placeholders for its figures."""


class Violation(NamedTuple):
    """Violation of a promise in a run."""

    promise: Promise
    at: float
    """Time of the violation on the run's clock, s; NaN if it has no time."""
    figures: Mapping[str, float]
    """Figures that prove the violation, by name with unit."""
    unit: str = ""
    """Unit of the figures, if the promise concerns several quantities; otherwise empty."""
    detail: str = ""
    """Text from the recording, if the figures are not sufficient; otherwise empty."""


def violation_text(violation: Violation) -> str:
    """Format a violation as one line."""
    return f"{violation.promise}: {violation_detail(violation)}"


def violation_detail(violation: Violation) -> str:
    """Format a violation without the name of the promise."""
    text = _TEXTS[violation.promise].format(**violation.figures, unit=violation.unit, detail=violation.detail)
    when = f" at {violation.at:.2f} s of the run's clock" if math.isfinite(violation.at) else ""
    return f"{text}{when}"


@dataclass(frozen=True, eq=False, slots=True)
class Trace:
    """True state of an emulated cell over a complete run."""

    times: Floats
    """Times (n,), s on the run's clock, ascending. The last time is after the end of the run."""
    forces: Floats
    """Magnitudes (n,) of the true contact force, N."""
    positions: Floats | None = None
    """True positions (n, 3) of the tool centre point, base frame, m."""
    vectors: Floats | None = None
    """True contact forces (n, 3), base frame, N; None if only their magnitudes are known."""


@dataclass(frozen=True, eq=False, slots=True)
class Evidence:
    """Evidence from which the promises are judged."""

    recording: Recording
    config: Config
    """Configuration of the run."""
    trace: Trace | None = None
    """True state of the cell. None if there is only a recording: its records of the truth are then used, and the
    end is not judged.
    """
    exit_code: int | None = None
    """Exit code of the process; None if there was no process."""
    usual: Recording | None = None
    """Same run with its callbacks first in, first out; None if it was not made."""

    @property
    def truth(self) -> Trace | None:
        """True state of the cell, from the trace or else from the recording; None for real devices."""
        truths = self.recording.truths
        if self.trace is not None or not truths:
            return self.trace
        times = np.array([truth.at for truth in truths])
        vectors = np.array([truth.force for truth in truths])
        return Trace(
            times, np.linalg.norm(vectors, axis=1), np.array([truth.position for truth in truths]), vectors
        )
