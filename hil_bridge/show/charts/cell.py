"""Cell in three dimensions, as one description for live page, `hil-bridge view` and report. `cell.js` draws it."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from pydantic import ValidationError

from hil_bridge.errors import BridgeError
from hil_bridge.record.analysis.strokes import TRACK
from hil_bridge.record.device_facts import recorded_configuration
from hil_bridge.record.reader import Recording
from hil_bridge.record.records import Vector
from hil_bridge.record.removed_map import RemovedMap
from hil_bridge.settings.cell_geometry import Arm, Piece, arm_of, piece_of
from hil_bridge.settings.configuration import Config, read_config
from hil_bridge.show.charts.columns import JOINTS, MILLI, PLACE, SPACE, Columns
from hil_bridge.show.charts.facts import facts_of_recording, start_time
from hil_bridge.show.charts.sources import Array

ROWS_MOST = 450
"""Maximum number of rows of a saved page. Chosen: 25 rows a second for 18 s, and about 110 kB."""
PATH_MOST = 900
"""Maximum number of points of the path in contact, for a run whose rows are sparser than its cycles. Chosen."""
_STEP_M = 0.0005
"""Shortest distance between two points of that path, m. Chosen."""
_ROW_S = 0.04
"""Shortest time between two rows, s. Chosen: one video frame."""
_REMOVED_MOST = 120
"""Maximum number of cells along a side of the removed depths. Chosen."""
_TOOL_M = 0.2
"""Length of the drawn tool if it is unknown, m. Chosen: the default of an emulated cell."""
_TABLES: Mapping[str, Sequence[str]] = {
    "cycle": ("x", *SPACE, "force", "force_reference", "in_contact"),
    "truth": ("x", *SPACE, *JOINTS),
}
_PATH = ("x", *PLACE, "force", "force_reference", "in_contact")
_DECIMALS = {"x": 3, "position": 3, "turn": 5, "force": 2, "joint": 3, "in": 0}
"""Decimal places by the first part of a column's name: 1 µm, 10 mN, 1 millidegree."""


class DrawnTool(Struct, frozen=True):
    """Tool with its sensor."""

    length: float = _TOOL_M
    """Distance from flange to tip, m."""
    radius: float = 0.0
    """Radius of the face, m; 0 for a point."""


class RemovedDepths(Struct, frozen=True):
    """Depths of removed material on a grid, as for `Piece`."""

    corner: tuple[float, float]
    along: tuple[float, float]
    spacing: float
    depths: Sequence[Sequence[float]]
    """Depths, µm."""
    most: float
    """Largest depth, µm."""


class CellModel(Struct, frozen=True):
    """Constant part of the picture. Lengths are in m, base frame."""

    tool: DrawnTool = DrawnTool()
    arm: Arm | None = None
    piece: Piece | None = None
    removed: RemovedDepths | None = None
    up: Vector = (0.0, 0.0, 1.0)
    """Unit vector against the approach."""


def model_of(config: Config | None, places: Sequence[Sequence[float]]) -> CellModel:
    """Return the model for a configuration; `places` are positions of the tool around which the work piece is drawn."""
    if config is None:
        return CellModel()
    tool = config.cell.tool
    x, y, z = config.frame.approach
    drawn = DrawnTool(tool.length_mm * 1e-3, tool.face_radius_mm * 1e-3)
    return CellModel(drawn, arm_of(config), piece_of(config, places), up=(-x, -y, -z))


def cell_picture(recording: Recording) -> Mapping[str, Any]:
    """Return model, rows and the first time to show, s, of a recorded run, for a saved page."""
    zero, facts = start_time(recording), facts_of_recording(recording)
    cycles = recording.cycles
    length_s = cycles[-1].controlled_at - zero if cycles else 0.0
    row_s = max(_ROW_S, length_s / ROWS_MOST)
    columns = Columns.of(recording, zero, facts, row_s)
    rows = {
        table: {name: _compact(name, values[name]) for name in _TABLES[table]}
        for table, values in columns.arrays().items()
    }
    is_sparse = row_s > _ROW_S and columns.counts["cycle"] < len(cycles)
    if is_sparse and (path := _path(recording, zero, columns.start)) is not None:
        rows["path"] = {name: _compact(name, path[:, k]) for k, name in enumerate(_PATH)}
    return {
        "model": recorded_model(recording),
        "start": columns.start,
        "rows": rows,
        "at": _last_contact(recording, zero),
    }


def _path(recording: Recording, zero: float, start: Sequence[float]) -> Array | None:
    """Return the path in contact (n, 7) with the columns `_PATH`, its points evenly spaced; None without contact.

    A row without contact separates two strokes.
    """
    true = {truth.cycle: truth.position for truth in recording.truths}
    numbers = [n for n, one in enumerate(recording.cycles) if one.in_contact and math.isfinite(one.force)]
    if not numbers:
        return None
    touching = [recording.cycles[n] for n in numbers]
    places = np.array([true.get(cycle.cycle, cycle.sample.position) for cycle in touching])
    travelled = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))))
    spacing = max(_STEP_M, travelled[-1] / PATH_MOST)
    _, kept = np.unique(np.floor(travelled / spacing), return_index=True)
    rows = [(c.controlled_at - zero, c.force, c.force_reference, 1.0) for c in (touching[k] for k in kept)]
    at, force, reference, contact = np.array(rows).T
    path: Array = np.column_stack((at, MILLI * (places[kept] - start), force, reference, contact))
    strokes = np.cumsum(np.diff(numbers, prepend=numbers[0]) > 1)[kept]
    lifted = np.flatnonzero(np.diff(strokes)) + 1
    off = path[lifted]
    off[:, -1] = 0.0
    return np.insert(path, lifted, off, axis=0)


def _last_contact(recording: Recording, zero: float) -> float | None:
    """Return the time of the last cycle that pressed, s, or None, which stands for the end."""
    for cycle in reversed(recording.cycles):
        if cycle.phase == TRACK and cycle.in_contact and math.isfinite(cycle.controlled_at):
            return round(cycle.controlled_at - zero, 3)
    return None


def recorded_model(recording: Recording) -> CellModel:
    """Return the model of a recorded run."""
    config = recorded_settings(recording)
    touched = {cycle.cycle for cycle in recording.cycles if cycle.in_contact}
    touches = [truth.position for truth in recording.truths if truth.cycle in touched]
    model = model_of(config, touches or [truth.position for truth in recording.truths[-1:]])
    return model if recording.removed is None else replace(model, removed=_removed(recording.removed))


def recorded_settings(recording: Recording) -> Config | None:
    """Return the settings of a recorded run; None if it has none, or if their plug-in is not installed."""
    recorded = recorded_configuration(recording)
    try:
        return read_config(recorded) if recorded else None
    except (BridgeError, ValidationError, TypeError, ValueError):
        return None


def _removed(removed: RemovedMap) -> RemovedDepths:
    depths = removed.depths
    every = max(1, -(-max(depths.shape) // _REMOVED_MOST))
    return RemovedDepths(
        removed.origin_m,
        removed.direction,
        removed.spacing_m * every,
        np.round(depths[::every, ::every], 2).tolist(),
        float(f"{max(float(depths.max()), 1e-3):.3g}"),
    )


def _compact(name: str, values: Array) -> float | list[float | None] | None:
    """Return a rounded column; one value if it is constant, except for the times."""
    digits = _DECIMALS[name.partition("_")[0]]
    rounded = [None if math.isnan(value) else round(value, digits) + 0.0 for value in values.tolist()]
    return rounded[0] if name != "x" and len(set(rounded)) == 1 else rounded
