"""Files of a tool identification: poses as CSV, and the result as TOML for a configuration."""

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path

from hil_bridge.control import ToolEstimate, ToolPose
from hil_bridge.errors import ConfigError
from hil_bridge.errors.file_kinds import HEAD_BYTES, refuse_known
from hil_bridge.errors.text_files import read_text, toml_value

FORCE_AXES = ("fx", "fy", "fz")
_AXES = ("fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm")
ORIENTATION_COLUMNS = ("qw", "qx", "qy", "qz")
"""Columns with the orientation of the tool in the base frame, as a quaternion that need not have unit length."""
WRENCH_COLUMNS = _AXES
"""Columns with the mean reading in the sensor frame."""
SCATTER_COLUMNS = tuple(f"sd_{axis}" for axis in _AXES)
"""Columns with the standard deviation of the readings; optional."""


def read_poses(path: Path) -> list[ToolPose]:
    """Read the poses of a CSV file with a header line. Other columns are ignored.

    Raises ConfigError that names file, line and column if an entry is invalid.
    """
    text = read_text(path)
    lines = csv.DictReader(io.StringIO(text), skipinitialspace=True)
    names = lines.fieldnames or ()
    if missing := [name for name in (*ORIENTATION_COLUMNS, *WRENCH_COLUMNS) if name not in names]:
        refuse_known(str(path), text[:HEAD_BYTES].encode())
        raise ConfigError(f"{path}: missing column {missing[0]}; the first line must name the columns")
    scattered = set(SCATTER_COLUMNS) <= set(names)

    def numbers(row: dict[str, str | None], columns: Sequence[str]) -> tuple[float, ...]:
        values = []
        for column in columns:
            try:
                values.append(float(row[column] or ""))
            except ValueError as error:
                raise ConfigError(
                    f"{path}, line {lines.line_num}: {column} must be a number, got {row[column]!r}"
                ) from error
            if not math.isfinite(values[-1]):
                raise ConfigError(
                    f"{path}, line {lines.line_num}: {column} must be finite, got {row[column]}"
                )
        return tuple(values)

    poses = []
    for row in lines:
        quaternion = numbers(row, ORIENTATION_COLUMNS)
        if math.hypot(*quaternion) < 1e-6:
            raise ConfigError(
                f"{path}, line {lines.line_num}: {', '.join(ORIENTATION_COLUMNS)} are not a rotation"
            )
        scatter = numbers(row, SCATTER_COLUMNS) if scattered else (0.0,) * len(_AXES)
        poses.append(ToolPose(quaternion, numbers(row, WRENCH_COLUMNS), scatter))
    return poses


def poses_as_csv(poses: Sequence[ToolPose]) -> str:
    """Return the poses as a table in the format of `read_poses`, exact to the last bit."""
    lines = [",".join((*ORIENTATION_COLUMNS, *WRENCH_COLUMNS, *SCATTER_COLUMNS))]
    lines += [",".join(map(repr, (*pose.quaternion, *pose.wrench, *pose.scatter))) for pose in poses]
    return "\n".join(lines) + "\n"


def tool_as_toml(estimate: ToolEstimate) -> str:
    """Return the tables to paste into a configuration, with uncertainties as comments."""

    def vector(values: Sequence[float], digits: int) -> str:
        # Adding zero turns −0.0 into 0.0.
        return toml_value([round(value, digits) + 0.0 for value in values])

    centre_mm = [value * 1e3 for value in estimate.centre_of_gravity]
    centre_uncertainty_mm = [value * 1e3 for value in estimate.centre_of_gravity_uncertainty]
    return f"""\
# Identified from {len(estimate.residuals)} poses; ± are standard uncertainties.
[tool]
mass_kg = {round(estimate.mass, 5)!r}  # ± {estimate.mass_uncertainty:.5f}
centre_of_gravity_mm = {vector(centre_mm, 3)}  # ± {vector(centre_uncertainty_mm, 3)}

[sensor]
verified = {toml_value([FORCE_AXES[k] for k in estimate.verified])}  # axes that followed the turning weight
bias_n = {vector(estimate.bias[:3], 5)}  # ± {vector(estimate.bias_uncertainty[:3], 5)}
bias_nm = {vector(estimate.bias[3:], 6)}  # ± {vector(estimate.bias_uncertainty[3:], 6)}
"""
