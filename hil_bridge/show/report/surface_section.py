"""Surface section of the page: ground truth of the emulated surface. None of these values are measured."""

from collections.abc import Sequence
from html import escape

import numpy as np

from hil_bridge.record.device_facts import devices_of
from hil_bridge.record.reader import Recording
from hil_bridge.record.records import TruthRecord, Vector
from hil_bridge.show.charts.facts import approach_of
from hil_bridge.show.charts.sources import Array
from hil_bridge.show.charts.surface import LEAST_DEFLECTION_UM, deflection_um, tilt_deg, touches

_LEAST_FORCE_N = 1.0
"""Mean force below which a deflection per force has no meaning, N. Chosen: some deflections are then vibration."""


def surface_section(recording: Recording) -> str:
    """Render the section; empty for a real cell, and for a recording without normals, map and deflection."""
    removed = recording.removed
    tilts = [(truth, tilt) for truth in recording.truths if (tilt := tilt_deg(truth)) is not None]
    deflection = _deflection_sentences(recording)
    if not tilts and removed is None and not deflection:
        return ""
    sentences = []
    if removed is not None:
        depths = removed.depths
        volume_mm3 = float(depths.sum()) * 1e-3 * (removed.spacing_m * 1e3) ** 2
        sentences.append(f"The tool removed {volume_mm3:.3g} mm³, at most {float(depths.max()):.3g} µm deep.")
    if touched := [tilt for truth, tilt in tilts if touches(truth)]:
        rms = float(np.sqrt(np.mean(np.square(touched))))
        sentences.append(
            f"In contact, the tool's axis was {rms:.2f}° RMS from the normal, at most {max(touched):.2f}°."
        )
    sentences += deflection
    verdict = f'<p class="verdict">{escape(" ".join(sentences))}</p>\n' if sentences else ""
    return f"<h2>Emulated surface</h2>\n{verdict}"


def _deflection_sentences(recording: Recording) -> list[str]:
    """Return the deflection in contact, and how reported positions differ; empty for a rigid arm."""
    approach, truths = approach_of(recording), recording.truths
    touched = np.array([touches(truth) for truth in truths], dtype=bool)
    if approach is None or not touched.any():
        return []
    back, lateral = np.array([deflection_um(truth, approach) for truth in truths]).T
    largest = float(np.hypot(back, lateral)[touched].max())
    if not largest > LEAST_DEFLECTION_UM:
        return []
    samples, step = [cycle.sample for cycle in recording.cycles], devices_of(recording).robot.position_step_m
    ages = [sample.now - sample.position_at for sample in samples if sample.position_at is not None]
    late = f"{1e3 * float(np.median(ages)):.0f} ms old" if ages else "of unknown age"
    rounded = f", rounded to {1e3 * step:g} mm" if step else ""
    return [
        f"In contact, the tip deflected by at most {largest:.0f} µm from the position that the encoders measure,"
        f" by contact force, weight and acceleration{_ratio(truths, touched, back, approach)}.",
        f"Without faults, the reported position is that of the encoders, {late}{rounded}.",
    ]


def _ratio(truths: Sequence[TruthRecord], touched: Array, back: Array, approach: Vector) -> str:
    """Return the mean deflection per force from the first touch to the last, as text; empty if it is unknown.

    Oscillations average out. The mean of the deflections before and after the contact removes weight and acceleration,
    which has the opposite sign in the retraction. `back` are the deflections against the approach, µm.
    """
    first, end = int(touched.argmax()), len(touched) - int(touched[::-1].argmax())
    force = -float(np.mean([np.dot(truth.force, approach) for truth in truths[first:end]]))
    if not 0 < first < end < len(touched) or force < _LEAST_FORCE_N:
        return ""
    free = (back[:first].mean() + back[end:].mean()) / 2.0
    return f"; about {(back[first:end].mean() - free) / force:.2g} µm per newton along the approach"
