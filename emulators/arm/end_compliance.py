"""Compliance of sensor and tool, which are in series with the arm.

The body of the sensor is a spring at the sensor's origin, for forces and moments. The tool is a spring at its tip, for
forces only. A wrench moves between two points by the transpose of the adjoint, and a small displacement by the
adjoint, so the compliance C of the sensor is Xᵀ C X about the tip, where X maps a wrench about the tip to the wrench
about the sensor's origin (Murray, Li and Sastry, A Mathematical Introduction to Robotic Manipulation, 1994).
"""

import math
from typing import NamedTuple

import numpy as np

from emulators.seams import Floats, SensorStiffness
from emulators.tool import ToolProfile, moment_matrix


class EndCompliance(NamedTuple):
    """Compliance of sensor and tool: displacement of the tip, m and rad, per wrench about the tip, N and N·m.

    Both matrices are in the tool frame.
    """

    sensor: Floats
    """Compliance of the sensor (6, 6). The weight of the tool acts on it."""
    tool: Floats
    """Compliance of the tool (6, 6). No weight acts on it, because the mass of the tool is assumed to be behind it."""


RIGID_END = EndCompliance(np.zeros((6, 6)), np.zeros((6, 6)))
"""Rigid sensor with a rigid tool."""


def end_compliance(tool: ToolProfile, sensor: SensorStiffness | None) -> EndCompliance:
    """Return the compliance of a tool and of the sensor that carries it. A sensor of None is rigid."""
    about_tip = np.zeros((6, 6))
    if sensor is not None:
        to_sensor = np.eye(6)
        to_sensor[3:, :3] = moment_matrix((0.0, 0.0, tool.length_mm * 1e-3)).T
        at_sensor = np.diag(1.0 / np.array([*sensor.stiffness_n_m, *sensor.stiffness_nm_rad]))
        about_tip = to_sensor.T @ at_sensor @ to_sensor
    along, across = tool.stiffness_n_m or (math.inf, math.inf)
    return EndCompliance(about_tip, np.diag([1.0 / across, 1.0 / across, 1.0 / along, 0.0, 0.0, 0.0]))
