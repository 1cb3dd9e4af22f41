"""Detector of a force that oscillates about its target for longer than a settling loop would.

The detector is called once for every sample in TRACK, after the controller, with the force error that the
controller received and its stiffness estimate:

    state, advice = detector.step(state, force - reference, command.stiffness, dt)

`advice.factor` is the factor for the feedback law's output from the next sample until the next advice.
`advice.retract` requests the end of the run (`Program.fail`), because the oscillation has continued at the smallest
gain. Start from `initial()` at every start of TRACK; do not step the detector while contact is lost.

Definition of an oscillation: the error has a peak between two changes of its sign. A peak counts if it is outside
the band that a settled loop may fill. The band consists of one resolution step in either direction and the noise:
k_est·Δx_res + uncertainty. Noise of a settled loop stays inside the band, and a step that settles makes a few
peaks, each smaller than the previous one. An oscillation consists of `peaks` peaks within the window, on
alternating sides, that do not decay.
"""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar

from msgspec import Struct

from hil_bridge.control.checks import require_above_zero, require_not_negative
from hil_bridge.control.types import POSITION_STEP_MM
from protocol.marks import SettingError


class Finding(StrEnum):
    """State of the oscillation according to the newest samples."""

    CALM = "calm"
    """No sustained oscillation."""
    OSCILLATING = "oscillating"
    """An oscillation was detected in this sample, and the gain has been lowered by one notch."""
    PERSISTING = "persisting"
    """The oscillation continues at the smallest gain."""


_CALM = Finding.CALM  # before Python 3.12, access through the enum takes ten times as long


class Advice(Struct, frozen=True):
    """Result of the detector for one sample."""

    finding: Finding
    factor: float
    """Factor (0 … 1) for the feedback law's output until the next advice."""
    retract: bool = False
    """Whether the oscillation has persisted at the smallest gain. Once True, it stays True."""
    amplitude: float = 0.0
    """Mean height of the peaks on both sides, N; 0 while calm."""
    period: float = 0.0
    """Mean time from one peak to the next on the same side, s; 0 while calm."""


_WHOLE = Advice(_CALM, 1.0)


class OscillationState(Struct, frozen=True):
    """State of the detector between samples."""

    time: float = 0.0
    """Accumulated time of all samples so far, s."""
    quiet_since: float = 0.0
    """Time at which an oscillation was last detected or the gain was last raised, on the time scale of `time`, s."""
    extreme: float = 0.0
    """Error with the largest magnitude since the last change of sign, N."""
    extreme_at: float = 0.0
    """Time of `extreme`, s."""
    peaks: tuple[tuple[float, float], ...] = ()
    """Completed peaks in the window and beyond the band, oldest first: time in s and error in N, with alternating
    signs.
    """
    factor: float = 1.0
    retract: bool = False
    found: int = 0
    """Number of oscillations detected so far. Each one doubles the calm time before the gain is raised again,
    because a loop that oscillates at a given gain will probably do so again.
    """


