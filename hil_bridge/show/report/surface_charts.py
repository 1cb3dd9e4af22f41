"""What the emulated surface knows of the tool's axis, over time. Nothing of it was measured."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil_bridge.record.reader import Recording
from hil_bridge.record.records import TruthRecord
from hil_bridge.show.pages import Chart, Series
from hil_bridge.show.report.sources import Array, Sources

TOUCH_N = 0.05
"""Force from which the tool touches. Chosen: far below any force that a sensor of the house resolves under noise."""


class Orientation(NamedTuple):
    """How far the tool's axis stood from the inward normal."""

    at: Array
    """(n,), s on the run's clock."""
    error_deg: Array
    """(n,), NaN where the surface tells no normal."""
    touching: NDArray[np.bool_]
    """(n,)"""

    @property
    def touched_deg(self) -> Array:
        """Errors while the tool touched a surface whose normal is known."""
        return self.error_deg[self.touching & np.isfinite(self.error_deg)]


def orientation_of(truths: Sequence[TruthRecord]) -> Orientation | None:
    """None where no truth tells a normal."""
    if not truths:
        return None
    quaternions, normals, forces = (
        np.array([getattr(truth, name) for truth in truths], dtype=np.float64)
        for name in ("quaternion", "normal", "force")
    )
    if not (np.isfinite(normals).all(axis=1) & np.isfinite(quaternions).all(axis=1)).any():
        return None
    w, x, y, z = quaternions.T
    axis = np.stack((2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)), axis=1)
    # The sine and the cosine: the cosine alone says little of a small angle.
    angle = np.arctan2(
        np.linalg.norm(np.cross(axis, -normals), axis=1), np.einsum("ij,ij->i", axis, -normals)
    )
    touching = np.linalg.norm(forces, axis=1) > TOUCH_N
    return Orientation(np.array([truth.at for truth in truths]), np.degrees(angle), touching)


def orientation_chart(recording: Recording, zero: float, sources: Sources, layer: str) -> Chart | None:
    """The angle between the tool's axis and the inward normal; None where the record tells no normal, or where the
    two are the same all the time. `zero` is the start of the times, s on the run's clock.
    """
    found = orientation_of(recording.truths)
    if found is None or not np.nanmax(found.error_deg) > 0.01:
        return None
    touched = np.where(found.touching, found.error_deg, np.nan)
    columns = {"angle": found.error_deg, "touched": touched}
    source = sources.add("orientation", "orientation", found.at - zero, columns)
    return Chart(
        "orientation",
        "Tool axis against the inward normal of the surface (truth)",
        "°",
        [
            Series(source, "angle", "in free space", "faint", layer=layer),
            Series(source, "touched", "while it touched", "truth", layer=layer),
        ],
        zero=True,
        least_span=1.0,
        height_px=140,
    )
