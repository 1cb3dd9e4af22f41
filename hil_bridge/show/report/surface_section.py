"""Surface section of the page: ground truth of the emulated surface. None of these values are measured."""

from html import escape

import numpy as np

from hil_bridge.record.reader import Recording
from hil_bridge.show.charts.maps import removed_map
from hil_bridge.show.charts.surface import tilt_deg, touches
from hil_bridge.show.pages.maps import map_svg
from hil_bridge.show.report.markup import across


def surface_section(recording: Recording) -> str:
    """Render the section; empty for a real cell, and for a recording that has neither normals nor a map."""
    removed = recording.removed
    tilts = [(truth, tilt) for truth in recording.truths if (tilt := tilt_deg(truth)) is not None]
    if not tilts and removed is None:
        return ""
    sentences = []
    if removed is not None:
        depths = removed.depths
        volume_mm3 = float(depths.sum()) * 1e-3 * (removed.spacing_m * 1e3) ** 2
        sentences.append(f"The tool removed {volume_mm3:.3g} mm³, at most {float(depths.max()):.3g} µm deep.")
    if touched := [tilt for truth, tilt in tilts if touches(truth)]:
        rms = float(np.sqrt(np.mean(np.square(touched))))
        sentences.append(
            f"In contact, its axis was {rms:.2f}° RMS from the normal, at most {max(touched):.2f}°."
        )
    verdict = f'<p class="verdict">{escape(" ".join(sentences))}</p>\n' if sentences else ""
    drawn = "" if (wear := removed_map(recording)) is None else across(map_svg(wear))
    return f"<h2>Emulated surface</h2>\n{verdict}{drawn}\n"