@dataclass(frozen=True, slots=True)
class OscillationDetector:
    """Parameters of the detector. All are chosen."""

    __pydantic_config__: ClassVar = {"extra": "forbid"}

    window_ms: float = 7300.0
    """Time within which the peaks must lie. The calm must last that long, doubled for every oscillation detected,
    before the gain is raised. Chosen: 40 samples of 180 ms, with a margin for jitter.
    """
    peaks: int = 6
    """Peaks beyond the band, on alternating sides, that make an oscillation: three periods."""
    decay: float = 0.7
    """Smallest of the newer half of these peaks over the largest of the older; a smaller ratio is a decay."""
    resolution_mm: float = POSITION_STEP_MM
    """Resolution step of the robot's position."""
    force_uncertainty_n: float = 0.5
    """Half-width of the force noise."""
    band_min_n: float = 1.0
    """Smallest band, also used while there is no stiffness estimate."""
    notch: float = 0.5
    """Factor by which each detected oscillation lowers the gain."""
    factor_min: float = 0.125
    """Smallest gain; an oscillation there ends the run."""

    def __post_init__(self) -> None:
        require_above_zero(
            self, "window_ms", "peaks", "decay", "resolution_mm", "notch", "factor_min", "band_min_n"
        )
        require_not_negative(self, "force_uncertainty_n")
        for name in ("decay", "notch", "factor_min"):
            if getattr(self, name) >= 1.0:
                raise SettingError(name, f"must be below 1, got {getattr(self, name)}")
        if self.peaks < 4:
            raise SettingError("peaks", f"must be at least 4, got {self.peaks}: even a step leaves two")

    def initial(self) -> OscillationState:
        """Return the state before the first sample in contact."""
        return OscillationState()

    def step(
        self, state: OscillationState, error: float, stiffness: float | None, dt: float
    ) -> tuple[OscillationState, Advice]:
        """Return the state and the advice after one sample: force error in N, stiffness estimate in N/m, time since
        the previous sample in s. An error that is not finite is skipped.
        """
        if not math.isfinite(error):
            return state, Advice(_CALM, state.factor, state.retract)
        now, window = state.time + dt, self.window_ms * 1e-3
        extreme, extreme_at, peaks = state.extreme, state.extreme_at, state.peaks
        if error * extreme < 0.0:
            peaks = _add(peaks, extreme_at, extreme, self.band(stiffness))
            extreme, extreme_at = error, now
        elif abs(error) > abs(extreme):
            extreme, extreme_at = error, now
        if peaks and now - peaks[0][0] > window:
            peaks = tuple(peak for peak in peaks if now - peak[0] <= window)
        if len(peaks) >= self.peaks and self._sustained(peaks):
            return self._lower_gain(now, extreme, extreme_at, peaks, state)
        factor, since = state.factor, state.quiet_since
        if factor < 1.0 and not peaks and now - since >= window * 2.0**state.found:
            factor, since = min(1.0, factor / self.notch), now
        state = OscillationState(
            time=now,
            quiet_since=since,
            extreme=extreme,
            extreme_at=extreme_at,
            peaks=peaks,
            factor=factor,
            retract=state.retract,
            found=state.found,
        )
        return state, _WHOLE if factor == 1.0 and not state.retract else Advice(_CALM, factor, state.retract)

    def band(self, stiffness: float | None) -> float:
        """Return the largest error of a settled loop in either direction, N."""
        step = (stiffness or 0.0) * self.resolution_mm * 1e-3
        return max(self.band_min_n, step + self.force_uncertainty_n)

    def _sustained(self, peaks: tuple[tuple[float, float], ...]) -> bool:
        sizes = [abs(error) for _, error in peaks[-self.peaks :]]
        half = self.peaks // 2
        return min(sizes[-half:]) >= self.decay * max(sizes[:half])

    def _lower_gain(
        self,
        now: float,
        extreme: float,
        extreme_at: float,
        peaks: tuple[tuple[float, float], ...],
        before: OscillationState,
    ) -> tuple[OscillationState, Advice]:
        """Lower the gain and clear the peaks, so that the loop has a full window to calm down."""
        least = before.factor <= self.factor_min
        factor = before.factor if least else max(self.factor_min, before.factor * self.notch)
        newest = peaks[-self.peaks :]
        advice = Advice(
            finding=Finding.PERSISTING if least else Finding.OSCILLATING,
            factor=factor,
            retract=before.retract or least,
            amplitude=sum(abs(error) for _, error in newest) / len(newest),
            period=2.0 * (newest[-1][0] - newest[0][0]) / (len(newest) - 1),
        )
        count = before.found + 1
        return OscillationState(
            time=now,
            quiet_since=now,
            extreme=extreme,
            extreme_at=extreme_at,
            peaks=(),
            factor=factor,
            retract=advice.retract,
            found=count,
        ), advice


def _add(
    peaks: tuple[tuple[float, float], ...], at: float, error: float, band: float
) -> tuple[tuple[float, float], ...]:
    """Append a completed peak. Of two consecutive peaks on the same side, only the larger counts."""
    if abs(error) <= band:
        return peaks
    if peaks and peaks[-1][1] * error > 0.0:
        return (*peaks[:-1], (at, error)) if abs(error) > abs(peaks[-1][1]) else peaks
    return (*peaks, (at, error))
